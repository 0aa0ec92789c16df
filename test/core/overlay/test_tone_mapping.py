"""The thermal picture: its range, that it does not flicker, and that it follows the scene."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from overlays import luminance

from tirgeo_ros.core.config.overlay_parameters import PALETTES, PictureConfig
from tirgeo_ros.core.overlay.picture_painter import ToneMapper

FRAME_NS = 33_333_333
SHAPE = (120, 160)
ROWS = np.linspace(0, 1, SHAPE[0] * SHAPE[1]).reshape(SHAPE)


def ramp(low=20000.0, high=24000.0):
    return (low + ROWS * (high - low)).astype(np.uint16)


def toner(palette="white_hot", **config):
    return ToneMapper(PictureConfig(**config), palette)


def grey(image):
    assert image.dtype == np.uint8
    assert (image == image[..., :1]).all()
    return image[..., 0].astype(int)


# one picture


def test_sixteen_bits_keep_their_order_and_use_the_range():
    shown = grey(toner().tone(ramp(), 0))
    assert (shown.min(), shown.max()) == (0, 255)
    assert (np.diff(shown.ravel()) >= 0).all()
    # 1 % at each end is cut off: the middle stays in the middle, to one grey level.
    assert abs(shown[60, 0] - 128) <= 1


@pytest.mark.parametrize("value", [0, 65535])
def test_dead_and_hot_pixels_change_nothing(value):
    """Even where they are more than what is cut off at the ends."""
    broken = ramp()
    broken[:, 4:8] = value
    change = grey(toner().tone(broken, 0)) - grey(toner().tone(ramp(), 0))
    change[:, 4:8] = 0
    assert np.abs(change).max() <= 1
    assert set(np.unique(grey(toner().tone(broken, 0))[:, 4:8])) == {255 if value else 0}


@pytest.mark.parametrize("name", PALETTES)
def test_a_palette_has_a_colour_for_each_level_and_hotter_is_never_darker(name):
    levels = np.arange(256, dtype=np.uint8).reshape(16, 16)
    image = toner(name).tone(levels, 0)
    colours = image.reshape(256, 3)
    assert len(np.unique(colours, axis=0)) > 200
    if name != "rainbow":
        rise = np.diff(luminance(colours)) * (-1 if name == "black_hot" else 1)
        assert rise.min() > -2e-3  # OpenCV's tables are rounded to 8 bits
    image[:] = 0  # a picture of its own: what is drawn on it stays out of the message
    assert levels[15, 15] == 255


def test_local_contrast_shows_what_is_faint():
    """A bar three grey levels above an even ground."""
    faint = np.full(SHAPE, 100, np.uint8)
    faint[:, ::16] = 103
    faint[:4] = 255
    plain, local = (
        np.ptp(grey(toner(local_contrast=limit).tone(faint, 0))[60]) for limit in (0.0, 8.0)
    )
    assert plain == 3
    assert local > 2 * plain


@given(
    values=st.lists(st.integers(0, 65535), min_size=4, max_size=60),
    stamps=st.lists(st.integers(-(10**19), 10**19), min_size=2, max_size=5),
)
def test_any_values_at_any_stamps_keep_their_order(values, stamps):
    made = toner()
    raw = np.array([sorted(values)], np.uint16)
    for stamp_ns in stamps:
        assert (np.diff(grey(made.tone(raw, stamp_ns))[0]) >= 0).all()


# a video


def video(made, frames, start_ns=0):
    return [grey(made.tone(raw, start_ns + i * FRAME_NS)) for i, raw in enumerate(frames)]


def hot(raw, share=0.2, value=40000):
    """With something hot in it, in place of what was the hottest."""
    raw = raw.copy()
    raw[len(raw) - round(share * len(raw)) :] = value
    return raw


def test_a_hot_spot_changes_the_rest_slowly():
    """By no more than 3 dt / stretch_time_s of its grey level in a frame, and rounding."""
    frames = [ramp()] * 3 + [hot(ramp())] * 60
    shown = [picture[:80] for picture in video(toner(), frames)]
    most = 3 * FRAME_NS * 1e-9 / 1.0
    for before, after in pairwise(shown):
        assert (np.abs(after - before) <= most * before + 1).all()


@pytest.mark.parametrize("time_s", [0.5, 1.0, 3.0])
@pytest.mark.parametrize("back", [False, True])
def test_a_change_of_the_scene_is_followed_within_the_time(time_s, back):
    """A span that becomes five times as large or small is then right to a tenth."""
    scenes = [ramp(), hot(ramp())]
    first, second = reversed(scenes) if back else scenes
    count = round(time_s * 1e9 / FRAME_NS)
    made = toner(stretch_time_s=time_s)
    shown = video(made, [first] * 3 + [second] * (count + 1))
    begin, settled = (grey(toner().tone(raw, 0)) for raw in (first, second))
    away = np.abs(settled - shown[-1]).max()
    assert away <= 0.1 * 255 + 1
    assert away < 0.2 * np.abs(settled - begin).max()


def test_the_noise_of_a_still_scene_moves_nothing():
    rng = np.random.default_rng(4)
    frames = [(ramp() + rng.normal(0, 30, SHAPE)).astype(np.uint16) for _ in range(40)]
    made = toner()
    video(made, frames)
    ends = made._stretch._ends
    video(made, frames, start_ns=40 * FRAME_NS)
    assert made._stretch._ends == ends

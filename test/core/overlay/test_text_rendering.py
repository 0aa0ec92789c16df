"""Text bitmaps: every script, either library, and laying them over the picture's edges."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.overlay import text_rendering as text
from tirgeo_ros.core.overlay.text_rendering import coverage, stamp

WHITE = (255, 255, 255)


def libraries():
    found = []
    if hasattr(cv2, "FontFace"):
        found.append("opencv")
    try:
        import PIL  # noqa: F401, PLC0415
    except ImportError:
        return found
    return [*found, "pillow"]


@pytest.fixture(params=libraries())
def render(request):
    if request.param == "pillow":
        return text._by_pillow
    return lambda content, size_px: text._by_opencv(cv2, content, size_px)


def test_lines_of_one_size_have_one_height_and_base(render):
    plain, deep = render("xxx", 12), render("xgp", 12)
    assert plain.shape[0] == deep.shape[0]
    inked = [np.flatnonzero(image.max(axis=1) > 60) for image in (plain, deep)]
    assert abs(int(inked[0][0]) - int(inked[1][0])) <= 1  # the x stands equally high in both
    assert inked[1][-1] > inked[0][-1]


def test_accents_are_letters_and_not_boxes(render):
    """The accented letter is the plain one and something above it."""
    if render is text._by_pillow and not text._pillow_font(24)[1]:
        pytest.skip("this system has no typeface: labels are in ASCII")
    plain, accented = render("u", 24), render("\u00fc", 24)
    body = np.flatnonzero(plain.max(axis=1) > 60)[[0, -1]]
    same = plain[body[0] + 1 : body[1]].astype(int) - accented[body[0] + 1 : body[1]]
    assert np.abs(same).max() <= 60
    assert accented[: body[0] - 1].max() > 120


@pytest.mark.skipif(not hasattr(cv2, "FontFace"), reason="OpenCV 4 has no typeface of its own")
def test_chinese():
    one, other = coverage("\u82b1", 24), coverage("\u575b", 24)
    assert one.shape != other.shape or np.abs(one.astype(int) - other).max() > 200


def test_a_stamp_keeps_the_ink_within_its_halo():
    for colour in (WHITE, (80, 200, 255)):
        made = stamp("Abc", 14, colour)
        # keep + ink never exceed white, so a picture under it cannot overflow.
        assert (made.keep.astype(int) + made.ink <= 255).all()
        assert (made.ink.reshape(-1, 3).max(axis=0) == colour).all()


def test_control_characters_and_length():
    assert stamp("a\nb\x00", 12, WHITE) == stamp("a\nb\x00", 12, WHITE)
    np.testing.assert_array_equal(stamp("a\nb", 12, WHITE).ink, stamp("a b", 12, WHITE).ink)
    long = stamp("m" * 500, 12, WHITE)
    assert long.size[0] < stamp("m" * 61, 12, WHITE).size[0] + 1
    assert stamp("", 12, WHITE).ink.max() == 0


@given(left=st.integers(-80, 80), top=st.integers(-40, 60))
def test_laying_a_stamp_anywhere_touches_only_its_place(left, top):
    rng = np.random.default_rng(1)
    image = rng.integers(0, 255, (40, 60, 3), np.uint8)
    made = stamp("Abc", 12, WHITE)
    width, height = made.size
    canvas = np.zeros((200, 300, 3), np.uint8)
    canvas[100:140, 100:160] = image
    place = np.s_[100 + top : 100 + top + height, 100 + left : 100 + left + width]
    wanted = canvas.astype(float)
    wanted[place] = canvas[place] * (made.keep / 255) + made.ink
    made.lay(image, left, top)
    np.testing.assert_allclose(image, wanted[100:140, 100:160], atol=0.5 + 1e-9)  # rounding

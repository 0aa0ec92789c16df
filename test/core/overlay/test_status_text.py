"""The words under the picture, for every state of the filter."""

from __future__ import annotations

import math
import time

import numpy as np
import pytest

from tirgeo_ros.core.overlay.status_text import status_line
from tirgeo_ros.core.overlay.text_boxes import fitted, paint_notice, paint_status
from tirgeo_ros.core.overlay.text_rendering import TEXT_BGR, text_px
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus


def status(state=FilterState.RUNNING, reason="", state_s=0.0, sigma_rad=0.002):
    return NavigationStatus(
        "ekf_heading", state, reason, FixStatus.FIXED, sigma_rad, {}, {}, state_s
    )


def texts(fields):
    return [field.text + field.detail for field in fields]


@pytest.mark.parametrize(
    ("state", "reason", "state_s", "text"),
    [
        (FilterState.DEGRADED, "rtk/heading", 12.4, "degraded 12 s: rtk/heading"),
        (FilterState.DEAD_RECKONING, "", 3.0, "dead reckoning 3 s"),
        (FilterState.WAITING, "no rtk/fix", 250.0, "waiting 4 min: no rtk/fix"),
        (FilterState.ALIGNING, "", 0.0, "aligning 0 s"),
        (FilterState.LOST, "position sigma 11 m", 99.0, "lost 99 s: position sigma 11 m"),
    ],
)
def test_a_state_that_is_not_running_comes_first_with_time_and_reason(
    state, reason, state_s, text
):
    fields = status_line(status(state, reason, state_s), 0.083, 8.0)
    assert texts(fields)[:2] == [text, "ekf_heading"]
    assert fields[0].colour != TEXT_BGR


def test_what_is_not_known_is_not_shown():
    assert texts(status_line(None, 0.05, 9.0)) == [
        "no filter status",
        "age 50 ms",
        "video 9.0 Hz",
    ]
    waiting = status(FilterState.WAITING, sigma_rad=math.nan)
    assert not any("sigma" in text for text in texts(status_line(waiting, 0.0, 9.0)))
    assert texts(status_line(waiting, 0.0, math.nan))[-1] == "video starts"


@pytest.mark.parametrize("state", list(FilterState))
def test_state_method_and_fix_are_whole_on_a_thermal_picture(state):
    """640 px and the text as large as it is there: the words that matter stay."""
    told = status(state, "rtk/fix, rtk/vel, rtk/heading, gps/fix, gps/vel", 5999.0, 0.17)
    kept = texts(fitted(status_line(told, 9.999, 60.0), 640, 15))
    assert "RTK fixed" in kept
    assert "ekf_heading" in kept
    assert "heading sigma 9.74 deg" in kept


def test_the_height_above_ground_stands_before_the_heading():
    def told(above_m):
        return texts(status_line(status(), 0.083, 29.97, above_m=above_m))

    assert told(46.6)[:4] == [
        "ekf_heading",
        "RTK fixed",
        "47 m above ground",
        "heading sigma 0.11 deg",
    ]
    assert not any("ground" in text for text in told(math.nan))
    below = status_line(status(), 0.083, 29.97, above_m=-46.0)
    assert "46 m below ground" in texts(below)
    assert {field.colour for field in below} != {TEXT_BGR}
    for width in (336, 640):
        image = np.empty((width * 4 // 5, width, 3), np.uint8)
        fields = status_line(status(), 0.083, 29.97, above_m=120.0)
        assert "120 m above ground" in texts(fitted(fields, width, text_px(image)))


def luminance(bgr):
    """Relative luminance of an sRGB colour (IEC 61966-2-1)."""
    unit = np.array(bgr) / 255
    linear = np.where(unit <= 0.04045, unit / 12.92, ((unit + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.0722, 0.7152, 0.2126])


@pytest.mark.parametrize("ground", [(255, 255, 255), (0, 255, 255), (0, 0, 0)])
def test_every_colour_of_the_text_stands_out_from_its_strip(ground):
    """4.5 to 1: level AA of WCAG 2 for small text."""
    image = np.full((512, 640, 3), ground, np.uint8)
    paint_status(image, [])
    under = luminance(image[-1, 320])
    states = [status_line(status(state), 0.0, 8.0, 0.1) for state in FilterState]
    for colour in {field.colour for fields in states for field in fields}:
        assert (luminance(colour) + 0.05) / (under + 0.05) >= 4.5


@pytest.mark.parametrize("letters", ["x" * 20_000, "word " * 4_000])
def test_a_text_from_outside_is_cut_before_it_is_measured(letters):
    """It took a second for every few hundred letters; now a frame's time and no more."""
    image = np.zeros((512, 640, 3), np.uint8)
    begin_s = time.monotonic()
    told = NavigationStatus(
        letters, FilterState.LOST, letters, FixStatus.FIXED, 0.1, {}, {}, state_s=1.0
    )
    paint_status(image, status_line(told, 0.1, 8.0))
    paint_notice(image, f"NO MAP: {letters}")
    assert time.monotonic() - begin_s < 5.0
    assert image.any()

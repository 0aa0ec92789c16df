"""Compose the status line: the checks' verdict, the filter, the height, the video.

The filter's state is shown, with its duration and reason, unless it is ``running``.
"""

from __future__ import annotations

import math

from tirgeo_ros.core.map.layers import Colour
from tirgeo_ros.core.overlay.text_boxes import NOTICE_BGR, Field
from tirgeo_ros.core.overlay.text_rendering import TEXT_BGR
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

_RTK_NAMES = {
    FixStatus.NONE: "none",
    FixStatus.SINGLE: "single",
    FixStatus.FLOAT: "float",
    FixStatus.FIXED: "fixed",
}
_METHODS = {
    "raw": "autopilot alone",
    "rtk": "RTK, autopilot's attitude",
    "ekf": "filter without heading",
    "ekf_heading": "filter",
}
_ORANGE_BGR: Colour = (60, 140, 255)
_RED_BGR: Colour = (100, 100, 255)
_COLOURS = {FilterState.DEAD_RECKONING: _ORANGE_BGR, FilterState.LOST: _RED_BGR}
#: Colour by the checks' verdict, in the status line and in the notice.
VERDICT_BGR = {Severity.NOTE: TEXT_BGR, Severity.CAUTION: NOTICE_BGR, Severity.STOP: _ORANGE_BGR}
_VERDICTS = {Severity.CAUTION: "CAUTION", Severity.STOP: "NO GO"}
_CLOCK_STEP_S = 0.02
_BELOW_M = 2.0  # tolerance: a camera on the landing gear, a ground height known to a metre


def words_of(state: FilterState) -> str:
    """Return a state's name as it is shown to a person."""
    return state.value.replace("_", " ")


def status_line(
    status: NavigationStatus | None,
    age_s: float,
    rate_hz: float,
    predicted_s: float = 0.0,
    dropped: int = 0,
    above_m: float = math.nan,
    verdict: Severity = Severity.NOTE,
) -> list[Field]:
    """Return the fields, left to right, for a frame of ``age_s``; ``rate_hz`` may be nan.

    ``predicted_s`` is how far the frame's pose was extrapolated, ``dropped`` the number of lost
    frames, ``above_m`` the camera's height above the ground, nan if unknown, and ``verdict`` that
    of the checks.
    """
    found = [Field(_VERDICTS[verdict], VERDICT_BGR[verdict])] if verdict else []
    mark = [Field(f"predicted {predicted_s * 1e3:.0f} ms", _ORANGE_BGR)] if predicted_s else []
    rate = "video starts" if math.isnan(rate_hz) else f"video {rate_hz:.1f} Hz"
    video = [Field(_age(age_s), spare=True), Field(rate, spare=True)]
    if dropped:
        video.append(Field(f"dropped {dropped}", spare=True))
    return [*found, *mark, *_filter_fields(status, _height_fields(above_m)), *video]


def _filter_fields(status: NavigationStatus | None, height: list[Field]) -> list[Field]:
    if status is None:
        return [Field("no filter status"), *height]
    sigma_deg = math.degrees(status.heading_sigma_rad)
    return [
        *_state_fields(status),  # first, because the first fields stay on a small picture
        Field(_METHODS.get(status.method, status.method)),
        Field(f"RTK {_RTK_NAMES[status.rtk_status]}"),
        *height,
        *([] if math.isnan(sigma_deg) else [Field(f"heading sigma {sigma_deg:.2f} deg")]),
    ]


def _state_fields(status: NavigationStatus) -> list[Field]:
    if status.state is FilterState.RUNNING:
        return []
    seconds = status.state_s
    span = f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"
    text = f"{words_of(status.state)} {span}"
    detail = f": {status.reason}" if status.reason else ""
    return [Field(text, _COLOURS.get(status.state, NOTICE_BGR), detail=detail)]


def _height_fields(above_m: float) -> list[Field]:
    if math.isnan(above_m):
        return []
    if above_m < -_BELOW_M:
        return [Field(f"{-above_m:.0f} m below ground", _ORANGE_BGR)]
    return [Field(f"{above_m:.0f} m above ground")]


def _age(age_s: float) -> str:
    if -_CLOCK_STEP_S < age_s < 0:  # a bag's clock moves in steps and may be behind the frame
        age_s = 0.0
    return f"age {age_s * 1e3:.0f} ms" if abs(age_s) < 10 else f"age {age_s:.0f} s"

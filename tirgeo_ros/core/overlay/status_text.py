"""The words under the picture: the checks' verdict, the filter, the height, the video.

The filter's state is shown, with its time and reason, where it is not ``running``.
"""

from __future__ import annotations

import math

from tirgeo_ros.core.overlay.text_boxes import NOTICE_BGR, Field
from tirgeo_ros.core.overlay.text_rendering import TEXT_BGR, Colour
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

_RTK_NAMES = {
    FixStatus.NONE: "none",
    FixStatus.SINGLE: "single",
    FixStatus.FLOAT: "float",
    FixStatus.FIXED: "fixed",
}
_ORANGE_BGR: Colour = (60, 140, 255)
_RED_BGR: Colour = (100, 100, 255)
_COLOURS = {FilterState.DEAD_RECKONING: _ORANGE_BGR, FilterState.LOST: _RED_BGR}
#: By the checks' verdict, of its notice too.
VERDICT_BGR = {Severity.NOTE: TEXT_BGR, Severity.CAUTION: NOTICE_BGR, Severity.STOP: _ORANGE_BGR}
_VERDICTS = {Severity.CAUTION: "CAUTION", Severity.STOP: "NO GO"}
_CLOCK_STEP_S = 0.02
_BELOW_M = 2.0  # a camera on the landing gear, a ground known to a metre


def words_of(state: FilterState) -> str:
    """The name of a state as it is shown to a person."""
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
    """The fields, left to right, for a frame of ``age_s``; ``rate_hz`` is nan at the first one.

    ``predicted_s`` is how far its pose is a prediction, ``dropped`` how many frames were lost,
    ``above_m`` how high the camera is above the ground, nan where that is not known, ``verdict``
    that of the checks.
    """
    found = [Field(_VERDICTS[verdict], VERDICT_BGR[verdict])] if verdict else []
    mark = [Field(f"predicted {predicted_s * 1e3:.0f} ms", _ORANGE_BGR)] if predicted_s else []
    video = [Field(_age(age_s), spare=True), Field(_rate(rate_hz), spare=True)]
    if dropped:
        video.append(Field(f"dropped {dropped}", spare=True))
    return [*found, *mark, *_filter_fields(status, _height_fields(above_m)), *video]


def _filter_fields(status: NavigationStatus | None, height: list[Field]) -> list[Field]:
    if status is None:
        return [Field("no filter status"), *height]
    return [
        *_state_fields(status),  # first: it stays where the picture is small
        Field(status.method),
        Field(f"RTK {_RTK_NAMES[status.rtk_status]}"),
        *height,
        *_heading_fields(math.degrees(status.heading_sigma_rad)),
    ]


def _state_fields(status: NavigationStatus) -> list[Field]:
    if status.state is FilterState.RUNNING:
        return []
    text = f"{words_of(status.state)} {_span(status.state_s)}"
    detail = f": {status.reason}" if status.reason else ""
    return [Field(text, _COLOURS.get(status.state, NOTICE_BGR), detail=detail)]


def _height_fields(above_m: float) -> list[Field]:
    if math.isnan(above_m):
        return []
    if above_m < -_BELOW_M:
        return [Field(f"{-above_m:.0f} m below ground", _ORANGE_BGR)]
    return [Field(f"{above_m:.0f} m above ground")]


def _heading_fields(sigma_deg: float) -> list[Field]:
    return [] if math.isnan(sigma_deg) else [Field(f"heading sigma {sigma_deg:.2f} deg")]


def _span(seconds: float) -> str:
    return f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.0f} min"


def _age(age_s: float) -> str:
    if -_CLOCK_STEP_S < age_s < 0:  # the clock of a bag has not come to the frame yet
        age_s = 0.0
    return f"age {age_s * 1e3:.0f} ms" if abs(age_s) < 10 else f"age {age_s:.0f} s"


def _rate(rate_hz: float) -> str:
    return "video starts" if math.isnan(rate_hz) else f"video {rate_hz:.1f} Hz"

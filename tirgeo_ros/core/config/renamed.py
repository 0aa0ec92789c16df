"""Parameters that have another name now, so that an old one is refused with what to write instead.

One table for files, for command lines and for whatever else goes through ``config_from``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import ClassVar

_ONCE = ", said once for all nodes under /**"
_DIRECTION = (
    f"is now the direction from aircraft.rtk_antenna_m to aircraft.second_antenna_m{_ONCE}"
)
_PLAYED = ("geoid_undulation_m", "gimbal", "layout", "clock_start_ms", "clock_drift_ppm", "pushes")

#: Old name of any node's parameter -> what is to be said of it.
RENAMED: Mapping[str, str] = {
    "rtk.lever_arm_m": f"is now aircraft.rtk_antenna_m{_ONCE}",
    "gps.lever_arm_m": f"is now aircraft.gps_antenna_m{_ONCE}",
    "lever_arm_m": f"is now aircraft.gimbal_pivot_m{_ONCE}",
    "camera_offset_m": f"is now aircraft.camera_from_pivot_m{_ONCE}",
    "heading.offset_deg": _DIRECTION,
    "heading.baseline_m": _DIRECTION,
    "heading.baseline_offset_deg": _DIRECTION,
    "aircraft.baseline_offset_deg": _DIRECTION,
    **{f"aircraft.{name}": f"is now simulated_aircraft.{name}" for name in _PLAYED},
}


class NodeParameters:
    """What every node's parameter tree begins with."""

    __slots__ = ()

    renamed: ClassVar[Mapping[str, str]] = RENAMED

"""Compute the direction of the RTK antennas' baseline, and check it against the flight.

RTK yaw is the azimuth of the line from the first antenna to the second. Its angle from the nose
follows from the positions of the two. It is wrong by 90 or 180 deg when the kit is mounted in
another way than the parameters say; the autopilot's own heading, right within some degrees, shows
this. It is reported, never corrected, because the autopilot's heading may be the wrong one.
"""

from __future__ import annotations

import cmath
import math
from collections import deque

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.heading import heading_of
from tirgeo_ros.dji.interpret.autopilot_attitude import AutopilotAttitudes

#: DJI's kits: the first antenna left, the second right.
KIT_DEG = 90.0
NOT_SET = (
    "aircraft.second_antenna_m is not set: RTK yaw is taken for that of DJI's kit, first antenna "
    "left and second right; set aircraft.rtk_antenna_m and aircraft.second_antenna_m"
)

#: The newest readings that are averaged; at least this time of them, at 5 Hz with some missing.
_SPAN_NS, _LEAST_NS, _LEAST_NUMBER = 20_000_000_000, 10_000_000_000, 30
#: Larger than the usual error of a compass, smaller than that of a baseline mounted another way.
_TOLERANCE_DEG = 15.0
#: Smallest length of the mean of unit vectors: below it the angles are spread by over 26 deg, and
#: their mean is no mounting angle.
_LEAST_AGREEMENT = 0.9


def baseline_deg(aircraft: AircraftConfig) -> float:
    """Return the direction from the first antenna to the second, from the nose, clockwise.

    DJI's kit where there is no second place. Raises ConfigError where the two give no heading.
    """
    known_deg = aircraft.baseline_deg
    return KIT_DEG if known_deg is None else known_deg


class BaselineCheck:
    """Average RTK yaw minus the aircraft's own heading over the newest 20 s.

    ``offset_deg``: the baseline's direction by the antennas' positions, clockwise from the nose.
    """

    def __init__(self, offset_deg: float, attitudes: AutopilotAttitudes) -> None:
        self._offset_deg, self._attitudes = offset_deg, attitudes
        self._seen: deque[tuple[int, complex]] = deque()  # stamp, unit vector

    def add(self, stamp_ns: int, yaw_rad: float) -> None:
        """Take the azimuth of a baseline (rad) whose flag is fixed."""
        q_nb = self._attitudes.near(stamp_ns)
        if q_nb is None:
            return
        seen = self._seen
        if seen and not 0 <= stamp_ns - seen[-1][0] <= _SPAN_NS:
            seen.clear()
        seen.append((stamp_ns, cmath.rect(1.0, yaw_rad - heading_of(q_nb))))
        while stamp_ns - seen[0][0] > _SPAN_NS:
            seen.popleft()

    @property
    def seen_deg(self) -> float | None:
        """Return the baseline's direction clockwise from the nose, 0 to 360 deg.

        Returns None until ten seconds of readings agree.
        """
        seen = self._seen
        if len(seen) < _LEAST_NUMBER or seen[-1][0] - seen[0][0] < _LEAST_NS:
            return None
        mean = sum(vector for _, vector in seen) / len(seen)
        return math.degrees(cmath.phase(mean)) % 360.0 if abs(mean) >= _LEAST_AGREEMENT else None

    @property
    def warning(self) -> str:
        """Return what to set right, or an empty text."""
        seen_deg = self.seen_deg
        off_deg = 0.0 if seen_deg is None else math.remainder(seen_deg - self._offset_deg, 360.0)
        if abs(off_deg) <= _TOLERANCE_DEG:
            return ""
        return (
            "by aircraft.rtk_antenna_m and aircraft.second_antenna_m the baseline lies at "
            f"{self._offset_deg % 360:.4g} deg from the nose, but RTK yaw less the aircraft's own "
            f"heading is {seen_deg:.1f} deg ({off_deg:+.1f}): correct the two places, or look "
            "after the aircraft's compass"
        )

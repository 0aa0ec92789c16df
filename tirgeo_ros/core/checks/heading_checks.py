"""Check the dual-antenna heading: offset, sign, unit, and whether it changes at all.

Changes of the heading over a second are compared with the gyroscopes' rotation about the vertical.
The heading itself is compared with the autopilot's, or without an autopilot with the course.
"""

from __future__ import annotations

import math
from collections import deque
from typing import NamedTuple

from tirgeo_ros.core.checks.imu_blocks import ImuMean
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.heading import azimuth, wrapped
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Vector
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import HeadingSample, VelocitySample

_KEPT_S = 3.0  # of IMU blocks: as long as a heading may be late
_PAIR_NS = 1_000_000_000
_LONGEST_PAIR_NS = 3_000_000_000
#: A smaller change is ignored: headings in whole degrees change by one degree by rounding.
_TURNED_RAD = math.radians(5)
_LEAST_TURNED_RAD = math.radians(40)  # sum of the turns that is needed for a finding
#: Largest rms residual of the turns under a correct explanation, relative to the turns' rms.
_EXPLAINED = 0.3
#: Rms difference between changes of heading and of the gyroscopes at which the heading jumps.
_JUMPING_RAD = math.radians(15)
_MEMORY = 100  # samples of a running mean
_LEAST_NUMBER, _LEAST_CONSTANT = 15, 0.9  # samples; length of the mean unit vector (26 deg rms)
#: A compass errs by 10 deg near steel or without its declination.
_OFF_RAD, _WRONG_RAD = math.radians(15), math.radians(45)
_SIGMAS = 5.0
_QUARTER_RAD = math.radians(20)  # an offset within this of a multiple of 90 deg is that multiple
_FORWARD_M_S, _LEAST_COURSES = 2.0, 100
_SECOND = "ekf_node aircraft.second_antenna_m"


class _Turn(NamedTuple):
    turned_rad: float  # rotation about the vertical, by the gyroscopes since the start
    autopilot_rad: float  # the autopilot's heading; nan without


class _Circle:
    """Track the running mean of directions."""

    def __init__(self) -> None:
        self.number = 0
        self._cosine = self._sine = 0.0

    def add(self, angle_rad: float) -> None:
        self.number += 1
        share = 1 / min(self.number, _MEMORY)
        self._cosine += share * (math.cos(angle_rad) - self._cosine)
        self._sine += share * (math.sin(angle_rad) - self._sine)

    @property
    def mean_rad(self) -> float:
        return math.atan2(self._sine, self._cosine)

    @property
    def constant(self) -> bool:
        return math.hypot(self._cosine, self._sine) > _LEAST_CONSTANT


class HeadingChecks:
    """Check headings against blocks of the IMU and velocities."""

    def __init__(self, config: EkfConfig) -> None:
        self._rotation_bi = config.aircraft.rotation_bi
        sigma_rad = math.radians(config.autopilot.attitude_sigma_deg[2])
        self._off_rad = max(_OFF_RAD, _SIGMAS * sigma_rad)
        self._turns: StampedBuffer[_Turn] = StampedBuffer(_KEPT_S)
        self._turned_rad = 0.0
        self._waiting: deque[HeadingSample] = deque(maxlen=20)
        self._before: tuple[HeadingSample, float] | None = None  # with the rotation at its stamp
        self._autopilot, self._course = _Circle(), _Circle()
        self._newest: HeadingSample | None = None
        # over pairs: |turn|; squares of gyro turn and of heading change; product
        self._sum = dict.fromkeys(("turned", "gyro", "own", "both"), 0.0)
        self._pairs = 0

    def block(self, block: ImuMean) -> None:
        """Take the next block of the IMU."""
        rate_b = block.rate_b
        if self._rotation_bi is not None:
            x, y, z = (self._rotation_bi @ rate_b).tolist()
            rate_b = x, y, z
        down_b: Vector = (0.0, 0.0, 1.0)
        autopilot_rad = math.nan
        if block.autopilot_q_nb is not None and usable_attitude(block.autopilot_q_nb):
            rotation = rotation_of(block.autopilot_q_nb.tolist())
            down_b = rotation[6:9]
            autopilot_rad = azimuth((rotation[0], rotation[3], 0.0))
        if not block.joined:
            self._turns.clear()
            self._before = None
        self._turned_rad += block.step_s * sum(a * b for a, b in zip(rate_b, down_b, strict=True))
        self._turns.put(block.stamp_ns, _Turn(self._turned_rad, autopilot_rad))
        while self._waiting and self._waiting[0].stamp_ns <= block.stamp_ns:
            self._match(self._waiting.popleft())

    def heading(self, sample: HeadingSample) -> None:
        """Take a heading; it waits until the IMU's blocks reach its stamp."""
        if math.isfinite(sample.heading_rad):
            self._newest = sample
            self._waiting.append(sample)
            if sample.stamp_ns <= (self._turns.newest_ns or 0):
                self._match(self._waiting.pop())

    def velocity(self, sample: VelocitySample) -> None:
        """Take a velocity; its course is used where there is no autopilot."""
        north, east = sample.velocity_n.tolist()[:2]
        if self._newest is not None and math.hypot(north, east) > _FORWARD_M_S:
            self._course.add(self._newest.heading_rad - azimuth((north, east)))

    def _match(self, sample: HeadingSample) -> None:
        around = self._turns.around(sample.stamp_ns)
        if isinstance(around, Miss):
            return
        first, last, share = around
        turned_rad = first.turned_rad + share * (last.turned_rad - first.turned_rad)
        if not math.isnan(last.autopilot_rad):
            self._autopilot.add(sample.heading_rad - last.autopilot_rad)
        if self._before is None or sample.stamp_ns <= self._before[0].stamp_ns:
            self._before = sample, turned_rad
        elif sample.stamp_ns - self._before[0].stamp_ns >= _PAIR_NS:
            before, turned_before = self._before
            self._before = sample, turned_rad
            if sample.stamp_ns - before.stamp_ns < _LONGEST_PAIR_NS:
                change = wrapped(sample.heading_rad - before.heading_rad)
                self._pair(change, turned_rad - turned_before)

    def _pair(self, change: float, turned: float) -> None:
        self._pairs += 1
        sums = self._sum
        if abs(turned) < _TURNED_RAD and abs(change) < _TURNED_RAD:
            return
        sums["turned"] += abs(turned)
        sums["gyro"] += turned * turned
        sums["own"] += change * change
        sums["both"] += change * turned

    def findings(self) -> list[Finding]:
        """Return a fault of the heading's changes, or if they are right, of its mean."""
        found = self._changing() or self._offset()
        return [found] if found else []

    def _changing(self) -> Finding | None:
        sums = self._sum
        # Differences are not wrapped: nothing that flies turns 180 deg/s.
        unlike = max(sums["own"] + sums["gyro"] - 2 * sums["both"], 0.0)
        if unlike <= _EXPLAINED**2 * sums["gyro"]:
            return None  # the heading turns as the gyroscopes do
        evidence = f"while the gyroscopes turned by {math.degrees(sums['turned']):.0f} deg"
        long = sums["turned"] > _LEAST_TURNED_RAD
        if long and sums["own"] < 1e-12:
            text = f"{evidence}, rtk/heading stayed the same"
            return _stop("heading_stuck", text, "the receiver or its driver repeats one value")
        slope = sums["both"] / sums["own"] if sums["own"] > 0 else 0.0  # gyroscope turn / change
        left = sums["gyro"] - slope * sums["both"]
        explained = long and left < _EXPLAINED**2 * sums["gyro"]
        if explained and -1.3 < slope < -0.7:
            text = f"{evidence}, rtk/heading turned the other way (slope {1 / slope:+.2f})"
            mend = "its yaw must be ENU, counter-clockwise from east: 90 deg less the azimuth"
            return _stop("heading_sign", text, mend)
        if explained and not 0.7 < slope < 1.3:
            text = f"{evidence}, rtk/heading turned by {1 / slope:+.3f} of that"
            where = "imu/data angular_velocity, rtk/heading"
            return _stop(
                "heading_unit", text, "is one of both in degrees? Both are in radians", where
            )
        rms = math.sqrt(unlike / max(self._pairs, 1))
        if self._pairs >= 8 and rms > _JUMPING_RAD:
            text = f"rtk/heading jumps by {math.degrees(rms):.0f} deg a second {evidence}"
            mend = "degrees for radians in its quaternion, or a receiver without a solution"
            return _stop("heading_jumps", text, mend)
        return None

    def _offset(self) -> Finding | None:
        circle, name = self._autopilot, "the autopilot's heading"
        if not circle.number:
            circle, name = self._course, "the course over ground"
            if circle.number < _LEAST_COURSES or self._sum["turned"] < _LEAST_TURNED_RAD:
                return None
        off = circle.mean_rad
        if circle.number < _LEAST_NUMBER or not circle.constant or abs(off) < self._off_rad:
            return None
        evidence = f"rtk/heading is {math.degrees(off):+.0f} deg from {name}"
        quarter = math.pi / 2 * round(off / (math.pi / 2))
        if abs(off) < _WRONG_RAD or (circle is self._course and abs(off) < _OFF_RAD * 3):
            mend = "measure both antennas; or is it the compass, or its declination?"
            return Finding("heading_offset", Severity.CAUTION, evidence, _SECOND, mend)
        if abs(off - quarter) > _QUARTER_RAD:
            mend = "measure both antennas; or is its yaw not ENU (90 deg less the azimuth)?"
        elif abs(quarter) > 2:
            mend = "the antennas are swapped: exchange rtk_antenna_m and second_antenna_m"
        else:
            mend = "the baseline lies across: measure both antennas, or take out a constant of 90"
        return _stop("heading_offset", evidence, mend, _SECOND)


def _stop(check: str, evidence: str, mend: str, where: str = "rtk/heading") -> Finding:
    return Finding(check, Severity.STOP, evidence, where, mend)

"""Turn an autopilot's tables to samples: the IMU with attitudes, and the satellite receiver."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import slerp
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
    PressureSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.logs.log_contents import LogContents, say_receiver

#: No attitude is interpolated between two further apart than this, the limit of gimbal_node too.
_LONGEST_GAP_NS = 250_000_000
#: Memory to read a log with: an hour at 250 Hz takes a third of it.
LOG_BYTES = 2 << 30
#: Microseconds that are a date of this century, not a time since the autopilot was switched on.
_UNIX_US = 946_684_800_000_000
#: Fix types of MAVLink, which PX4 and ArduPilot log: 4 differential, 5 RTK float, 6 RTK fixed.
_FIXES = {3: FixStatus.SINGLE, 4: FixStatus.FLOAT, 5: FixStatus.FLOAT, 6: FixStatus.FIXED}
_RTK_FIXES = (5, 6)
LEAST_FIX = min(_FIXES)
#: Why records are refused.
OTHER_INSTANCE = "of another instance than the one taken"


@dataclass(frozen=True)
class ImuTable:
    """Hold N readings in body FRD: specific force (m/s2), angular rate (rad/s); clock in us."""

    time_us: IntArray
    force_b: Array  # (N, 3)
    rate_b: Array  # (N, 3)


@dataclass(frozen=True)
class AttitudeTable:
    """Hold N attitudes of the autopilot, body FRD to NED; clock in us."""

    time_us: IntArray
    q_nb: Array  # (N, 4) wxyz


@dataclass(frozen=True)
class GnssTable:
    """Hold N records of a satellite receiver; clock in us; NaN where there is no value."""

    time_us: IntArray
    utc_us: IntArray  # Unix time by the receiver; 0 or less: not known yet
    fix: IntArray  # MAVLink's GPS_FIX_TYPE
    latitude_rad: Array
    longitude_rad: Array
    height_m: Array  # ellipsoidal
    sigma_m: Array  # (N, 2) horizontal, vertical
    velocity_n: Array  # (N, 3) m/s
    velocity_sigma_m_s: Array
    heading_rad: Array  # of the nose, from two antennas
    heading_sigma_rad: Array


@dataclass(frozen=True)
class AutopilotClock:
    """Hold what an autopilot's clock lacks to UTC."""

    shift_us: int

    @classmethod
    def by_receiver(
        cls, gnss: GnssTable | None, first_us: int, contents: LogContents
    ) -> AutopilotClock:
        """Return the clock by the receiver's UTC; note its spread, or that there is none.

        ``first_us`` is a time of the autopilot's clock.
        """
        shifts_us = np.empty(0, np.int64)
        if gnss is not None:
            shifts_us = (gnss.utc_us - gnss.time_us)[_dated(gnss)]
        if len(shifts_us):
            spread_ms = float(np.ptp(shifts_us)) * 1e-3
            contents.notes.append(
                f"stamps are the autopilot's clock plus the median of {len(shifts_us)} "
                f"differences to the receiver's UTC, which spread over {spread_ms:.0f} ms"
            )
            return cls(int(np.median(shifts_us)))
        contents.notes.append(
            "no receiver tells UTC: the autopilot's own clock, a date, is used"
            if first_us > _UNIX_US
            else "no receiver tells UTC: times count from the autopilot's start, in 1970"
        )
        return cls(0)

    def unix_ns(self, time_us: IntArray) -> IntArray:
        """Return ns of Unix time."""
        return (time_us + self.shift_us) * 1000


def _dated(gnss: GnssTable) -> BoolArray:
    """Return which records (N,) tell UTC: of those with a fix, if any has one.

    Before it, a receiver tells what its own clock counted since it was last switched on.
    """
    dated = gnss.utc_us > 0
    fixed = dated & np.isin(gnss.fix, list(_FIXES))
    return fixed if fixed.any() else dated


def imu_samples(
    clock: AutopilotClock, imu: ImuTable, attitude: AttitudeTable | None
) -> Iterator[ImuSample]:
    """Yield the readings of an IMU, each with the autopilot's attitude at its time."""
    stamps_ns = clock.unix_ns(imu.time_us)
    known = [None] * len(stamps_ns) if attitude is None else _at(imu.time_us, attitude)
    rows = zip(stamps_ns.tolist(), imu.force_b, imu.rate_b, known, strict=True)
    return (ImuSample(*row) for row in rows)


def pressure_samples(
    clock: AutopilotClock, time_us: IntArray, pressures_pa: Array
) -> Iterator[PressureSample]:
    """Yield the readings of a barometer, whose variance is not known."""
    for stamp_ns, pressure_pa in zip(clock.unix_ns(time_us), pressures_pa, strict=True):
        yield PressureSample(int(stamp_ns), float(pressure_pa), 0.0)


def _at(time_us: IntArray, attitude: AttitudeTable) -> list[Array | None]:
    """Return the attitude (4,) at each time, interpolated; None beyond a gap or the ends."""
    usable = np.array([usable_attitude(q) for q in attitude.q_nb], bool)
    usable &= ~lone_stamps(attitude.time_us * 1000)
    known_us, q_nb = attitude.time_us[usable], attitude.q_nb[usable]
    order = np.argsort(known_us, kind="stable")
    known_us, q_nb = known_us[order], q_nb[order]
    found: list[Array | None] = []
    for at_us, after in zip(time_us.tolist(), np.searchsorted(known_us, time_us), strict=True):
        if after < len(known_us) and known_us[after] == at_us:
            found.append(q_nb[after])
            continue
        if not 0 < after < len(known_us):
            found.append(None)
            continue
        step_us = int(known_us[after] - known_us[after - 1])
        fraction = (at_us - int(known_us[after - 1])) / step_us
        near = step_us * 1000 <= _LONGEST_GAP_NS
        found.append(slerp(q_nb[after - 1], q_nb[after], fraction) if near else None)
    return found


def add_gnss(contents: LogContents, clock: AutopilotClock, name: str, gnss: GnssTable) -> None:
    """Add a receiver's positions, velocities and headings."""
    stamps_ns = clock.unix_ns(gnss.time_us).tolist()
    for row, (stamp_ns, fix) in enumerate(zip(stamps_ns, gnss.fix.tolist(), strict=True)):
        if fix not in _FIXES:
            contents.refused[name, f"fix type {fix}: no position in three dimensions"] += 1
            continue
        contents.samples += _samples_of(gnss, row, stamp_ns, _FIXES[fix])
    say_receiver(contents, name, is_rtk=bool(np.isin(gnss.fix, _RTK_FIXES).any()))


def _samples_of(
    gnss: GnssTable, row: int, stamp_ns: int, status: FixStatus
) -> Iterator[NavigationInput]:
    """Yield what a record of a receiver with a fix holds."""
    horizontal, vertical = _known(gnss.sigma_m[row, 0]) ** 2, _known(gnss.sigma_m[row, 1]) ** 2
    yield PositionSample(
        stamp_ns,
        Source.RTK_POSITION,
        status,
        float(gnss.latitude_rad[row]),
        float(gnss.longitude_rad[row]),
        float(gnss.height_m[row]),
        np.diag([horizontal, horizontal, vertical]),
    )
    if not np.isnan(gnss.velocity_n[row]).any():
        yield VelocitySample(
            stamp_ns,
            Source.RTK_VELOCITY,
            gnss.velocity_n[row],
            np.eye(3) * _known(gnss.velocity_sigma_m_s[row]) ** 2,
        )
    if not np.isnan(gnss.heading_rad[row]):
        heading_rad = float(gnss.heading_rad[row] % (2 * np.pi))
        yield HeadingSample(stamp_ns, heading_rad, _known(gnss.heading_sigma_rad[row]) ** 2)


def _known(sigma: float) -> float:
    """Return a sigma; 0, which means unknown, for what cannot be one."""
    return float(sigma) if 0 < sigma < np.inf else 0.0


def antenna_note(parameter: str, place_frd_m: Sequence[float]) -> Iterator[str]:
    """Yield where the log says that the antenna is, unless that is at the IMU."""
    if any(place_frd_m):
        forward, left, up = (flu_from_frd(np.array(place_frd_m)) + 0.0).tolist()  # no -0
        yield (
            f"{parameter}: the antenna is at [{forward:g}, {left:g}, {up:g}] (forward, left, up); "
            "set aircraft.gps_antenna_m, or rtk_antenna_m"
        )


def delay_note(parameter: str, delay_ms: float) -> Iterator[str]:
    """Yield what the autopilot took for the receiver's delay, unless that is none."""
    if delay_ms:
        yield (
            f"{parameter} is {delay_ms:g} ms, which stamps still have: set gps.delay_s, or "
            f"rtk.delay_s, to {delay_ms * 1e-3:g}"
        )

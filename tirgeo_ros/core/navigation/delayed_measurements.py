"""Define the filter's time line: IMU epochs, and the measurements between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from tirgeo_ros.core.navigation.aiding.aid_status import PLACE, AidStatus
from tirgeo_ros.core.navigation.aiding.state_estimate import AidSample, StateEstimate
from tirgeo_ros.core.navigation.smoothing.trail import Mark
from tirgeo_ros.core.navigation.strapdown import NavState, Rates
from tirgeo_ros.core.navigation.vibration_noise import STILL, Powers, VibrationMeter
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict


class Carried(NamedTuple):
    """Hold a filter state, and a covariance that is older by ``lag_s`` and is propagated later."""

    state: NavState
    covariance: Array
    control: AidStatus
    lag_s: float = 0.0
    start: NavState | None = None  # the state at the covariance's time
    rates: Rates | None = None  # near the middle of the lag
    vibration: Powers = STILL  # IMU noise of the last seconds
    trail: Mark | None = None  # what led to the covariance, where a smoother needs it

    @property
    def belief(self) -> StateEstimate:
        """Return state, covariance and aid records; the covariance is not propagated."""
        return StateEstimate(self.state, self.covariance, self.control)


@dataclass(slots=True, eq=False)
class HistoryRecord:
    """Hold a measurement, its place on the time line, and the newest verdict on it."""

    stamp_ns: int
    order: tuple[int, int]  # sort key: stamp, then a fixed order of the sources
    source: Source
    sample: AidSample
    stale: bool = False  # it repeats the value of the one before
    held: bool = False  # it arrived before the IMU sample that reaches its stamp
    verdict: Verdict | None = None

    @property
    def applied(self) -> bool:
        """Return whether it was, or is still to be, given to the filter: all but STANDBY."""
        return self.verdict is None or self.verdict.outcome is not Outcome.STANDBY

    @classmethod
    def of(cls, sample: AidSample, *, stale: bool = False) -> HistoryRecord:
        """Return the record of a sample."""
        order = sample.stamp_ns, PLACE[sample.source]
        return cls(sample.stamp_ns, order, sample.source, sample, stale)


@dataclass(slots=True, eq=False)
class Epoch:
    """Hold an IMU sample, the interval that ends with it, and the filter's state at its stamp."""

    stamp_ns: int
    force_b: Vector  # m/s2
    rate_b: Vector  # rad/s
    carried: Carried
    step_s: float = 0.0  # length of the interval
    mean_force_b: Vector = (0.0, 0.0, 0.0)
    mean_rate_b: Vector = (0.0, 0.0, 0.0)
    vibration: Powers = STILL
    autopilot_q_nb: Array | None = None
    records: list[HistoryRecord] = field(default_factory=list)  # of the interval, in order

    @classmethod
    def first(cls, stamp_ns: int, sample: ImuSample, belief: StateEstimate) -> Epoch:
        """Return the filter's first epoch; ``sample`` is the newest one up to its stamp."""
        force, rate = sample.specific_force_b.tolist(), sample.angular_rate_b.tolist()
        return cls(stamp_ns, tuple(force), tuple(rate), Carried(*belief[:3]))

    @classmethod
    def after(cls, before: Epoch, sample: ImuSample, meter: VibrationMeter) -> Epoch:
        """Return the epoch of the next sample; ``carried`` is still that of the epoch before."""
        force: Vector = tuple(sample.specific_force_b.tolist())
        rate: Vector = tuple(sample.angular_rate_b.tolist())
        step_s = (sample.stamp_ns - before.stamp_ns) * 1e-9
        fx, fy, fz = force
        wx, wy, wz = rate
        gx, gy, gz = before.force_b
        vx, vy, vz = before.rate_b
        return cls(
            sample.stamp_ns,
            force,
            rate,
            before.carried,
            step_s,
            (0.5 * (gx + fx), 0.5 * (gy + fy), 0.5 * (gz + fz)),
            (0.5 * (vx + wx), 0.5 * (vy + wy), 0.5 * (vz + wz)),
            meter.add(step_s, force, rate),
            sample.autopilot_q_nb,
        )


def between(start: Epoch, end: Epoch, stamp_ns: int) -> tuple[Vector, Vector]:
    """Return specific force (m/s2) and angular rate (rad/s) in ``b``, interpolated linearly."""
    share = (stamp_ns - start.stamp_ns) / (end.stamp_ns - start.stamp_ns)
    (x, y, z), (p, q, r) = start.force_b, start.rate_b
    (fx, fy, fz), (wx, wy, wz) = end.force_b, end.rate_b
    force_b = x + share * (fx - x), y + share * (fy - y), z + share * (fz - z)
    return force_b, (p + share * (wx - p), q + share * (wy - q), r + share * (wz - r))


def put(records: list[HistoryRecord], record: HistoryRecord) -> bool:
    """Insert a record in order; return False where its source and stamp are there already."""
    at = len(records)
    while at and records[at - 1].order > record.order:
        at -= 1
    if at and records[at - 1].order == record.order:
        return False
    records.insert(at, record)
    return True

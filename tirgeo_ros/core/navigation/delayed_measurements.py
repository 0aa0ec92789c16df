"""The time line of the filter: IMU samples, and the measurements between them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

from tirgeo_ros.core.navigation.aiding.aid_status import PLACE, Control
from tirgeo_ros.core.navigation.aiding.filter_state import Aidlike, Belief, source_of
from tirgeo_ros.core.navigation.strapdown import NavState, Rates, Vector
from tirgeo_ros.core.navigation.vibration_meter import STILL, Powers, VibrationMeter
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict


class Carried(NamedTuple):
    """A belief whose covariance is behind by ``lag_s``, and what it needs to follow."""

    state: NavState
    covariance: Array
    control: Control
    lag_s: float = 0.0
    start: NavState | None = None  # the state that the covariance belongs to
    rates: Rates | None = None  # about the middle of the lag
    vibration: Powers = STILL  # of the IMU, lately

    @property
    def belief(self) -> Belief:
        """What is believed."""
        return Belief(self.state, self.covariance, self.control)


@dataclass(slots=True, eq=False)
class Record:
    """A measurement with its place, and what became of it."""

    stamp_ns: int
    order: tuple[int, int]  # of one instant, always in the same order
    source: Source
    sample: Aidlike
    stale: bool = False  # it says what the one before said
    held: bool = False  # it came before the IMU reached it
    verdict: Verdict | None = None

    @property
    def applied(self) -> bool:
        """Whether it has entered the belief, or tried to."""
        return self.verdict is None or self.verdict.outcome is not Outcome.STANDBY

    @classmethod
    def of(cls, sample: Aidlike, *, stale: bool = False) -> Record:
        """The record of a sample."""
        source = source_of(sample)
        return cls(sample.stamp_ns, (sample.stamp_ns, PLACE[source]), source, sample, stale)


@dataclass(slots=True, eq=False)
class Epoch:
    """An IMU sample, the interval that ends with it, and what is believed then."""

    stamp_ns: int
    force_b: Vector  # m/s2
    rate_b: Vector  # rad/s
    carried: Carried
    step_s: float = 0.0  # length of the interval
    mean_force_b: Vector = (0.0, 0.0, 0.0)
    mean_rate_b: Vector = (0.0, 0.0, 0.0)
    vibration: Powers = STILL
    autopilot_q_nb: Array | None = None
    records: list[Record] = field(default_factory=list)  # of the interval, in order

    @classmethod
    def first(cls, stamp_ns: int, sample: ImuSample, belief: Belief) -> Epoch:
        """The epoch to start from, with the newest sample up to its stamp."""
        force, rate = sample.specific_force_b.tolist(), sample.angular_rate_b.tolist()
        return cls(stamp_ns, tuple(force), tuple(rate), Carried(*belief))

    @classmethod
    def after(cls, before: Epoch, sample: ImuSample, meter: VibrationMeter) -> Epoch:
        """The epoch of the next sample; its belief is yet that of the epoch before."""
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
    """Force and rate at a time between two samples, linearly."""
    share = (stamp_ns - start.stamp_ns) / (end.stamp_ns - start.stamp_ns)
    return mixed(start.force_b, end.force_b, share), mixed(start.rate_b, end.rate_b, share)


def mixed(a: Vector, b: Vector, share: float) -> Vector:
    """From one vector so far towards another."""
    x, y, z = a
    return x + share * (b[0] - x), y + share * (b[1] - y), z + share * (b[2] - z)


def put(records: list[Record], record: Record) -> bool:
    """Put a record in its place; not where one of its source and stamp stands already."""
    at = len(records)
    while at and records[at - 1].order > record.order:
        at -= 1
    if at and records[at - 1].order == record.order:
        return False
    records.insert(at, record)
    return True

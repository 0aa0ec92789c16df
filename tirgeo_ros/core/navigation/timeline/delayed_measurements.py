"""Define the filter's time line: IMU epochs, and the measurements between them."""

from __future__ import annotations

from dataclasses import dataclass, field

from tirgeo_ros.core.navigation.aiding.aid_status import PLACE, AidStatus, Receivers
from tirgeo_ros.core.navigation.aiding.state_estimate import AidSample, StateEstimate
from tirgeo_ros.core.navigation.ins.propagation import Epoch, Propagated
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.core.types.verdicts import Outcome, Verdict


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
class FilterEpoch(Epoch):
    """Add to an epoch the records of the aids at its stamp, and its interval's measurements."""

    aids: AidStatus = AidStatus(Receivers(0))
    records: list[HistoryRecord] = field(default_factory=list)  # of the interval, in order

    @classmethod
    def of_start(cls, stamp_ns: int, sample: ImuSample, start: StateEstimate) -> FilterEpoch:
        """Return the filter's first epoch; ``sample`` is the newest one up to its stamp."""
        epoch = cls.first(stamp_ns, sample, Propagated(start.state, start.covariance))
        epoch.aids = start.aids
        return epoch

    @property
    def estimate(self) -> StateEstimate:
        """Return state, covariance and aid records; the covariance may be 50 ms older."""
        return StateEstimate(self.propagated.state, self.propagated.covariance, self.aids)


def put(records: list[HistoryRecord], record: HistoryRecord) -> bool:
    """Insert a record in order; return False where its source and stamp are there already."""
    at = len(records)
    while at and records[at - 1].order > record.order:
        at -= 1
    if at and records[at - 1].order == record.order:
        return False
    records.insert(at, record)
    return True

"""The error-state Kalman filter on the IMU, with a history for measurements that come late.

Epochs (IMU samples) and measurements lie on one time line. Each epoch keeps the state and
covariance after every measurement up to its stamp, so a late measurement only has to be put in its
place and the epochs after it computed again: the result is the one that timely arrival gives.
"""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.aiding.fusion import Aiding, Fusion, source_of
from tirgeo_ros.core.alignment import Alignment
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.error_state import (
    ATTITUDE,
    GYRO_BIAS,
    POSITION,
    STATES,
    VELOCITY,
    CovariancePropagation,
)
from tirgeo_ros.core.samples import (
    Array,
    ImuSample,
    NavSolution,
    Outcome,
    PositionSample,
    Source,
    Verdict,
)
from tirgeo_ros.core.strapdown import NavState, Rates, Vector, propagate

#: The state is never carried further than this in one step.
_LARGEST_STEP_S = 0.02
#: The covariance follows the state in steps of at least this, and at every measurement.
_COVARIANCE_STEP_S = 0.0195
_ORDER = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
_SOLUTION_ROWS = np.r_[POSITION, ATTITUDE, VELOCITY]
#: Where a solution's covariance (9, 9) stands in the filter's, counted row by row.
_SOLUTION_ENTRIES = STATES * _SOLUTION_ROWS[:, None] + _SOLUTION_ROWS


class _Belief(NamedTuple):
    """State and covariance, the latter behind by ``lag_s`` and ready to follow."""

    state: NavState
    covariance: Array
    lag_s: float = 0.0
    before: NavState | None = None  # at the start of the state's last step
    rates: Rates | None = None  # of that step


@dataclass(slots=True)
class _Epoch:
    stamp_ns: int
    force_b: Vector
    rate_b: Vector
    belief: _Belief


@dataclass(slots=True, eq=False)
class _Record:
    stamp_ns: int
    sample: Aiding
    held: bool  # it came before the IMU reached it
    verdict: Verdict | None = None
    offset_n: Array = field(default_factory=lambda: np.full(3, np.nan))  # see Fusion

    @property
    def order(self) -> tuple[int, int]:
        """The place on the time line; of one instant, always in the same order."""
        return self.stamp_ns, _ORDER.index(source_of(self.sample))


@dataclass(frozen=True, slots=True)
class _Pause:
    """The belief after the last measurement of an interval, from where one more goes on.

    A receiver's position, velocity and heading come one after the other with one stamp; without
    this each would compute the ones before it again.
    """

    start_ns: int  # the interval's first epoch
    order: tuple[int, int]  # of the last measurement in the belief
    applied: int  # measurements of the interval in the belief
    belief: _Belief


class Ekf:
    """The filter from its alignment on. Samples must be finite (see ``navigation``)."""

    def __init__(self, config: EkfConfig, alignment: Alignment) -> None:
        self._propagation = CovariancePropagation(config.imu)
        self._fusion = Fusion(config)
        self._rate_density = np.square(config.imu.angle_random_walk).tolist()
        self._window = config.rtk.median_window
        self._keep_ns = round(config.max_delay_s * 1e9)
        belief = _Belief(alignment.state, alignment.covariance)
        self._epochs = [_Epoch(alignment.stamp_ns, *_readings(alignment.imu[0]), belief)]
        self._records: list[_Record] = []
        self._resolved: list[Verdict] = []
        self._pause: _Pause | None = None
        self._done = 0  # index of the newest epoch whose state is up to date

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest IMU sample."""
        return self._epochs[-1].stamp_ns

    def add_imu(self, sample: ImuSample) -> None:
        """Carry the state to an IMU sample, which must be newer than all before."""
        last = self._epochs[-1]
        self._epochs.append(_Epoch(sample.stamp_ns, *_readings(sample), last.belief))
        self._catch_up(len(self._epochs) - 1)
        self._forget()

    def add_aiding(self, sample: Aiding) -> Verdict:
        """Put a measurement in its place; one that the IMU has not reached yet is held."""
        source = source_of(sample)
        if sample.stamp_ns <= max(self._epochs[0].stamp_ns, self.newest_ns - self._keep_ns):
            return Verdict(source, Outcome.TOO_OLD, "older than max_delay_s or the alignment")
        if sample.stamp_ns > self.newest_ns + self._keep_ns:
            return Verdict(source, Outcome.TOO_NEW, "newer than imu/data")
        same = (r for r in self._records if r.stamp_ns == sample.stamp_ns)
        if any(source_of(r.sample) is source for r in same):
            return Verdict(source, Outcome.REPEATED)
        record = _Record(sample.stamp_ns, sample, held=sample.stamp_ns > self.newest_ns)
        bisect.insort(self._records, record, key=lambda r: r.order)
        if record.held:
            return Verdict(source, Outcome.WAITING, "held until imu/data reaches it")
        before = bisect.bisect_left(self._epochs, sample.stamp_ns, key=lambda e: e.stamp_ns) - 1
        self._done = min(self._done, before)
        if self._pause is not None and self._pause.order > record.order:
            self._pause = None
        self._catch_up(before + 1)
        assert record.verdict is not None
        return record.verdict

    def take_resolved(self) -> list[Verdict]:
        """Verdicts on measurements that were held, since the last call."""
        found, self._resolved = self._resolved, []
        return found

    def solution(self) -> NavSolution:
        """The state at the newest IMU sample."""
        state, covariance = self.state()
        return NavSolution(
            self.newest_ns,
            state.latitude_rad,
            state.longitude_rad,
            state.height_m,
            np.array(state.velocity_n),
            np.array(state.q_nb),
            np.subtract(self._epochs[-1].rate_b, state.gyro_bias_b),
            self._rate_variance_b(covariance),
            covariance.take(_SOLUTION_ENTRIES),
        )

    def _rate_variance_b(self, covariance: Array) -> Vector:
        """White noise of one reading, and the bias's uncertainty; (rad/s)^2."""
        x, y, z = self._rate_density
        first = self._epochs[0]
        step_s = (self.newest_ns - first.stamp_ns) * 1e-9 / max(len(self._epochs) - 1, 1)
        bias = covariance[GYRO_BIAS, GYRO_BIAS].diagonal().tolist()
        if step_s == 0:  # one sample has no rate
            return bias[0], bias[1], bias[2]
        return x / step_s + bias[0], y / step_s + bias[1], z / step_s + bias[2]

    def state(self) -> tuple[NavState, Array]:
        """Nominal state and (15, 15) covariance at the newest IMU sample.

        The covariance may be up to 20 ms older than the state.
        """
        self._catch_up(len(self._epochs) - 1)
        belief = self._epochs[-1].belief
        return belief.state, belief.covariance

    def _catch_up(self, index: int) -> None:
        while self._done < index:
            self._advance(self._epochs[self._done], self._epochs[self._done + 1])
            self._done += 1

    def _advance(self, start: _Epoch, end: _Epoch) -> None:
        """State of ``end`` from that of ``start`` and the measurements in between."""
        pause = self._pause
        if pause is None or pause.start_ns != start.stamp_ns:
            pause = _Pause(start.stamp_ns, (start.stamp_ns, 0), 0, start.belief)
        belief, now_ns = pause.belief, pause.order[0]
        for record in self._after(start.stamp_ns)[pause.applied :]:
            if record.stamp_ns > end.stamp_ns:
                break
            belief = self._carry(belief, start, end, now_ns, record.stamp_ns)
            now_ns = record.stamp_ns
            belief = self._apply(record, belief, _between(start, end, now_ns)[1])
            pause = _Pause(start.stamp_ns, record.order, pause.applied + 1, belief)
        self._pause = pause if pause.applied else None
        end.belief = self._carry(belief, start, end, now_ns, end.stamp_ns)

    def _after(self, stamp_ns: int) -> list[_Record]:
        """Measurements later than a stamp."""
        if not self._records or self._records[-1].stamp_ns <= stamp_ns:
            return []  # at most IMU samples
        first = bisect.bisect_right(self._records, stamp_ns, key=lambda r: r.stamp_ns)
        return self._records[first:]

    def _carry(
        self, belief: _Belief, start: _Epoch, end: _Epoch, from_ns: int, to_ns: int
    ) -> _Belief:
        """Mechanise within one IMU interval; readings are linear between the two samples."""
        steps = -(-(to_ns - from_ns) // round(_LARGEST_STEP_S * 1e9))
        for step in range(steps):
            middle_ns = from_ns + (to_ns - from_ns) * (2 * step + 1) // (2 * steps)
            step_s = (to_ns - from_ns) * 1e-9 / steps
            before, covariance, lag_s, _, _ = belief
            state, rates = propagate(before, *_between(start, end, middle_ns), step_s)
            belief = _Belief(state, covariance, lag_s + step_s, before, rates)
            if belief.lag_s >= _COVARIANCE_STEP_S:
                belief = self._followed(belief)
        return belief

    def _followed(self, belief: _Belief) -> _Belief:
        """The belief with its covariance at the state's time."""
        if belief.before is None or belief.rates is None or belief.lag_s == 0:
            return belief
        covariance = self._propagation.step(
            belief.covariance, belief.before, belief.rates, belief.lag_s
        )
        return _Belief(belief.state, covariance)

    def _apply(self, record: _Record, belief: _Belief, angular_rate_b: Vector) -> _Belief:
        state, covariance = self._followed(belief)[:2]
        window: list[Array] = []
        if isinstance(record.sample, PositionSample):
            record.offset_n = self._fusion.offset_n(state, record.sample)
            last = self._records.index(record)
            window = [r.offset_n for r in self._positions(self._records[: last + 1])]
        rate_b = np.subtract(angular_rate_b, state.gyro_bias_b)
        fused = self._fusion.fuse(record.sample, state, covariance, rate_b, window)
        if record.held and record.verdict is None:
            self._resolved.append(fused.verdict)
        record.verdict = fused.verdict
        return _Belief(fused.state, fused.covariance)

    def _positions(self, records: list[_Record]) -> list[_Record]:
        """The newest positions that fill the median's window."""
        return [r for r in records if isinstance(r.sample, PositionSample)][-self._window :]

    def _forget(self) -> None:
        """Drop what no measurement can reach any more; the median's window stays."""
        oldest_ns = self.newest_ns - self._keep_ns
        if self._epochs[min(64, len(self._epochs) - 1)].stamp_ns >= oldest_ns:
            return  # in batches: cutting the lists at every sample would cost more than it frees
        drop = bisect.bisect_right(self._epochs, oldest_ns, key=lambda e: e.stamp_ns) - 1
        del self._epochs[:drop]
        self._done -= drop
        first_ns = self._epochs[0].stamp_ns
        kept = self._positions([r for r in self._records if r.stamp_ns <= first_ns])
        self._records = kept + [r for r in self._records if r.stamp_ns > first_ns]


def _readings(sample: ImuSample) -> tuple[Vector, Vector]:
    return tuple(sample.specific_force_b.tolist()), tuple(sample.angular_rate_b.tolist())


def _between(start: _Epoch, end: _Epoch, stamp_ns: int) -> tuple[Vector, Vector]:
    """Readings at a time between two samples, linearly."""
    share = (stamp_ns - start.stamp_ns) / (end.stamp_ns - start.stamp_ns)
    return _mixed(start.force_b, end.force_b, share), _mixed(start.rate_b, end.rate_b, share)


def _mixed(a: Vector, b: Vector, share: float) -> Vector:
    return (
        a[0] + share * (b[0] - a[0]),
        a[1] + share * (b[1] - a[1]),
        a[2] + share * (b[2] - a[2]),
    )

"""Check that an IMU sample continues those before: order, gaps, clock jumps, spikes, freezing.

A sample that does not continue them is held. The next one shows whether the clock has changed or
only that sample is wrong. Gaps up to ``max_imu_gap_s`` are bridged; a longer one restarts the time
line.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.core.types.verdicts import Outcome

#: A stamp that goes back further is another clock or another run of a bag, not disorder.
_CLOCK_JUMP_NS = 1_000_000_000
#: The clock has gone back once this many late samples are in order among themselves.
_BACK_NUMBER = 5
#: A stamp further ahead has left out samples of even the slowest IMU (50 Hz).
_HOLD_NS = 45_000_000
#: A live sensor's readings do not repeat in all digits. Repeats and their duration that make a
#: sensor frozen, and the changed readings that first prove it alive.
_FROZEN_NUMBER, _FROZEN_NS, _ALIVE_NUMBER = 5, 50_000_000, 50
#: Largest change from one sample to the next, vibration of some g included. More is saturation or
#: a wrong byte on the line.
_SPIKE_M_S2, _SPIKE_RAD_S = 80.0, 3.0


class Checked(NamedTuple):
    """Hold the outcome of a check, and the samples to use: with ``begins`` on a new time line."""

    outcome: Outcome
    reason: str = ""
    use: tuple[ImuSample, ...] = ()
    begins: bool = False


class ImuClock:
    """Follow the stamps and readings of the IMU."""

    def __init__(self, max_gap_s: float) -> None:
        self.configure(max_gap_s)
        self.newest_ns: int | None = None  # of the accepted samples
        self._force_b: list[float] = []
        self._rate_b: list[float] = []
        self._held: ImuSample | None = None  # newest sample that did not continue the others
        self._odd_number = 0
        self._changed_ns = 0
        self._repeated = 0
        self._alive = 0

    def configure(self, max_gap_s: float) -> None:
        """Take the longest gap that is bridged, s; also another one in flight."""
        self._max_gap_ns = round(max_gap_s * 1e9)
        self._hold_ns = min(_HOLD_NS, self._max_gap_ns)

    def check(self, sample: ImuSample) -> Checked:
        """Return the outcome of the next sample to arrive; its numbers must be finite."""
        newest_ns = self.newest_ns
        force_b, rate_b = sample.specific_force_b.tolist(), sample.angular_rate_b.tolist()
        if newest_ns is None:
            return self._unless_frozen(_continuous(sample), sample.stamp_ns, force_b, rate_b)
        ahead_ns = sample.stamp_ns - newest_ns
        if abs(ahead_ns) <= self._max_gap_ns and (
            math.dist(force_b, self._force_b) > _SPIKE_M_S2
            or math.dist(rate_b, self._rate_b) > _SPIKE_RAD_S
        ):
            return Checked(Outcome.GATED, "no aircraft turns or accelerates like that")
        checked = _continuous(sample)
        if not 0 < ahead_ns <= self._hold_ns:
            checked = self._discontinuous(sample, newest_ns, ahead_ns)
            if not checked.use:
                return checked
        return self._unless_frozen(checked, sample.stamp_ns, force_b, rate_b)

    def _discontinuous(self, sample: ImuSample, newest_ns: int, ahead_ns: int) -> Checked:
        """Judge a sample that does not closely follow the newest accepted one."""
        held = self._held
        if held is not None and (held.stamp_ns > newest_ns) is not (ahead_ns > 0):
            held = None  # a late sample proves nothing about one ahead
        goes_on = held is not None and 0 < sample.stamp_ns - held.stamp_ns <= self._max_gap_ns
        self._odd_number = self._odd_number + 1 if goes_on else 1
        self._held = sample
        both = (held, sample) if goes_on and held is not None else (sample,)
        ahead_s = ahead_ns * 1e-9
        if ahead_ns > 0:
            if not goes_on:
                reason = f"{ahead_s:.3f} s after the previous one: the next one decides"
                return Checked(Outcome.WAITING, reason)
            if both[0].stamp_ns - newest_ns <= self._max_gap_ns:
                return Checked(Outcome.USED, "", both)
            reason = f"no imu/data for {ahead_s:.3f} s"
            return Checked(Outcome.GAP, reason, both, begins=True)
        enough = 2 if -ahead_ns > _CLOCK_JUMP_NS else _BACK_NUMBER
        if -ahead_ns > self._max_gap_ns and self._odd_number >= enough:
            reason = f"imu/data went back by {-ahead_s:.3f} s"
            return Checked(Outcome.TIME_JUMP, reason, both, begins=True)
        return Checked(Outcome.OUT_OF_ORDER, "stamp not later than the previous one")

    def _unless_frozen(
        self, checked: Checked, stamp_ns: int, force_b: list[float], rate_b: list[float]
    ) -> Checked:
        """Return ``checked``, or REPEATED for a frozen sensor; store an accepted reading."""
        if force_b != self._force_b or rate_b != self._rate_b:
            self._changed_ns, self._repeated = stamp_ns, 0
            self._alive += 1
        else:
            self._repeated += 1
            long = stamp_ns - self._changed_ns >= _FROZEN_NS
            if self._alive >= _ALIVE_NUMBER and self._repeated >= _FROZEN_NUMBER and long:
                return Checked(Outcome.REPEATED, "imu/data repeats the same reading")
        self.newest_ns, self._force_b, self._rate_b = stamp_ns, force_b, rate_b
        self._held, self._odd_number = None, 0
        return checked


def in_body_axes(sample: ImuSample, rotation_bi: Array | None) -> ImuSample:
    """Return a sample turned to body axes, in which the autopilot's attitude is already."""
    if rotation_bi is None:
        return sample
    return replace(
        sample,
        specific_force_b=rotation_bi @ sample.specific_force_b,
        angular_rate_b=rotation_bi @ sample.angular_rate_b,
    )


def _continuous(sample: ImuSample) -> Checked:
    """Return the outcome of a sample that continues those before: it is used, by itself."""
    return tuple.__new__(Checked, (Outcome.USED, "", (sample,), False))

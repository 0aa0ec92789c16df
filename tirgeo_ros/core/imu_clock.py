"""Whether an IMU sample goes on from the one before: order, gaps, clock jumps, a frozen sensor."""

from __future__ import annotations

from tirgeo_ros.core.samples import ImuSample, Outcome

#: A stamp that goes back further is another clock or another run of a bag, not disorder.
_CLOCK_JUMP_NS = 1_000_000_000
#: So many samples out of order, in order among themselves: the clock has gone back.
_BACK_NUMBER = 5
#: Readings of a live sensor do not repeat in all digits.
_FROZEN_NUMBER, _FROZEN_NS = 5, 50_000_000
_ALIVE_NUMBER = 50


class ImuClock:
    """Follows the stamps and readings of the IMU.

    One sample with a stamp far away is a fault of that sample; the second in a row that goes on
    from there is another time.
    """

    def __init__(self, max_gap_s: float) -> None:
        self._max_gap_ns = round(max_gap_s * 1e9)
        self.newest_ns: int | None = None
        self._odd_ns: int | None = None  # newest of the samples that did not go on
        self._odd_number = 0
        self._readings: list[float] = []
        self._changed_ns = 0
        self._repeated = 0
        self._alive = 0

    def check(self, sample: ImuSample) -> tuple[Outcome, str]:
        """USED, or why not; after TIME_JUMP and GAP the sample is the first of another time."""
        outcome, reason = self._in_time(sample.stamp_ns)
        if outcome is Outcome.OUT_OF_ORDER or outcome is Outcome.WAITING:
            return outcome, reason
        if self._frozen(sample):
            return Outcome.REPEATED, "imu/data says the same again and again"
        self.newest_ns, self._odd_ns, self._odd_number = sample.stamp_ns, None, 0
        return outcome, reason

    def _in_time(self, stamp_ns: int) -> tuple[Outcome, str]:
        if self.newest_ns is None:
            return Outcome.USED, ""
        ahead_ns = stamp_ns - self.newest_ns
        if 0 < ahead_ns <= self._max_gap_ns:
            return Outcome.USED, ""
        goes_on = self._odd_ns is not None and 0 < stamp_ns - self._odd_ns <= self._max_gap_ns
        self._odd_number = self._odd_number + 1 if goes_on else 1
        self._odd_ns = stamp_ns
        ahead_s = ahead_ns * 1e-9
        if ahead_ns > 0:
            if goes_on:
                return Outcome.GAP, f"no imu/data for {ahead_s:.3f} s"
            return Outcome.WAITING, f"{ahead_s:.3f} s after the one before: the next decides"
        if self._odd_number >= (2 if ahead_ns < -_CLOCK_JUMP_NS else _BACK_NUMBER):
            return Outcome.TIME_JUMP, f"imu/data went back by {-ahead_s:.3f} s"
        return Outcome.OUT_OF_ORDER, "stamp not later than the one before"

    def _frozen(self, sample: ImuSample) -> bool:
        """Whether a sensor whose readings used to change says the same for long."""
        force_b, rate_b = sample.specific_force_b, sample.angular_rate_b
        last = self._readings
        if not last or force_b[0] != last[0] or rate_b[2] != last[5] or self._differs(sample):
            self._readings = [*force_b.tolist(), *rate_b.tolist()]
            self._changed_ns, self._repeated = sample.stamp_ns, 0
            self._alive = min(self._alive + 1, _ALIVE_NUMBER)
            return False
        self._repeated += 1
        long = sample.stamp_ns - self._changed_ns >= _FROZEN_NS
        return self._alive >= _ALIVE_NUMBER and self._repeated >= _FROZEN_NUMBER and long

    def _differs(self, sample: ImuSample) -> bool:
        return [
            *sample.specific_force_b.tolist(),
            *sample.angular_rate_b.tolist(),
        ] != self._readings

"""Compute stamps for periodic messages that carry no time of their own.

They arrive in bursts, with varying delays, but the aircraft sends them at a steady rate. Their
count is therefore a clock: the number of periods since the first. ``dji.clocks.aircraft_clock``
puts that clock on the line below the arrivals, as it does with the aircraft's own clock.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from tirgeo_ros.core.config.dji import DjiClockConfig
from tirgeo_ros.dji.clocks.aircraft_clock import AircraftClock
from tirgeo_ros.dji.clocks.lower_envelope import Point, middle_slope

_SECOND_NS = 1_000_000_000
#: The period is learned from at least this many messages and this time. The number doubles each
#: time that the period proves wrong, up to _LEARN_MOST.
_LEARN_NUMBER, _LEARN_NS, _LEARN_MOST = 8, _SECOND_NS, 128
#: From this number of messages on, parts of the sequence are compared. If the messages are
#: periodic, the slopes of its quarters differ from the whole's by less than _ALIKE. If a half has
#: a slope that is smaller than the whole's by more than _LOSSLESS, the whole contains lost
#: messages and that half does not.
_PARTED_NUMBER, _ALIKE, _LOSSLESS = 64, 0.1, 0.01
#: Largest remaining error of the period, and the window of the minima.
_CONFIG = DjiClockConfig(window_s=10.0, max_drift_ppm=10_000.0)
#: A silence longer than both limits is a pause: lost messages cannot be counted over it.
_PAUSE_NS, _PAUSE_PERIODS = 500_000_000, 2.5
#: A message that is late by this many periods counts as late by a period.
_LOST_PERIODS = 0.8
#: No message is held up for longer than _HELD_UP_NS. If runs of late messages are usually shorter,
#: the limit is _RUN_TIMES the longest of the recent ones (forgotten in 10 s).
_HELD_UP_NS, _RUN_TIMES, _FORGOTTEN_NS = 200_000_000, 3.0, 10e9
#: In a stream whose period is longer than this, one message that is late by a period proves a
#: loss.
_SLOW_NS = 150_000_000
#: If a message comes early within this time after a loss was assumed, nothing was lost.
_UNDONE_NS = 2 * _SECOND_NS
#: Stamps are earlier than the arrival by no more than this.
_EARLIEST_NS = 250_000_000
#: Arrivals that are out of order by less than this were stamped by two threads.
_DISORDER_NS = 50_000_000
#: A stream is not periodic if the count was wrong more than _WRONG_NUMBER times among this many
#: messages, or if more than _LOST_NUMBER were lost.
_JUDGED_NUMBER, _WRONG_NUMBER, _LOST_NUMBER = 128, 12, 64
#: A stream that was periodic for this many messages and is not now has changed its rate.
_LASTED_NUMBER = 256


class _Run(NamedTuple):
    """Hold a run of messages that are late by a period or more."""

    since_ns: int
    first_ns: float  # lateness of the first of them
    least_ns: float


class SteadyStamps:
    """Compute the stamps of one stream from its count and the line below its arrivals.

    Stamps increase, unless the host's clock is set back. They are no later than the arrival,
    except by the nanoseconds that make them increase. The stamp is the arrival itself until the
    period is known (a second, 8 messages at least), after the period has changed, and for a stream
    without a period. Otherwise, once settled, it is the time when the message would have come with
    the smallest delay of the last 10 s.

    When messages are lost, the stamps are early by the lost periods until the loss is detected.
    That takes three times the longest usual run of late messages, 0.2 s at most; where a period is
    longer than 0.15 s it is immediate. Stamps are never more than 0.25 s before the arrival. After
    a pause (over 0.5 s and 2.5 periods), and when the host's clock is set back by over 50 ms, the
    count begins again at the arrival, and stamps settle from there. Intervals that vary at random
    by less than half may be taken for periods for a while; the bound of 0.25 s holds for them as
    well.
    """

    def __init__(self) -> None:
        self._arrivals_ns: list[int] = []  # to learn the period from
        self._arrival_ns: int | None = None
        self._newest_ns = 0
        self._learn_number = _LEARN_NUMBER
        self._period_ns = 0.0  # 0: not known
        self._clock = AircraftClock(_CONFIG, tick_ns=1, bits=64)
        self._index = 0
        self._run: _Run | None = None
        self._longest_run_ns = _HELD_UP_NS / _RUN_TIMES
        self._assumed, self._assumed_ns = 0, 0  # losses that were assumed last, and when
        self._lasted = self._judged = self._wrong = self._missing = 0
        self._counts = {"lost": 0, "pauses": 0, "rate changes": 0, "host steps": 0}

    def stamp_ns(self, arrival_ns: int) -> int:
        """Return the stamp of a message by its arrival, both in ns of the host's clock."""
        arrival_ns = self._in_order(arrival_ns)
        stamp_ns = arrival_ns
        if self._period_ns:
            stamp_ns = self._count_on(arrival_ns)
            stamp_ns = min(max(stamp_ns, arrival_ns - _EARLIEST_NS), arrival_ns)
        else:
            self._learn(arrival_ns)
        self._newest_ns = max(stamp_ns, self._newest_ns + 1)
        return self._newest_ns

    @property
    def state(self) -> str:
        """Return ``learning``, ``uneven`` (no period was found), ``settling`` or ``settled``."""
        if self._period_ns:
            return self._clock.state
        return "learning" if self._learn_number < _LEARN_MOST else "uneven"

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return state, rate, lateness and counts of the stream's irregularities, as texts."""
        texts = {"stamps state": self.state}
        if self._period_ns:
            texts["stamps rate [Hz]"] = f"{_SECOND_NS / self._true_period_ns:.3f}"
            spread = self._clock.diagnostics.get("clock spread [ms]")
            if spread is not None:
                texts["stamps spread [ms]"] = spread
        return texts | {f"stamps {name}": str(count) for name, count in self._counts.items()}

    @property
    def _true_period_ns(self) -> float:
        return self._period_ns * (1 + self._clock.drift)

    def _in_order(self, arrival_ns: int) -> int:
        """Return the arrival, not before the last; begin again after a pause or a step back."""
        last_ns, self._arrival_ns = self._arrival_ns, arrival_ns
        if last_ns is None:
            self._newest_ns = arrival_ns - 1
        elif last_ns - arrival_ns > _DISORDER_NS:
            self._counts["host steps"] += 1
            self._newest_ns = arrival_ns - 1
            self._begin()
        elif arrival_ns - last_ns > max(_PAUSE_NS, _PAUSE_PERIODS * self._true_period_ns):
            known = (
                self._arrivals_ns
            )  # where the period is not known, their mean step stands for it
            usual_ns = (known[-1] - known[0]) / (len(known) - 1) if len(known) > 1 else math.inf
            if self._period_ns or arrival_ns - last_ns > _PAUSE_PERIODS * usual_ns:
                self._counts["pauses"] += 1
                self._begin()
        else:
            self._arrival_ns = max(arrival_ns, last_ns)
        return self._arrival_ns

    def _begin(self) -> None:
        """Begin the count again, with the period known so far."""
        self._period_ns = self._true_period_ns
        self._clock = AircraftClock(_CONFIG, tick_ns=1, bits=64)
        self._index = 0
        self._run = None
        self._assumed = 0
        self._judged = self._wrong = self._missing = 0
        self._arrivals_ns.clear()

    def _learn(self, arrival_ns: int) -> None:
        """Estimate the period by the lower hull of arrivals over their count."""
        known = self._arrivals_ns
        known.append(arrival_ns)
        if len(known) < self._learn_number or known[-1] - known[0] < _LEARN_NS:
            return
        period_ns = _period_ns([arrival - known[0] for arrival in known])
        arrivals_ns = known.copy()
        self._begin()
        if period_ns is None:
            self._learn_number = _LEARN_MOST
            return
        self._period_ns = period_ns
        self._lasted = 0
        for arrival in arrivals_ns:
            self._index += 1
            self._clock.stamp_ns(round(self._index * period_ns), arrival)

    def _count_on(self, arrival_ns: int) -> int:
        """Return the stamp by the count, which is corrected where messages were lost."""
        period_ns = self._period_ns
        self._index += 1
        late_ns = self._clock.lateness_ns(round(self._index * period_ns), arrival_ns)
        if late_ns > _LOST_PERIODS * period_ns:
            self._count_lost(self._lost(late_ns, arrival_ns), arrival_ns)
        else:
            self._end_run(arrival_ns)
            if late_ns < -period_ns / 2:
                self._count_found(arrival_ns)
        stamp_ns = self._clock.stamp_ns(round(self._index * period_ns), arrival_ns)
        self._judge()
        return stamp_ns

    def _lost(self, late_ns: float, arrival_ns: int) -> int:
        """Return how many messages were lost before a late one; 0 while a queue may explain it."""
        run, period_ns = self._run, self._period_ns
        if period_ns > _SLOW_NS:
            return round(late_ns / period_ns)
        if run is None or late_ns < run.first_ns - _LOST_PERIODS * period_ns:
            self._run = _Run(arrival_ns, late_ns, late_ns)
            return 0
        self._run = run._replace(least_ns=min(late_ns, run.least_ns))
        held_up_ns = min(_RUN_TIMES * self._longest_run_ns, _HELD_UP_NS)
        if arrival_ns - run.since_ns < max(held_up_ns, 2 * period_ns):
            return 0
        return round(self._run.least_ns / period_ns)

    def _end_run(self, arrival_ns: int) -> None:
        """Record how long the run of late messages lasted that has just ended."""
        self._longest_run_ns -= self._longest_run_ns * self._period_ns / _FORGOTTEN_NS
        if self._run is not None:
            lasted_ns = arrival_ns - self._run.since_ns
            self._longest_run_ns = max(self._longest_run_ns, lasted_ns)
            self._run = None

    def _count_lost(self, lost: int, arrival_ns: int) -> None:
        if lost:
            self._index += lost
            self._run = None
            self._assumed, self._assumed_ns = lost, arrival_ns
            self._counts["lost"] += lost
            self._missing += lost
            self._wrong += 1

    def _count_found(self, arrival_ns: int) -> None:
        """Undo a recent assumption of lost messages: they were only held up."""
        if self._assumed and arrival_ns - self._assumed_ns < _UNDONE_NS:
            self._index -= self._assumed
            self._counts["lost"] -= self._assumed
            self._longest_run_ns = _HELD_UP_NS / _RUN_TIMES
        self._assumed = 0
        self._wrong += 1

    def _judge(self) -> None:
        """Learn the period again if the count is wrong too often."""
        self._lasted += 1
        self._judged += 1
        too_wrong = self._wrong > _WRONG_NUMBER or self._missing > _LOST_NUMBER
        if too_wrong or abs(self._clock.drift) > 0.9e-6 * _CONFIG.max_drift_ppm:
            has_lasted = self._lasted >= _LASTED_NUMBER
            more = min(2 * self._learn_number, _LEARN_MOST)
            self._learn_number = _LEARN_NUMBER if has_lasted else more
            self._counts["rate changes"] += has_lasted
            self._begin()
            self._period_ns = 0.0
        elif self._judged >= _JUDGED_NUMBER:
            self._judged = self._wrong = self._missing = 0


def _period_ns(arrivals_ns: list[int]) -> float | None:
    """Return the period of arrivals, some of which may be missing; None if they have none."""
    points = [(float(n), float(arrival)) for n, arrival in enumerate(arrivals_ns)]
    whole = middle_slope(points)
    if len(points) >= _PARTED_NUMBER:
        if any(abs(part - whole) >= _ALIKE * whole for part in _slopes(points, 4)):
            return None
        least = min(_slopes(points, 2))
        whole = least if least < (1 - _LOSSLESS) * whole else whole
    return whole if whole > 0 else None


def _slopes(points: list[Point], parts: int) -> list[float]:
    length = len(points) // parts
    return [middle_slope(points[n * length : (n + 1) * length]) for n in range(parts)]

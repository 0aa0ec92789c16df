"""Check that stamps are measurement times on one clock: zero, ahead, late, jumping, drifting.

A sample's age is its arrival time minus its stamp. The ages of topics on one clock differ only by
their transport times; a topic that is younger on arrival than the IMU has stamps in the future.
"""

from __future__ import annotations

import statistics
from collections import Counter, deque
from collections.abc import Collection, Mapping, Sequence

from tirgeo_ros.core.checks.rate_checks import Stream
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aids import AIDS
from tirgeo_ros.core.navigation.delays import Delays
from tirgeo_ros.core.types.finding import Finding, Severity

IMU = "imu/data"
_DELAYED = {s.topic: (s, aid.delay) for s, aid in AIDS.items() if aid.delay}
#: Number of one-second medians that must agree.
_WINDOWS = 3
#: Transport times differ by some hundredths of a second; at 3 m/s a tenth is 30 cm.
_AHEAD_S = -0.1
_STEP_S = 0.15
_DRIFT_S = 0.1
_LEAST_DRIFTING = 30  # seconds of data before a drift is reported
_SECOND_NS = 1_000_000_000
#: After a longer silence the IMU's age is not used.
_OLD_NS = 500_000_000
_ONE_CLOCK = "stamp both with one clock"


class StampChecks:
    """Compare the age of every aid with that of the IMU's newest sample, second by second."""

    def __init__(self, config: EkfConfig) -> None:
        self._max_delay_s = config.max_delay_s
        delays = Delays.from_config(config)
        self._delay_ns = {
            topic: delays.aid_ns[source] - delays.imu_ns for topic, (source, _) in _DELAYED.items()
        }
        # for each topic: the start of its present second, and its relative ages since then
        self._second: dict[str, tuple[int, list[int]]] = {}
        # for each topic: medians of the newest seconds, s
        self._against: dict[str, deque[float]] = {}
        self._number: Counter[str] = Counter()  # of seconds
        self._first: dict[str, float] = {}
        self._jumped: dict[str, float] = {}

    def take(self, topic: str, stream: Stream, imu: Stream) -> None:
        """Take the newest sample of an aid, already counted by ``stream``."""
        if topic not in _DELAYED or stream.arrived_ns - imu.arrived_ns > _OLD_NS:
            return
        begin_ns, ages = self._second.setdefault(topic, (stream.arrived_ns, []))
        if not 0 <= stream.arrived_ns - begin_ns < _SECOND_NS:
            self._ended(topic, ages)
            ages = []
            self._second[topic] = stream.arrived_ns, ages
        ages.append(stream.age_ns - imu.age_ns)

    def _ended(self, topic: str, ages_ns: Sequence[int]) -> None:
        kept = self._against.setdefault(topic, deque(maxlen=2 * _WINDOWS))
        kept.append((statistics.median(ages_ns) + self._delay_ns[topic]) * 1e-9)
        self._number[topic] += 1
        if len(kept) == 2 * _WINDOWS:
            self._first.setdefault(topic, statistics.median(kept))
            before, after = list(kept)[:_WINDOWS], list(kept)[_WINDOWS:]
            apart = statistics.median(after) - statistics.median(before)
            if max(max(a) - min(a) for a in (before, after)) < 0.3 * abs(apart) > 0.3 * _STEP_S:
                self._jumped[topic] = apart
                self._first[topic] = after[-1]  # a drift is measured from here

    def findings(self, streams: Mapping[str, Stream]) -> list[Finding]:
        """Return what is wrong with the stamps of ``streams``, one finding for each fault."""
        recent = {t: list(a)[-_WINDOWS:] for t, a in self._against.items() if len(a) >= _WINDOWS}
        ahead = {t: max(a) for t, a in recent.items() if max(a) < _AHEAD_S}
        late = {t: min(a) for t, a in recent.items() if min(a) > self._max_delay_s}
        changes = {
            topic: [age - self._first[topic] for age in ages]
            for topic, ages in recent.items()
            if self._number[topic] >= _LEAST_DRIFTING
        }
        drifted = {
            topic: statistics.median(change)
            for topic, change in changes.items()
            if min(change) > _DRIFT_S or max(change) < -_DRIFT_S
        }
        found = [*_unstamped(streams, [t for t, delay_ns in self._delay_ns.items() if delay_ns])]
        for topic, text in _worst(ahead):
            evidence = f"{topic} is stamped {-ahead[topic]:.2f} s ahead of {text}"
            mend = f"{_ONE_CLOCK}, or set it to {-ahead[topic]:.2f} s and more"
            where = _parameter(topic)
            found.append(Finding("stamp_ahead", Severity.STOP, evidence, where, mend))
        for topic, text in _worst(late):
            limit = f"later than max_delay_s, {self._max_delay_s:g} s, is refused"
            evidence = f"{topic} is stamped {late[topic]:.2f} s behind {text}; {limit}"
            mend = f"{_ONE_CLOCK}; where the delay is true, set max_delay_s"
            where = _parameter(topic)
            found.append(Finding("stamp_late", Severity.STOP, evidence, where, mend))
        check, verb = ("stamp_jump", "jumped") if self._jumped else ("stamp_drift", "have drifted")
        apart = self._jumped or drifted
        for topic, text in _worst(apart):
            evidence = f"stamps of {topic} {verb} by {apart[topic]:+.2f} s against {text}"
            mend = f"{_ONE_CLOCK}, and let none be set in flight"
            where = f"{topic} header.stamp"
            found.append(Finding(check, Severity.CAUTION, evidence, where, mend))
        return found


def _unstamped(streams: Mapping[str, Stream], delayed: Collection[str]) -> list[Finding]:
    """Return the finding on zero stamps, only a note if all such topics are ``delayed``.

    ``delayed`` are the topics with a configured delay, which such a driver needs.
    """
    counts = {t: s for t, s in streams.items() if s.unstamped >= 3}
    if not counts:
        return []
    listed = ", ".join(f"{t} ({s.unstamped} of {s.count})" for t, s in counts.items())
    evidence = f"stamps are 0: {listed}; the time of arrival is taken"
    mend = "let the driver stamp with the time of measurement, or set the delay to arrival"
    look = {IMU: "imu.delay_s"} | {topic: name for topic, (_, name) in _DELAYED.items()}
    names = sorted({look[topic] for topic in counts if topic in look})
    where = f"ekf_node {', '.join(names)}"
    severity = Severity.NOTE if set(counts) <= set(delayed) else Severity.CAUTION
    return [Finding("stamp_zero", severity, evidence, where, mend)]


def _worst(off_s: Mapping[str, float]) -> list[tuple[str, str]]:
    """Return at most one topic, that farthest off, with a text of the IMU and the other topics."""
    if not off_s:
        return []
    worst = max(off_s, key=lambda topic: abs(off_s[topic]))
    others = [topic for topic in off_s if topic != worst]
    return [(worst, f"{IMU} ({', '.join(others)} too)" if others else IMU)]


def _parameter(topic: str) -> str:
    return f"{topic} header.stamp, ekf_node {_DELAYED[topic][1]}"

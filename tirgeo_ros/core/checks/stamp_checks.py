"""Check that stamps are measurement times on one clock: ahead, late, jumping.

A sample's age is its arrival time minus its stamp. The ages of topics on one clock differ only by
their transport times; a topic that is younger on arrival than the IMU has stamps in the future.
"""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Mapping

from tirgeo_ros.core.checks.stream_checks import IMU, Stream
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.aiding.aids import AIDS, Delays
from tirgeo_ros.core.types.finding import Finding, Severity

_DELAYED = {s.topic: (s, aid.delay) for s, aid in AIDS.items() if aid.delay}
#: Number of one-second medians that must agree.
_WINDOWS = 3
#: Transport times differ by some hundredths of a second; at 3 m/s a tenth is 30 cm.
_AHEAD_S, _STEP_S = -0.1, 0.15
_SECOND_NS = 1_000_000_000
#: After a longer silence the IMU's age is not used.
_OLD_NS = 500_000_000
_ONE_CLOCK = "stamp both with the same clock"


class StampChecks:
    """Compare the age of every aid with that of the IMU's newest sample, second by second."""

    def __init__(self, config: EkfConfig) -> None:
        self._max_delay_s = config.max_delay_s
        delays = Delays.from_config(config)
        self._delay_ns = {
            topic: delays.aid_ns[source] - delays.imu_ns for topic, (source, _) in _DELAYED.items()
        }
        # for each topic: the start of its present second, and its relative ages since then (ns)
        self._second: dict[str, tuple[int, list[int]]] = {}
        self._medians_s: dict[str, deque[float]] = {}  # of the newest seconds
        self._jumped_s: dict[str, float] = {}

    def take(self, topic: str, stream: Stream, imu: Stream) -> None:
        """Take the newest sample of an aid, already counted by ``stream``."""
        if topic not in _DELAYED or stream.arrived_ns - imu.arrived_ns > _OLD_NS:
            return
        begin_ns, ages_ns = self._second.setdefault(topic, (stream.arrived_ns, []))
        if not 0 <= stream.arrived_ns - begin_ns < _SECOND_NS:
            self._ended(topic, (statistics.median(ages_ns) + self._delay_ns[topic]) * 1e-9)
            ages_ns = []
            self._second[topic] = stream.arrived_ns, ages_ns
        ages_ns.append(stream.age_ns - imu.age_ns)

    def _ended(self, topic: str, median_s: float) -> None:
        kept = self._medians_s.setdefault(topic, deque(maxlen=2 * _WINDOWS))
        kept.append(median_s)
        before, after = list(kept)[:_WINDOWS], list(kept)[_WINDOWS:]
        if len(after) == _WINDOWS:
            apart_s = statistics.median(after) - statistics.median(before)
            spread_s = max(max(ages) - min(ages) for ages in (before, after))
            if abs(apart_s) > _STEP_S and spread_s < 0.3 * abs(apart_s):
                self._jumped_s[topic] = apart_s

    def findings(self) -> list[Finding]:
        """Return one finding for each fault, of the topic that is farthest off."""
        recent = {t: list(a)[-_WINDOWS:] for t, a in self._medians_s.items() if len(a) >= _WINDOWS}
        ahead = {t: -max(a) for t, a in recent.items() if max(a) < _AHEAD_S}
        late = {t: min(a) for t, a in recent.items() if min(a) > self._max_delay_s}
        limit = f"what is later than max_delay_s, {self._max_delay_s:g} s, is refused"
        found = (
            _worst(
                *("stamp_ahead", Severity.STOP, ahead),
                "{topic} is stamped {off:.2f} s ahead of {others}",
                f"{_ONE_CLOCK}, or set it to the delay of the stamps",
            ),
            _worst(
                *("stamp_late", Severity.STOP, late),
                f"{{topic}} is stamped {{off:.2f}} s behind {{others}}; {limit}",
                f"{_ONE_CLOCK}; where the delay is true, set max_delay_s",
            ),
            _worst(
                *("stamp_jump", Severity.CAUTION, self._jumped_s),
                "stamps of {topic} jumped by {off:+.2f} s against {others}",
                f"{_ONE_CLOCK}, and set no clock in flight",
            ),
        )
        return [one for one in found if one]


def _worst(
    check: str, severity: Severity, off_s: Mapping[str, float], evidence: str, mend: str
) -> Finding | None:
    """Return the finding on the topic that is farthest off, with the names of the others."""
    if not off_s:
        return None
    worst = max(off_s, key=lambda topic: abs(off_s[topic]))
    others = ", ".join(topic for topic in off_s if topic != worst)
    text = evidence.format(
        topic=worst, off=off_s[worst], others=f"{IMU} ({others} too)" if others else IMU
    )
    return Finding(
        check, severity, text, f"{worst} header.stamp, ekf_node {_DELAYED[worst][1]}", mend
    )

# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Count messages and measure rates, ages and latencies of a node's topics, for diagnostics."""

from __future__ import annotations

import threading
import time
from collections import Counter
from datetime import datetime, timezone
from typing import Final

from tirgeo_ros.io.messages import FINDINGS_TOPIC, STATE_TOPIC, DiagnosticItem, TopicState

OK, WARN, ERROR = 0, 1, 2
#: A needed input that is silent for longer than this is named in the diagnostics.
SILENT_S = 2.0
#: Reports that nodes publish about themselves: no data of a flight.
_REPORTS = frozenset({STATE_TOPIC, FINDINGS_TOPIC})


class Monitor:
    """Track counts, rates, ages and latencies of a node's topics; any thread may call it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self.started_ns: Final = time.time_ns()
        self._window_began_s = time.monotonic()
        self._expected_s: dict[str, float] = {}  # steady time of registration
        self._window: Counter[str] = Counter()
        self._rates_hz: dict[str, float] = {}  # of the last whole window
        #: Median and 95 % of the latencies of the last whole window.
        self._latencies_ms: dict[str, tuple[float, float]] = {}
        self._refused: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}  # reason of the newest refusal
        self._failures: Counter[tuple[str, str]] = Counter()  # by topic and kind
        self._lost: dict[str, int] = {}
        self._last_s: dict[str, float] = {}
        self._latency_s: dict[str, list[float]] = {}

    def expects(self, topic: str) -> None:
        """Record that the node needs this input: its silence is a warning."""
        with self._lock:
            self._expected_s[topic] = time.monotonic()

    def received_topics(self) -> frozenset[str]:
        """Return the topics of data from which a message was received."""
        with self._lock:
            return frozenset(self._last_s) - _REPORTS

    def received(self, topic: str) -> None:
        """Count a message that was received."""
        with self._lock:
            self._window[topic] += 1
            self._last_s[topic] = time.monotonic()

    def refused(self, topic: str, reason: str = "") -> None:
        """Count a message that could not be read, with the reason."""
        with self._lock:
            self._refused[topic] += 1
            self._reasons[topic] = reason

    def failed(self, topic: str, kind: str) -> bool:
        """Count a fault of the program on a topic; return whether this ``kind`` is new."""
        with self._lock:
            self._failures[topic, kind] += 1
            return self._failures[topic, kind] == 1

    def lost(self, topic: str, number: int) -> None:
        """Set how many messages of a topic were lost in transport since the subscription began."""
        with self._lock:
            self._lost[topic] = number

    def published(self, topic: str, latency_s: float) -> None:
        """Count a published message, and its age or the time that it took."""
        with self._lock:
            self._window[topic] += 1
            self._latency_s.setdefault(topic, []).append(latency_s)

    def report(self, name: str) -> DiagnosticItem:
        """End the window of rates and latencies, and return its diagnostic item."""
        with self._lock:
            now_s = time.monotonic()
            span_s = max(now_s - self._window_began_s, 1e-3)
            topics = sorted({*self._expected_s, *self._last_s, *self._window})
            self._rates_hz = {topic: self._window[topic] / span_s for topic in topics}
            self._latencies_ms = {topic: _shares_ms(s) for topic, s in self._latency_s.items()}
            self._window_began_s = now_s
            self._window.clear()
            self._latency_s.clear()
            return DiagnosticItem(name, *self._level_and_message(now_s), self._values(now_s))

    def topics(self) -> dict[str, TopicState]:
        """Return each topic's state: rates and latencies of the last whole window, ages now."""
        with self._lock:
            now_s, failed = time.monotonic(), self._failed()
            ages_s = {topic: round(now_s - last, 2) for topic, last in self._last_s.items()}
            return {
                topic: TopicState(
                    round(self._rates_hz.get(topic, 0.0), 1),
                    ages_s.get(topic),
                    *self._latencies_ms.get(topic, (None, None)),
                    self._refused[topic],
                    failed[topic],
                    self._lost.get(topic, 0),
                )
                for topic in sorted({*self._expected_s, *self._last_s, *self._rates_hz})
            }

    def _failed(self) -> Counter[str]:
        """Return the number of faults of the program by topic."""
        failed: Counter[str] = Counter()
        for (topic, _), number in self._failures.items():
            failed[topic] += number
        return failed

    def _level_and_message(self, now_s: float) -> tuple[int, str]:
        """Return level and message: program faults since the start, inputs silent now."""
        last_s = {t: self._last_s.get(t, since) for t, since in self._expected_s.items()}
        silent = sorted(t for t, last in last_s.items() if now_s - last > SILENT_S)
        parts = [f"failed: {t}: {kind}, see the log" for t, kind in self._failures]
        parts += [f"silent: {', '.join(silent)}"] if silent else []
        level = ERROR if self._failures else WARN if silent else OK
        return level, "; ".join(parts) or "ok"

    def _values(self, now_s: float) -> dict[str, str]:
        started = datetime.fromtimestamp(1e-9 * self.started_ns, timezone.utc)
        values = {"started": started.isoformat()}
        values |= {f"{topic} rate [Hz]": f"{hz:.1f}" for topic, hz in self._rates_hz.items()}
        for topic, last in sorted(self._last_s.items()):
            values[f"{topic} age [s]"] = f"{now_s - last:.2f}"
        for topic, (median_ms, _) in self._latencies_ms.items():
            values[f"{topic} latency [ms]"] = f"{median_ms:.1f}"
        values |= {f"{topic} unreadable": str(n) for topic, n in self._refused.items()}
        values |= {f"{topic} unreadable because": why for topic, why in self._reasons.items()}
        values |= {f"{topic} failed": str(n) for topic, n in self._failed().items()}
        return values | {f"{topic} lost": str(n) for topic, n in self._lost.items()}


def _shares_ms(times_s: list[float]) -> tuple[float, float]:
    """Return the median and the 95th percentile of times, ms."""
    ordered = sorted(times_s)
    p95 = min(round(0.95 * len(ordered)), len(ordered) - 1)
    return round(1e3 * ordered[len(ordered) // 2], 1), round(1e3 * ordered[p95], 1)

"""Counts, rates, ages and latencies of a node's topics, for its diagnostics."""

from __future__ import annotations

import time
from collections import Counter

from rclpy.clock import Clock

from tirgeo_ros.io.messages import DiagnosticItem

OK, WARN = 0, 1
#: A needed input that is silent for so long is named in the message.
SILENT_S = 2.0


class Monitor:
    """Counts, rates, ages and latencies of a node's topics."""

    def __init__(self) -> None:
        self._since_s = time.monotonic()
        self._expected_s: dict[str, float] = {}  # since when
        self._window: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._lost: dict[str, int] = {}
        self._last_s: dict[str, float] = {}
        self._latency_s: dict[str, list[float]] = {}
        self._forgotten: set[str] = set()

    def listens(self, topic: str) -> None:
        """An input is listened to, from now on or again."""
        self._forgotten.discard(topic)

    def expects(self, topic: str) -> None:
        """The node cannot do without this input: its silence is a warning."""
        self._expected_s[topic] = time.monotonic()

    def forget(self, topic: str) -> None:
        """An input is no longer listened to; what of it is still queued does not count."""
        self._forgotten.add(topic)
        for table in (self._last_s, self._expected_s, self._window, self._refused, self._lost):
            table.pop(topic, None)

    def received(self, topic: str) -> None:
        """A message came."""
        if topic in self._forgotten:
            return
        self._window[topic] += 1
        self._last_s[topic] = time.monotonic()

    def refused(self, topic: str) -> None:
        """The message that came could not be read."""
        if topic not in self._forgotten:
            self._refused[topic] += 1

    def lost(self, topic: str, number: int) -> None:
        """So many messages have been lost on the way since it is listened to."""
        if topic not in self._forgotten:
            self._lost[topic] = number

    def published(self, topic: str, clock: Clock, stamp_ns: int) -> None:
        """A message went out now that tells of ``stamp_ns``."""
        self.took(topic, 1e-9 * (clock.now().nanoseconds - stamp_ns))

    def took(self, topic: str, latency_s: float) -> None:
        """A message went out, so long after what it comes from."""
        self._window[topic] += 1
        self._latency_s.setdefault(topic, []).append(latency_s)

    def item(self, name: str) -> DiagnosticItem:
        """The state since the last call, which begins a new window."""
        now = time.monotonic()
        values = self._rates(now) | self._ages(now) | self._latencies()
        values |= {f"{topic} unreadable": str(n) for topic, n in self._refused.items()}
        values |= {f"{topic} lost": str(n) for topic, n in self._lost.items()}
        heard = {t: self._last_s.get(t, since) for t, since in self._expected_s.items()}
        silent = sorted(t for t, last in heard.items() if now - last > SILENT_S)
        self._since_s = now
        self._window.clear()
        self._latency_s.clear()
        message = f"silent: {', '.join(silent)}" if silent else "ok"
        return DiagnosticItem(name, WARN if silent else OK, message, values)

    def _rates(self, now_s: float) -> dict[str, str]:
        span = max(now_s - self._since_s, 1e-3)
        topics = {*self._expected_s, *self._last_s, *self._window}
        return {
            f"{topic} rate [Hz]": f"{self._window[topic] / span:.1f}" for topic in sorted(topics)
        }

    def _ages(self, now_s: float) -> dict[str, str]:
        return {f"{t} age [s]": f"{now_s - last:.2f}" for t, last in sorted(self._last_s.items())}

    def _latencies(self) -> dict[str, str]:
        return {
            f"{topic} latency [ms]": f"{1e3 * sorted(found)[len(found) // 2]:.1f}"
            for topic, found in self._latency_s.items()
        }

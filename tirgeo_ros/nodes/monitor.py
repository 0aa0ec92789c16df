"""Counts, rates, ages and latencies of a node's topics, for its diagnostics."""

from __future__ import annotations

import threading
import time
from collections import Counter

from rclpy.clock import Clock

from tirgeo_ros.io.messages import DiagnosticItem

OK, WARN, ERROR = 0, 1, 2
#: A needed input that is silent for so long is named in the message.
SILENT_S = 2.0


class Monitor:
    """Counts, rates, ages and latencies of a node's topics; any thread may call it."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._since_s = time.monotonic()
        self._expected_s: dict[str, float] = {}  # since when
        self._window: Counter[str] = Counter()
        self._refused: Counter[str] = Counter()
        self._reasons: dict[str, str] = {}  # of the newest refusal
        self._failed: Counter[str] = Counter()
        self._failures: dict[tuple[str, str], None] = {}  # topic and kind, in order
        self._lost: dict[str, int] = {}
        self._last_s: dict[str, float] = {}
        self._latency_s: dict[str, list[float]] = {}
        self._forgotten: set[str] = set()

    def listens(self, topic: str) -> None:
        """An input is listened to, from now on or again."""
        with self._lock:
            self._forgotten.discard(topic)

    def expects(self, topic: str) -> None:
        """The node cannot do without this input: its silence is a warning."""
        with self._lock:
            self._expected_s[topic] = time.monotonic()

    @property
    def heard(self) -> bool:
        """Whether anything has come."""
        with self._lock:
            return bool(self._last_s)

    def heard_of(self) -> frozenset[str]:
        """Return the topics of which anything has come."""
        with self._lock:
            return frozenset(self._last_s)

    def forget(self, topic: str) -> None:
        """An input is no longer listened to; what of it is still queued does not count.

        A fault of the program that it met is not forgotten.
        """
        with self._lock:
            self._forgotten.add(topic)
            self._window.pop(topic, None)
            self._refused.pop(topic, None)
            for table in (self._last_s, self._expected_s, self._reasons, self._lost):
                table.pop(topic, None)  # type: ignore[attr-defined]

    def received(self, topic: str) -> None:
        """A message came."""
        with self._lock:
            if topic not in self._forgotten:
                self._window[topic] += 1
                self._last_s[topic] = time.monotonic()

    def refused(self, topic: str, reason: str = "") -> None:
        """The message that came could not be read, and why."""
        with self._lock:
            if topic not in self._forgotten:
                self._refused[topic] += 1
                self._reasons[topic] = reason

    def failed(self, topic: str, kind: str) -> bool:
        """The program failed at what came; whether for the first time in this way (``kind``)."""
        with self._lock:
            self._failed[topic] += 1
            first = (topic, kind) not in self._failures
            self._failures[topic, kind] = None
            return first

    def lost(self, topic: str, number: int) -> None:
        """So many messages have been lost on the way since it is listened to."""
        with self._lock:
            if topic not in self._forgotten:
                self._lost[topic] = number

    def published(self, topic: str, clock: Clock, stamp_ns: int) -> None:
        """A message went out now that tells of ``stamp_ns``."""
        self.took(topic, 1e-9 * (clock.now().nanoseconds - stamp_ns))

    def took(self, topic: str, latency_s: float) -> None:
        """A message went out, so long after what it comes from."""
        with self._lock:
            self._window[topic] += 1
            self._latency_s.setdefault(topic, []).append(latency_s)

    def item(self, name: str) -> DiagnosticItem:
        """The state since the last call, which begins a new window."""
        with self._lock:
            now = time.monotonic()
            values = self._rates(now) | self._ages(now) | self._latencies() | self._counts()
            level, message = self._judged(now)
            self._since_s = now
            self._window.clear()
            self._latency_s.clear()
        return DiagnosticItem(name, level, message, values)

    def _judged(self, now_s: float) -> tuple[int, str]:
        """Level and message: what failed since the start, and what is silent now."""
        heard = {t: self._last_s.get(t, since) for t, since in self._expected_s.items()}
        silent = sorted(t for t, last in heard.items() if now_s - last > SILENT_S)
        said = [f"failed: {t}: {kind}, see the log" for t, kind in self._failures]
        said += [f"silent: {', '.join(silent)}"] if silent else []
        level = ERROR if self._failures else WARN if silent else OK
        return level, "; ".join(said) or "ok"

    def _counts(self) -> dict[str, str]:
        values = {f"{topic} unreadable": str(n) for topic, n in self._refused.items()}
        values |= {f"{topic} unreadable because": why for topic, why in self._reasons.items()}
        values |= {f"{topic} failed": str(n) for topic, n in self._failed.items()}
        return values | {f"{topic} lost": str(n) for topic, n in self._lost.items()}

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

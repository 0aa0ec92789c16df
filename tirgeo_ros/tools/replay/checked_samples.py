"""Count the checked messages: the numbers that are reported beside the findings."""

from __future__ import annotations


class CheckedSamples:
    """Count messages by topic, with their time span and the longest gap between two of them."""

    def __init__(self) -> None:
        self.size: tuple[int, int] | None = None  # of the newest picture: width, height
        self._topics: dict[str, list[int]] = {}  # number, first, newest, longest gap (ns)

    def message(self, topic: str, arrival_ns: int) -> None:
        """Count a message by its arrival (ns)."""
        entry = self._topics.get(topic)
        if entry is None:
            self._topics[topic] = [1, arrival_ns, arrival_ns, 0]
            return
        entry[0] += 1
        entry[3] = max(entry[3], arrival_ns - entry[2])
        entry[2] = arrival_ns

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of messages by topic."""
        return {topic: entry[0] for topic, entry in self._topics.items()}

    @property
    def topics(self) -> dict[str, dict[str, float | None]]:
        """Return number, rate (Hz) and longest gap (s) of each topic."""
        return {
            topic: {
                "messages": number,
                "rate_hz": (number - 1) / ((last - first) * 1e-9) if last > first else None,
                "longest_gap_s": gap * 1e-9,
            }
            for topic, (number, first, last, gap) in sorted(self._topics.items())
        }

"""Count the messages of a topic that never came, by their publication sequence numbers.

Only these numbers show messages that a newer one replaced in a shallow queue, or that were lost in
transport.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tirgeo_ros.nodes.callbacks import told


class SentNumbers:
    """Track the sequence numbers of one publisher's messages, or of the publisher after it.

    ``sent`` counts messages since the first that came, ``missed`` those of them that did not come.
    A number that goes back means a new publisher. With two publishers at once both counts are
    wrong.
    """

    def __init__(self) -> None:
        self.sent = self.missed = 0
        self._last = 0

    def heard(self, number: int) -> None:
        """Count the message with this sequence number, and those missed before it."""
        skipped = number - self._last - 1 if 0 < self._last < number else 0
        self.missed += skipped
        self.sent += skipped + 1
        self._last = number

    def listening(self, receive: Callable[[Any], None]) -> Callable[..., None]:
        """Return ``receive`` as the callback of a subscription that also counts the numbers."""

        def take(message: Any, info: Any) -> None:
            number = info.get("publication_sequence_number") if info else None
            if number is not None:  # not every middleware numbers messages
                self.heard(number)
            receive(message)

        return told(take)

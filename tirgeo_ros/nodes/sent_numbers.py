"""How many messages of a topic never came, by the numbers that their sender gives them.

What gave way to a newer one in a shallow queue, or was lost on the way, is told by nothing else.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from tirgeo_ros.nodes.callbacks import told


class SentNumbers:
    """Follows the numbers of one sender's messages, and of the one that comes after it.

    ``sent`` are those since the first that came, ``missed`` those of them that did not come. A
    number that goes back is a new sender's. Two senders at once make no sense of either.
    """

    def __init__(self) -> None:
        self.sent = self.missed = 0
        self._last = 0

    def heard(self, number: int) -> None:
        """Take the number of a message that came."""
        skipped = number - self._last - 1 if 0 < self._last < number else 0
        self.missed += skipped
        self.sent += skipped + 1
        self._last = number

    def listening(self, receive: Callable[[Any], None]) -> Callable[..., None]:
        """``receive`` as the callback of a subscription that tells the numbers."""

        def take(message: Any, info: Any) -> None:
            number = info.get("publication_sequence_number") if info else None
            if number is not None:  # not every middleware numbers them
                self.heard(number)
            receive(message)

        return told(take)

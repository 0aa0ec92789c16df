"""Limit what one connection and one address may ask of the server; no clock of its own."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any

from tirgeo_ros.page.access import VIEWER

_MOST_ADDRESSES = 1000  # that are remembered
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 60.0
_ERRORS = 2  # of an honest user's typing
_TOGETHER = 4  # shares that all viewers have in common, or all strangers


class Allowance:
    """Allow ``rate`` units a second, and ``burst`` at once."""

    __slots__ = ("_burst", "_left", "_rate", "_then_s")

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._left, self._then_s = burst, 0.0

    def take(self, now_s: float, amount: float = 1.0) -> bool:
        """Return whether ``amount`` is allowed; if so it is taken."""
        grown = self._left + (now_s - self._then_s) * self._rate
        self._left, self._then_s = min(self._burst, grown), now_s
        if self._left < amount:
            return False
        self._left -= amount
        return True


class Shares:
    """Hold an allowance for each owner, a session or an address; the longest unused is forgotten.

    Viewers have a common one too, however many sessions one of them takes; so have strangers.
    """

    def __init__(self, rate: float, burst: float) -> None:
        self._rate, self._burst = rate, burst
        self._known: OrderedDict[str, Allowance] = OrderedDict()
        together = _TOGETHER * rate, _TOGETHER * burst
        self._common = {role: Allowance(*together) for role in (None, VIEWER)}

    def take(self, role: str | None, owner: str, now_s: float) -> bool:
        """Return whether the owner may have one more."""
        allowance = self._known.setdefault(owner, Allowance(self._rate, self._burst))
        _keep(self._known, owner)
        common = self._common.get(role)
        return allowance.take(now_s) and (common is None or common.take(now_s))


class WrongTokens:
    """Make an address that gives wrong tokens wait longer each time, to a minute.

    While many guess, that minute comes after a typing error or two.
    """

    def __init__(self) -> None:
        self._known: OrderedDict[str, tuple[int, float]] = OrderedDict()
        self._all = Allowance(5.0, 50.0)  # of all addresses: one guesser may have many

    def wait_s(self, address: str, now_s: float) -> float:
        """Return how long the address must wait before its next token is looked at."""
        return max(0.0, self._known.get(address, (0, 0.0))[1] - now_s)

    def add(self, address: str, now_s: float) -> None:
        """Note a wrong token."""
        count = self._known.get(address, (0, 0.0))[0]
        wait_s = min(_FIRST_WAIT_S * 2.0 ** min(count, 20), _LONGEST_WAIT_S)
        if not self._all.take(now_s) and count >= _ERRORS:
            wait_s = _LONGEST_WAIT_S
        self._known[address] = count + 1, now_s + wait_s
        _keep(self._known, address)

    def forget(self, address: str) -> None:
        """Note a right token."""
        self._known.pop(address, None)


def _keep(known: OrderedDict[str, Any], address: str) -> None:
    known.move_to_end(address)
    while len(known) > _MOST_ADDRESSES:
        known.popitem(last=False)

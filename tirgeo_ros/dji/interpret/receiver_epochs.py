"""What is new in readings of a receiver that are repeated at the rate of polling.

RTK and GPS measure five times a second whatever is asked for, and say the same in between under
new stamps. Nothing in a reading numbers the epochs: they are told by their values.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isclose

#: Half of the receiver's 200 ms. What changes within this of an epoch's first change and has not
#: changed with it is the rest of that epoch: its parts may come in separate messages, and one by
#: one in the fields of a polled one.
_TOGETHER_NS = 100_000_000
#: Two roads that compute a value in another order of operations differ in the last digits; a
#: receiver's noise is far above (1e-12 rad is 6 um).
_ROUNDING = 1e-12

Value = tuple[float, ...]


class Epochs:
    """Compares the parts of each reading with those before; ``place`` is the leading one."""

    def __init__(self) -> None:
        self.begun_ns: int | None = None  # when the newest epoch was first heard of
        self._number = 0
        self._values: dict[str, Value] = {}
        self._changed: set[str] = set()
        self._given: dict[str, int] = {}  # part to the epoch in which it was news
        self._place_before: Value | None = None

    def is_late(self, stamp_ns: int, place: Value | None) -> bool:
        """Whether a place is of the epoch before: a slower road brings it after the newest."""
        if place is None or self.begun_ns is None or _same(place, self._values.get("place")):
            return False
        recent = abs(stamp_ns - self.begun_ns) < _TOGETHER_NS
        return recent and _same(place, self._place_before)

    def news(self, stamp_ns: int, parts: Mapping[str, Value]) -> set[str]:
        """The parts that are new: their value has changed, or their epoch.

        A value alone does not tell (a yaw in whole degrees stays the same for long): what comes
        with or after a change of another part is of a new epoch, once.
        """
        changed = {part for part, value in parts.items() if self._differs(part, value)}
        if changed:
            self._count(stamp_ns, changed)
            if "place" in changed:
                self._place_before = self._values.get("place")
            self._values.update(parts)
        fresh = {
            part for part in parts if part in changed or self._given.get(part) != self._number
        }
        self._given.update(dict.fromkeys(fresh, self._number))
        return fresh

    def _differs(self, part: str, value: Value) -> bool:
        return not _same(value, self._values.get(part))

    def _count(self, stamp_ns: int, changed: set[str]) -> None:
        """These parts go on with the epoch or begin another."""
        together = self.begun_ns is not None and 0 <= stamp_ns - self.begun_ns < _TOGETHER_NS
        if together and not changed & self._changed:
            self._changed |= changed
            return
        self._number += 1
        self.begun_ns = stamp_ns
        self._changed = changed


def _same(value: Value, other: Value | None) -> bool:
    if value == other:
        return True
    return other is not None and all(
        isclose(a, b, rel_tol=0, abs_tol=_ROUNDING) for a, b in zip(value, other, strict=True)
    )

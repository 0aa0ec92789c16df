"""Find what is new in readings of a receiver that are repeated at the polling rate.

RTK and GPS measure five times a second whatever rate is requested, and repeat the same values in
between under new stamps. A reading has no epoch number, so epochs are recognised by a change of
values.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import isclose

#: Half of the receiver's 200 ms. A part that changes within this of an epoch's first change, and
#: has not changed with it, belongs to the same epoch: the parts may come in separate messages, or
#: one by one in the fields of a polled message.
_TOGETHER_NS = 100_000_000
#: Two sources that compute a value in another order of operations differ in the last digits. A
#: receiver's noise is far above this (1e-12 rad is 6 um).
_ROUNDING = 1e-12

Value = tuple[float, ...]


class ReceiverEpochs:
    """Compare the parts of each reading with those before; ``place`` is the leading part."""

    def __init__(self) -> None:
        self.begun_ns: int | None = None  # when the newest epoch was first received
        self._number = 0
        self._values: dict[str, Value] = {}
        self._changed: set[str] = set()
        self._given: dict[str, int] = {}  # part to the epoch in which it was new
        self._place_before: Value | None = None

    def is_late(self, stamp_ns: int, place: Value | None) -> bool:
        """Return whether a place belongs to the epoch before, delayed by a slower source."""
        if place is None or self.begun_ns is None or _same(place, self._values.get("place")):
            return False
        recent = abs(stamp_ns - self.begun_ns) < _TOGETHER_NS
        return recent and _same(place, self._place_before)

    def news(self, stamp_ns: int, parts: Mapping[str, Value]) -> set[str]:
        """Return the parts that are new: their value has changed, or their epoch.

        The value alone is not enough (a yaw in whole degrees stays the same for long): a part that
        comes with or after a change of another part belongs to a new epoch, and is new once.
        """
        changed = {part for part in parts if not _same(parts[part], self._values.get(part))}
        if changed:
            self._begin_or_join(stamp_ns, changed)
            if "place" in changed:
                self._place_before = self._values.get("place")
            self._values.update(parts)
        given = self._given
        fresh = {part for part in parts if part in changed or given.get(part) != self._number}
        given.update(dict.fromkeys(fresh, self._number))
        return fresh

    def _begin_or_join(self, stamp_ns: int, changed: set[str]) -> None:
        """Add the changed parts to the current epoch, or begin another one."""
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

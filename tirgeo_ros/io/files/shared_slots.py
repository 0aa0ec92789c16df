"""Pass arrays to a child process through memory that both have mapped, without copies in pipes."""

from __future__ import annotations

import mmap
import os
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

#: A picture of 4K in colour. What is not used takes no memory.
_SLOT_BYTES = 25 << 20


class Place(NamedTuple):
    """Hold where an array is."""

    slot: int
    shape: tuple[int, ...]
    dtype: str


class SharedSlots:
    """Hold the newest ``number`` arrays; the next one takes the place of the oldest.

    ``descriptor`` is that of the memory, for ``SharedSlots(number, descriptor)`` in the child.
    """

    def __init__(self, number: int, descriptor: int | None = None) -> None:
        """Make the memory, or map what another process has made (Linux). Raises OSError."""
        self.descriptor = _made(number * _SLOT_BYTES) if descriptor is None else descriptor
        self._memory = mmap.mmap(self.descriptor, number * _SLOT_BYTES)
        self.number, self._next = number, 0

    def put(self, array: npt.NDArray[Any]) -> Place | None:
        """Copy an array of any shape; return its place, None if it is too large for one."""
        if array.nbytes > _SLOT_BYTES:
            return None
        place = Place(self._next, array.shape, array.dtype.str)
        self._next = (self._next + 1) % self.number
        self.get(place)[...] = array
        return place

    def get(self, place: Place) -> npt.NDArray[Any]:
        """Return the array at a place, which changes when another one is put there."""
        offset = place.slot * _SLOT_BYTES
        return np.ndarray(place.shape, np.dtype(place.dtype), self._memory, offset)

    def close(self) -> None:
        """Free the memory, once nobody uses its arrays."""
        os.close(self.descriptor)


def shared_slots(number: int) -> SharedSlots | None:
    """Return new slots; None where the system gives none, as under ``ulimit -f``."""
    try:
        return SharedSlots(number)
    except OSError:
        return None


def _made(size: int) -> int:
    descriptor = os.memfd_create("tirgeo")
    try:
        os.ftruncate(descriptor, size)
    except OSError:
        os.close(descriptor)
        raise
    return descriptor

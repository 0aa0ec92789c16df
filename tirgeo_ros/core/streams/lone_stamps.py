"""Find the stamps of a stream that jump alone: a wrong digit, not a clock that was set."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.types.arrays import BoolArray, IntArray

#: A stamp jumps if it is this far from the median of the five about it, which two steps are not.
_LEAST_NS, _LEAST_STEPS = 1_000_000_000, 3


def lone_stamps(stamps_ns: Sequence[int] | IntArray) -> BoolArray:
    """Return which stamps (N,) are far from those beside them; none of fewer than five.

    After a gap, or when a clock is set, there are others of the same time beside a stamp.
    """
    stamps = np.asarray(stamps_ns, np.int64)
    if len(stamps) < 5:
        return np.zeros(len(stamps), bool)
    near = np.sort(np.lib.stride_tricks.sliding_window_view(stamps, 5))
    steps = np.sort(np.diff(near))[:, 1]
    medians, steps = (np.pad(each, 2, mode="edge") for each in (near[:, 2], steps))
    return np.asarray(np.abs(stamps - medians) > np.maximum(_LEAST_NS, _LEAST_STEPS * steps))

"""Estimate the line below a stream of points whose delay only ever adds.

``x`` is a time of one clock, ``y`` the arrival by another clock minus ``x``. The smallest values
of ``y`` lie on a line, whose slope is the drift between the two clocks; all else is delay. The
line here has the learned slope and is the highest one that no point of the last window lies below.
The slope is that of the lower convex hull's edge over the middle of a longer time (Moon, Skelley,
Towsley 1999, and Zhang, Liu, Xia 2002, take that edge for the skew of two clocks).

With the slope, a minimum stays valid for all of the window. A windowed minimum without the slope
lags by drift times window, and jumps when it leaves the window.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise

#: The time that the drift is learned from is divided into this many bins; each keeps its lowest
#: point.
_BINS = 64
#: Drift is learned from three windows, limited to this range.
_DRIFT_NS = 30e9, 300e9
#: Prior sigma of a change of the slope, as a share of the largest drift, and sigma of a minimum.
#: Their quotient is the length of a stretch from which its own slope gets more weight than the old
#: one.
_USUAL_DRIFT, _MINIMUM_NS = 0.3, 0.2e6
#: Largest number of heights above the line that make the distribution: 500 a second for 20 s.
_HEIGHTS = 10_000

_INFINITY = float("inf")

Point = tuple[float, float]


class LowerEnvelope:
    """Track the line below the points of the last window; x and y in nanoseconds.

    ``max_drift`` bounds the slope in both directions. A point costs about a microsecond; once per
    bin the ``_BINS`` lowest points are looked at again.
    """

    def __init__(self, window_ns: float, max_drift: float) -> None:
        self._window_ns = window_ns
        self._max_drift = max_drift
        shortest, longest = _DRIFT_NS
        self._memory_ns = max(shortest, window_ns, min(3 * window_ns, longest))
        self._width_ns = self._memory_ns / _BINS
        self.drift = self._drift_before = 0.0  # slope of the line
        self.base = 0.0  # the line is ``base + drift * x``
        self._bins: deque[Point] = deque()  # the lowest point of each closed bin
        self._heights: deque[Point] = deque(maxlen=_HEIGHTS)  # x, and height above the line
        self._bin_end = 0.0
        self._lowest_key, self._lowest = _INFINITY, (0.0, 0.0)  # of the open bin

    def begin(self, x: float, y: float) -> None:
        """Forget all points; put the line through this one with the slope learned so far."""
        self._bins.clear()
        self._heights.clear()
        self._drift_before = self.drift
        self.base = y - self.drift * x
        self._open(x)

    def add(self, x: float, y: float) -> None:
        """Take a point. ``x`` may go back a little, within the width of one bin."""
        if x >= self._bin_end:
            self._close(x)
        key = y - self.drift * x
        height = key - self.base
        if key < self._lowest_key:
            self._lowest_key, self._lowest = key, (x, y)
            if height < 0.0:
                self.base = key
        self._heights.append((x, height))

    @property
    def spread(self) -> tuple[float, float, float] | None:
        """Return median, 95 % quantile and maximum of the window's heights (ns), if any."""
        if not self._heights:
            return None
        oldest = self._heights[-1][0] - self._window_ns
        heights = sorted(max(height, 0.0) for x, height in self._heights if x >= oldest)
        last = len(heights) - 1
        return heights[last // 2], heights[round(0.95 * last)], heights[last]

    def _open(self, x: float) -> None:
        """Begin a bin."""
        self._bin_end = x + self._width_ns
        self._lowest_key, self._lowest = _INFINITY, (x, 0.0)

    def _close(self, x: float) -> None:
        """Close the open bin; learn the slope and compute the line again."""
        is_used = self._lowest_key < _INFINITY
        if is_used and (not self._bins or self._lowest[0] > self._bins[-1][0]):
            self._bins.append(self._lowest)
        while self._bins and self._bins[0][0] < x - self._memory_ns:
            self._bins.popleft()
        self._learn_drift()
        self._refit_line(x)
        self._open(x)

    def _learn_drift(self) -> None:
        span = self._bins[-1][0] - self._bins[0][0] if self._bins else 0.0
        if span <= 0.0:
            return
        slope = middle_slope([*self._bins])
        slope = min(max(slope, -self._max_drift), self._max_drift)
        known, measured = (_USUAL_DRIFT * self._max_drift * span) ** 2, _MINIMUM_NS**2
        trust = known / (known + measured)
        self.drift = self._drift_before + trust * (slope - self._drift_before)

    def _refit_line(self, x: float) -> None:
        """Set the line to the highest one of the learned slope below all points of the window."""
        begun = x - self._window_ns
        keys = [low_y - self.drift * low_x for low_x, low_y in self._bins if low_x >= begun]
        if keys:
            self.base = min(keys)


def middle_slope(points: list[Point]) -> float:
    """Return the slope of the lower hull's edge over the middle.

    ``points``: at least two, by increasing x.
    """
    hull: list[Point] = []
    for point in points:
        while len(hull) > 1 and _is_above(hull[-2], hull[-1], point):
            hull.pop()
        hull.append(point)
    middle = (points[0][0] + points[-1][0]) / 2
    (x0, y0), (x1, y1) = next(edge for edge in pairwise(hull) if edge[1][0] >= middle)
    return (y1 - y0) / (x1 - x0)


def _is_above(first: Point, middle: Point, last: Point) -> bool:
    """Return whether the middle point is on or above the line from the first to the last."""
    (x0, y0), (x1, y1), (x2, y2) = first, middle, last
    return (y1 - y0) * (x2 - x0) >= (y2 - y0) * (x1 - x0)

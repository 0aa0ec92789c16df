"""Fade lines by the uncertainty of their position.

A short line has one opacity; a longer one is cut where its opacity changes.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.map.polylines import Polylines, joined
from tirgeo_ros.core.map.visibility import VisibleLines
from tirgeo_ros.core.overlay.line_sampling import STEP_PX, Samples, cut, picked, sampled, short
from tirgeo_ros.core.types.arrays import Array, IntArray


class _Along(NamedTuple):
    """Hold the longer lines and their intervals from sample to sample."""

    lines: VisibleLines
    samples: Samples
    ways: IntArray  # (W,) index of the sample at which each interval begins


class Fading(NamedTuple):
    """Hold lines, with the points at which their opacity is needed."""

    rays: Array  # (3, N) as in Seen: of the short lines, then of the longer lines' intervals
    owner: IntArray  # (N,) features
    few: VisibleLines  # the short lines
    along: _Along | None

    @classmethod
    def of(cls, lines: VisibleLines) -> Fading:
        """Choose the points: a middle vertex of a short line, else the middles of intervals."""
        whole = short(lines)
        if whole.all():
            return cls(_half_way(lines), lines.owner, lines, None)
        few, many = picked(lines, np.flatnonzero(whole)), picked(lines, np.flatnonzero(~whole))
        many, samples = sampled(many, STEP_PX)
        ways = np.flatnonzero(samples.links())
        first, last = samples.vertex[ways], samples.vertex[ways + 1]
        middle = (many.rays.take(first, axis=1) + many.rays.take(last, axis=1)) / 2
        rays = np.concatenate([_half_way(few), middle], axis=1)
        owner = np.concatenate([few.owner, many.owner[samples.line[ways]]])
        return cls(rays, owner, few, _Along(many, samples, ways))

    def cut(self, opacity: Array) -> tuple[Polylines, Array]:
        """Return the lines, cut where the opacity (N,) of their points changes, and its values."""
        if self.along is None:
            return self.few, opacity
        lines, samples, ways = self.along
        of_short, of_ways = np.split(opacity, [len(self.few)])
        along = np.ones(len(samples.line) - 1)
        along[ways] = of_ways
        parts, way = cut(lines, samples, along)
        return joined(parts, self.few), np.concatenate([along[way], of_short])


def _half_way(lines: VisibleLines) -> Array:
    return lines.rays.take((lines.starts[:-1] + lines.starts[1:]) // 2, axis=1)

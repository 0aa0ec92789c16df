"""Whether the memory of each process stays as it is after the first minute of its life."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from pathlib import Path

import numpy as np

from tirgeo_ros.tools.plots import COLOURS, figure, png
from tirgeo_ros.tools.soak.lives import Life

SETTLED_S = 60.0
#: Means over so long are compared: single samples show what a frame borrows.
_BLOCK_S = 15.0
Sample = tuple[float, int, int]  # seconds of life, bytes resident, bytes of them shared


def growth(samples: Sequence[Sample]) -> float | None:
    """The largest mean of a later block over that of the first settled one, less 1.

    None for a life that was too short to have a later one.
    """
    means = []
    for number in count():
        begin_s = SETTLED_S + number * _BLOCK_S
        block = [rss for t_s, rss, _ in samples if begin_s <= t_s < begin_s + _BLOCK_S]
        if not block or samples[-1][0] < begin_s + _BLOCK_S:
            break
        means.append(float(np.mean(block)))
    return max(means[1:]) / means[0] - 1 if len(means) > 1 else None


def worst_growth(lives: Sequence[Life]) -> dict[str, float | None]:
    """By node the largest growth of its lives; None where each was too short to tell."""
    found: dict[str, float | None] = {}
    for life in lives:
        grown, before = growth(life.memory), found.get(life.node)
        known = [value for value in (grown, before) if value is not None]
        found[life.node] = max(known, default=None)
    return found


def plot_memory(lives: Sequence[Life], path: Path) -> None:
    """A picture (PNG) of the resident memory of all lives over the time of the soak."""
    begin_s = min(life.began_s for life in lives)
    nodes = list(dict.fromkeys(life.node for life in lives))
    made, axes = figure(9.0, 5.0)
    for life in lives:
        times = [(life.began_s - begin_s + t_s) / 60 for t_s, _, _ in life.memory]
        number = nodes.index(life.node)
        first = next(other for other in lives if other.node == life.node) is life
        axes.plot(
            times,
            [rss * 2**-20 for _, rss, _ in life.memory],
            color=COLOURS[number],
            label=life.node if first else None,
        )
    axes.set(xlabel="time of the soak [min]", ylabel="resident memory [MiB]", ylim=(0, None))
    axes.legend(loc="lower right", ncols=2)
    path.write_bytes(png(made))

"""Whether the memory of each process stays as it is after the first minute of its life.

A process's own memory is judged: what is resident, less the pages of shared memory. These are all
of Fast DDS's segments, each of which the process that makes it fills whole at its start; a reader
counts those pages of a peer's segment as resident that it has ever read from. docs/soak.md tells
why they become more where a peer is killed, and the table how many did.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np

from dev.soak.lives import Life
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png

SETTLED_S = 60.0
#: Means over so long are compared: single samples show what a frame borrows.
_BLOCK_S = 15.0
Sample = tuple[float, int, int]  # seconds of life, bytes resident, bytes of them shared


@dataclass(frozen=True)
class Growth:
    """How much more memory a process has later than after its first minute: parts of that."""

    own: float
    resident: float  # with the pages of shared memory that it has touched


def growth(samples: Sequence[Sample]) -> Growth | None:
    """The growth of one life, None where it was too short to have a later block."""
    means: list[Array] = []  # own and resident bytes of each block
    for number in count():
        begin_s = SETTLED_S + number * _BLOCK_S
        block = [sample for sample in samples if begin_s <= sample[0] < begin_s + _BLOCK_S]
        if not block or samples[-1][0] < begin_s + _BLOCK_S:
            break
        _, resident, shared = np.mean(block, axis=0)
        means.append(np.array([resident - shared, resident]))
    return Growth(*(np.max(means[1:], axis=0) / means[0] - 1)) if len(means) > 1 else None


def worst_growth(lives: Sequence[Life]) -> dict[str, Growth | None]:
    """By node the largest growth of its lives; None where each was too short to tell."""
    by_node: dict[str, list[Growth]] = {life.node: [] for life in lives}
    for life in lives:
        if (grown := growth(life.memory)) is not None:
            by_node[life.node].append(grown)
    return {
        node: Growth(max(g.own for g in grown), max(g.resident for g in grown)) if grown else None
        for node, grown in by_node.items()
    }


def plot_memory(lives: Sequence[Life], path: Path) -> None:
    """A picture (PNG) of the memory of all lives over the time of the soak.

    Their own in full colour; what is resident in all, with shared memory, pale.
    """
    begin_s = min(life.began_s for life in lives)
    nodes = list(dict.fromkeys(life.node for life in lives))
    made, axes = figure(9.0, 5.0)
    for life in lives:
        times = [(life.began_s - begin_s + t_s) / 60 for t_s, _, _ in life.memory]
        number = nodes.index(life.node)
        first = next(other for other in lives if other.node == life.node) is life
        resident, shared = np.array(life.memory, float).reshape(-1, 3)[:, 1:].T * 2**-20
        label = life.node if first else None
        axes.plot(times, resident - shared, color=COLOURS[number], label=label)
        axes.plot(times, resident, color=COLOURS[number], alpha=0.3)
    axes.set(xlabel="time of the soak [min]", ylabel="memory, pale: with shared [MiB]")
    axes.set_ylim(0, None)
    axes.legend(loc="lower right", ncols=2)
    path.write_bytes(png(made))

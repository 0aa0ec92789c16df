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

import numpy as np

from dev.soak.lives import Life
from tirgeo_ros.core.types.arrays import Array

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

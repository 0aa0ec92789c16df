"""What happens to the graph and when: drawn from a seed, each kind in each round once."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

#: What every soak starts; the witness is not touched.
NODES = ("ekf_node", "gimbal_node", "overlay_node", "soak_mute", "soak_player")
#: All nodes settle before the first, and after the last.
_QUIET_S, _END_S = 12.0, 8.0
_APART_S = (8.0, 16.0)


class Kind(Enum):
    """What happens."""

    KILL = "killed by SIGKILL, started again"
    STOP = "stopped by SIGSTOP, continued"
    JUMP = "the clock jumps"
    BUSY = "two busy processes"


@dataclass(frozen=True)
class Event:
    """One thing that happens; seconds since the graph was ready."""

    at_s: float
    kind: Kind
    node: str = ""  # the one it happens to
    lasts_s: float = 0.0  # until it is started again, continued, or quiet again


def schedule(seed: int, duration_s: float) -> list[Event]:
    """The events of a soak, in order of time; a short one has closer ones."""
    rng = random.Random(seed)  # noqa: S311 no secret
    closer = min(1.0, duration_s / 120.0)
    events: list[Event] = []
    at_s = _QUIET_S * closer
    for kind, node in _rounds(rng):
        lasts_s = closer * rng.uniform(*_LASTS_S[kind])
        if at_s + lasts_s > duration_s - _END_S * closer:
            return events
        events.append(Event(at_s, kind, node, lasts_s))
        at_s += lasts_s + closer * rng.uniform(*_APART_S)
    raise AssertionError("the rounds have no end")


_LASTS_S = {
    Kind.KILL: (0.5, 3.0),
    Kind.STOP: (0.5, 8.0),
    Kind.JUMP: (0.0, 0.0),
    Kind.BUSY: (5.0, 25.0),
}


def _rounds(rng: random.Random) -> Iterator[tuple[Kind, str]]:
    """All that can happen, in a new order each time."""
    everything = [(kind, node) for kind in (Kind.KILL, Kind.STOP) for node in NODES]
    everything += [(Kind.JUMP, ""), (Kind.JUMP, ""), (Kind.BUSY, ""), (Kind.BUSY, "")]
    while True:
        yield from rng.sample(everything, len(everything))

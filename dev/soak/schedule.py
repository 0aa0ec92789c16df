"""What happens to the graph and when: drawn from a seed, each kind in each round once."""

from __future__ import annotations

import random
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum

#: What every soak starts; the witness is not touched.
NODES = ("ekf_node", "gimbal_node", "overlay_node", "soak_mute", "soak_player")
#: A second soak_mute, which lives to be killed in the minute in which others settle.
GUEST = "soak_guest"
#: All nodes settle before the first, and after the last.
_QUIET_S, _END_S = 12.0, 8.0
_APART_S = (8.0, 16.0)
#: The queues of 800 messages (``nodes.qos``) are full after 4 s of the IMU at twice real time; a
#: reader that stands still for 5 s is given up by its senders (``config/fastdds.xml``).
_RUN_IN_STOP_S, _RUN_IN_APART_S = 4.2, 4.0


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
    for kind, node, lasts_s, apart_s in _happenings(rng):
        end_s = at_s + closer * lasts_s
        if end_s > duration_s - _END_S * closer:
            return events
        events.append(Event(at_s, kind, node, closer * lasts_s))
        at_s = end_s + closer * apart_s
    raise AssertionError("the rounds have no end")


_LASTS_S = {
    Kind.KILL: (0.5, 3.0),
    Kind.STOP: (0.5, 8.0),
    Kind.JUMP: (0.0, 0.0),
    Kind.BUSY: (5.0, 25.0),
}
_Happening = tuple[Kind, str, float, float]  # and for how long, and how long it is quiet then


def _happenings(rng: random.Random) -> Iterator[_Happening]:
    """All that can happen, in a new order each round; those who have just begun are run in."""
    yield from _run_in("ekf_node", "gimbal_node", "overlay_node")
    everything = [(kind, node) for kind in (Kind.KILL, Kind.STOP) for node in NODES]
    everything += [(Kind.JUMP, ""), (Kind.JUMP, ""), (Kind.BUSY, ""), (Kind.BUSY, "")]
    while True:
        for kind, node in rng.sample(everything, len(everything)):
            killed = kind is Kind.KILL
            quiet_s = _QUIET_S if killed else rng.uniform(*_APART_S)
            yield kind, node, rng.uniform(*_LASTS_S[kind]), quiet_s
            if killed:
                yield from _run_in(node)


def _run_in(*nodes: str) -> Iterator[_Happening]:
    """One of each kind within the first minute of a life.

    The longest queue, and the most peers at a time of which DDS must know, take memory that is
    kept and used again: a mark that is reached once. docs/soak.md has the figures.
    """
    for node in nodes:
        yield Kind.STOP, node, _RUN_IN_STOP_S, _RUN_IN_APART_S
    yield Kind.KILL, GUEST, 0.5, _RUN_IN_APART_S
    yield Kind.JUMP, "", 0.0, _RUN_IN_APART_S
    yield Kind.KILL, GUEST, 0.5, _RUN_IN_APART_S
    yield Kind.BUSY, "", 5.0, _QUIET_S

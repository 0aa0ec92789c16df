# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Run the graph on the soak's flight while processes are killed and stopped, and clocks jump.

What happens when is drawn from a seed, each kind in each round once. Each life of each node is
noted with its memory, and what it leaves behind.
"""

from __future__ import annotations

import contextlib
import json
import os
import random
import re
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from enum import Enum
from itertools import count
from operator import itemgetter
from pathlib import Path

from dev.flights import SOAK_PERIOD_S, SoakFlight
from dev.graphs import Graph, busy, memory_mib, started_graph
from tirgeo_ros.tools.graph.node_graph import NodeProcess, await_words
from tirgeo_ros.tools.presentation.progress import Report, silent

#: What every soak starts; the witness is not touched.
NODES = ("ekf_node", "gimbal_node", "overlay_node", "soak_mute", "soak_player")
WITNESS = "soak_witness"
LEDGER, RECORD = "ledger.txt", "record.jsonl"
#: Each player that is started has so many numbers of epochs for itself.
EPOCHS = 1000
RATE = 2.0

#: All nodes settle before the first, and after the last.
_QUIET_S, _END_S = 12.0, 8.0
_APART_S = (8.0, 16.0)
#: Queues of 800 messages (``STREAM_DEPTH``) are full after 4 s of the IMU at twice real time; a
#: reader that stands still for 5 s is given up by its senders (``config/fastdds.xml``).
_RUN_IN_STOP_S, _RUN_IN_APART_S = 4.2, 4.0
_TICK_S, _SAMPLE_S = 0.05, 1.0
#: After the last frame: the last report of each node comes within a second.
_SETTLE_S, _STOP_S = 5.0, 15.0
#: A player that starts again is so much earlier each time, as one that begins a bag anew.
_BACK_MS = -70_000
_AWAITED = "imu/data,thermal/camera_info,thermal/image_raw/compressed"
#: So deep that the witness sees every pose.
_DEEP = {"/tirgeo/camera_pose": {"publisher": {"depth": 300}}}

_SHARED = Path("/dev/shm")  # noqa: S108 where Fast DDS puts its files
_SEGMENT = re.compile(r"fastrtps_[0-9a-f]{16}(_el)?")
#: Names the soak in the environment of all that it starts, their children too.
_MARK = "TIRGEO_SOAK"


class Kind(Enum):
    """Say what happens."""

    KILL = "killed by SIGKILL, started again"
    STOP = "stopped by SIGSTOP, continued"
    JUMP = "the clock jumps"
    BUSY = "two busy processes"


_LASTS_S = {
    Kind.KILL: (0.5, 3.0),
    Kind.STOP: (0.5, 8.0),
    Kind.JUMP: (0.0, 0.0),
    Kind.BUSY: (5.0, 25.0),
}


@dataclass(frozen=True)
class Event:
    """Hold one thing that happens; seconds since the graph was ready."""

    at_s: float
    kind: Kind
    node: str = ""  # the one it happens to
    lasts_s: float = 0.0  # until it is started again, continued, or quiet again


def schedule(seed: int, duration_s: float) -> list[Event]:
    """Return the events of a soak, in order of time; a short one has closer ones."""
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


_Happening = tuple[Kind, str, float, float]  # and for how long, and how long it is quiet then


def _happenings(rng: random.Random) -> Iterator[_Happening]:
    """Yield all that can happen, in a new order each round; what has just begun is run in."""
    yield from _run_in("ekf_node", "gimbal_node", "overlay_node")
    everything = [(kind, node) for kind in (Kind.KILL, Kind.STOP) for node in NODES]
    everything += [(Kind.JUMP, ""), (Kind.JUMP, ""), (Kind.BUSY, ""), (Kind.BUSY, "")]
    while True:
        for kind, node in rng.sample(everything, len(everything)):
            lasts_s, apart_s = rng.uniform(*_LASTS_S[kind]), rng.uniform(*_APART_S)
            yield kind, node, lasts_s, apart_s
            if kind is Kind.KILL:
                yield from _run_in(node)


def _run_in(*nodes: str) -> Iterator[_Happening]:
    """Yield one of each kind within the first minute of a life.

    The longest queue, and the most peers at a time of which DDS must know, take memory that is
    kept and used again: a mark that is reached once. docs/soak.md has the figures.
    """
    for node in nodes:
        yield Kind.STOP, node, _RUN_IN_STOP_S, _RUN_IN_APART_S
    yield Kind.KILL, "soak_mute", 0.5, _RUN_IN_APART_S
    yield Kind.JUMP, "", 0.0, _RUN_IN_APART_S
    yield Kind.KILL, "soak_mute", 0.5, _RUN_IN_APART_S
    yield Kind.BUSY, "", 5.0, _QUIET_S


@dataclass
class Life:
    """Hold one process of a node, from its start to its end; times by the steady clock."""

    node: str
    process: NodeProcess
    began_s: float
    killed: bool = False
    ended_s: float | None = None
    #: Seconds of life, and bytes resident but for those that are shared with others.
    memory: list[tuple[float, int]] = field(default_factory=list)


class Lives:
    """Start nodes again and again, and note what each life takes of memory."""

    def __init__(self, graph: Graph, arguments: Mapping[str, Sequence[str]]) -> None:
        """Take a graph without nodes, and the arguments by node."""
        self.all: list[Life] = []
        self.by_themselves: list[str] = []  # last words of those that ended without being asked
        self._graph, self._arguments = graph, arguments
        graph.environment[_MARK] = str(os.getpid())
        self._own: set[str] = set()  # segments that lives have made or used

    def start(self, node: str, *more: str) -> Life:
        """Begin a life."""
        number = sum(life.node == node for life in self.all)
        words = [*self._arguments[node], *more]
        process = self._graph.start(node, words=words, log=f"{node}.{number}")
        self.all.append(Life(node, process, time.monotonic()))
        return self.all[-1]

    def current(self, node: str) -> Life:
        """Return the newest life of a node."""
        return next(life for life in reversed(self.all) if life.node == node)

    def kill(self, node: str) -> None:
        """End a life with no chance to say a word."""
        self.sample()
        life = self.current(node)
        life.killed = True
        life.process.signal(signal.SIGKILL)
        life.process.wait(5.0)
        life.ended_s = time.monotonic()

    def sample(self) -> None:
        """Note the memory of all that live, and the shared memory that they hold."""
        now_s = time.monotonic()
        for life in self.all:
            if life.ended_s is None and life.process.poll() is None:
                with contextlib.suppress(OSError):
                    life.memory.append((now_s - life.began_s, _own_bytes(life.process.pid)))
                    self._own |= held_by(life.process.pid)

    def ended(self) -> list[Life]:
        """Note and return those that have ended by themselves since the last call."""
        new = [
            life for life in self.all if life.ended_s is None and life.process.poll() is not None
        ]
        for life in new:
            life.ended_s = time.monotonic()
            self.by_themselves.append(f"{life.node}: {life.process.why_ended()}")
        return new

    def stop(self) -> None:
        """End all that live as a user would, and note those that do not end well.

        The player ends first, so that the others' last reports tell of its last frame.
        """
        player = self.current("soak_player")
        player.process.signal(signal.SIGINT)
        if player.process.wait(_STOP_S) is not None:
            player.ended_s = time.monotonic()
        time.sleep(_SETTLE_S)
        self.sample()
        living = [life for life in self.all if life.ended_s is None]
        for life in living:
            life.process.signal(signal.SIGCONT)
            life.process.signal(signal.SIGINT)
        for life in living:
            ended = life.process.wait(_STOP_S)
            life.ended_s = time.monotonic()
            if ended is None or ended.exit_code:
                how = f"exit code {ended.exit_code}" if ended else f"not in {_STOP_S:g} s"
                self.by_themselves.append(f"{life.node}: asked to stop: {how}")

    def left_files(self) -> list[str]:
        """Return the segments of shared memory that lives have left."""
        return sorted(self._own & shared_files())

    def left_processes(self) -> list[int]:
        """Return processes that bear the mark of this soak and still run."""
        mark, left = f"{_MARK}={os.getpid()}".encode(), []
        for path in Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):  # it may have ended, or be another user's
                left += [int(path.parent.name)] * (mark in path.read_bytes().split(b"\0"))
        return left


def shared_files() -> set[str]:
    """Return Fast DDS's segments in shared memory and their locks, of everybody here.

    Its ports, which all domains share and it renews itself, are left out.
    """
    return {path.name for path in _SHARED.iterdir() if _SEGMENT.fullmatch(path.name)}


def held_by(pid: int) -> set[str]:
    """Return the segments and locks that a process has mapped or open."""
    mapped = Path(f"/proc/{pid}/maps").read_text().splitlines()
    links = []
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(OSError):
            links.append(str(entry.readlink()))
    names = {line.removesuffix(" (deleted)").rpartition("/")[2] for line in (*mapped, *links)}
    return {name for name in names if _SEGMENT.fullmatch(name)}


def _own_bytes(pid: int) -> int:
    """Return the bytes resident, less those of shared memory (proc(5), status)."""
    return round(2**20 * (memory_mib(pid) - memory_mib(pid, "RssShmem")))


def run_soak(
    flight: SoakFlight,
    events: list[Event],
    folder: Path,
    duration_s: float,
    progress: Report = silent,
) -> Lives:
    """Start all, let the events happen, stop all. Whatever happens, no process is left.

    LEDGER and RECORD are left in the folder. Raises GraphError for a node that does not start.
    """
    (folder / LEDGER).unlink(missing_ok=True)
    with started_graph(folder / "logs") as graph:
        lives = Lives(graph, _arguments(flight, folder))
        for node in (WITNESS, *NODES):
            lives.start(node)
        await_words(graph.processes, "ready")
        await_words([lives.current("soak_player").process], "playing")
        _happen(lives, events, duration_s, progress)
        lives.stop()
    return lives


def _arguments(flight: SoakFlight, folder: Path) -> dict[str, list[str]]:
    deep = folder / "deep.yaml"
    deep.write_text(f"/**: {json.dumps({'ros__parameters': {'qos_overrides': _DEEP}})}\n")
    sim = ["-p", "use_sim_time:=true"]
    common = [*sim, "--params-file", str(flight.folder / "params.yaml")]
    player = {"bag": flight.bag, "rate": RATE, "period_s": SOAK_PERIOD_S}
    player |= {"wait_for": _AWAITED, "ledger": folder / LEDGER}
    return {
        "ekf_node": common,
        "gimbal_node": [*common, "--params-file", str(deep)],
        "overlay_node": [*common, "-p", f"map:={flight.folder / 'map.geojson'}"],
        "soak_player": [w for key, value in player.items() for w in ("-p", f"{key}:={value}")],
        "soak_mute": sim,
        WITNESS: [*sim, "-p", f"output:={folder / RECORD}"],
    }


def _happen(lives: Lives, events: Sequence[Event], duration_s: float, progress: Report) -> None:
    """Do what is due, for so long; a node that ends by itself is started again."""
    players = count(1)

    def start(node: str) -> None:
        more: list[str] = []
        if node == "soak_player":
            number = next(players)
            values = {"first_epoch": number * EPOCHS, "shift_ms": number * _BACK_MS}
            more = [word for key, value in values.items() for word in ("-p", f"{key}:={value}")]
        lives.start(node, *more)

    def jump() -> None:
        player = lives.current("soak_player").process
        if player.said("playing"):  # before it plays the signal would end it
            player.signal(signal.SIGUSR1)

    def send(node: str, number: int) -> None:
        lives.current(node).process.signal(number)

    with ExitStack() as loads:
        steps: dict[Kind, tuple[Callable[[str], object], Callable[[str], object]]] = {
            Kind.KILL: (lives.kill, start),
            Kind.STOP: (lambda n: send(n, signal.SIGSTOP), lambda n: send(n, signal.SIGCONT)),
            Kind.JUMP: (lambda _: jump(), lambda _: None),
            Kind.BUSY: (lambda _: loads.enter_context(busy(2)), lambda _: loads.close()),
        }
        todo = [(e.at_s, steps[e.kind][0], e.node) for e in events]
        todo += [(e.at_s + e.lasts_s, steps[e.kind][1], e.node) for e in events]
        todo.sort(key=itemgetter(0))
        begun_s, sampled_s = time.monotonic(), 0.0
        while (now_s := time.monotonic() - begun_s) < duration_s:
            progress(now_s, duration_s)
            while todo and todo[0][0] <= now_s:
                _, step, node = todo.pop(0)
                step(node)
            if now_s - sampled_s >= _SAMPLE_S:
                sampled_s = now_s
                lives.sample()
                for life in lives.ended():
                    start(life.node)
            time.sleep(_TICK_S)

"""Runs the graph on the soak's flight while the schedule's events happen to it."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from dev.bench_dds import busy
from dev.soak.flight import PERIOD_S, SoakFlight
from dev.soak.lives import Lives
from dev.soak.records import EPOCHS
from dev.soak.schedule import GUEST, NODES, Event, Kind
from tirgeo_ros.tools.graph.node_graph import (
    GraphSetup,
    await_words,
    graph_environment,
    node_processes,
)
from tirgeo_ros.tools.presentation.progress import Report, silent

RATE = 2.0
WITNESS = "soak_witness"
_TICK_S, _SAMPLE_S = 0.05, 1.0
#: After the last frame: the last report of each node comes within a second.
_SETTLE_S, _STOP_S = 5.0, 15.0
#: A player that starts again is so much earlier each time, as one that begins a bag anew.
_BACK_MS = -70_000
_AWAITED = "imu/data,thermal/camera_info,thermal/image_raw/compressed"
#: So deep that the witness sees every pose.
_DEEP = {"/tirgeo/camera_pose": {"publisher": {"depth": 300}}}


@dataclass(frozen=True)
class SoakRun:
    """What is left of a soak: its files, and its processes' lives."""

    lives: Lives
    ledger: Path
    record: Path
    left_files: list[str]
    left_processes: list[int]


def run_soak(
    flight: SoakFlight,
    events: list[Event],
    folder: Path,
    duration_s: float,
    progress: Report = silent,
) -> SoakRun:
    """Start all, let the events happen, stop all. Whatever happens, no process is left.

    Raises GraphError for a node that does not start.
    """
    environment = graph_environment(GraphSetup(flight.bag, folder))
    (folder / "logs").mkdir(parents=True, exist_ok=True)
    ledger, record = folder / "ledger.txt", folder / "record.jsonl"
    ledger.unlink(missing_ok=True)
    lives = Lives(_arguments(flight, folder, ledger, record), environment, folder / "logs")
    with node_processes() as processes:
        lives.processes = processes
        for node in (WITNESS, *NODES, GUEST):
            lives.start(node)
        await_words(processes, "ready")
        await_words([lives.current("soak_player").process], "playing")
        _Soak(lives, events).last(duration_s, progress)
        _stop(lives)
    return SoakRun(lives, ledger, record, lives.left_files(), lives.left_processes())


def _arguments(
    flight: SoakFlight, folder: Path, ledger: Path, record: Path
) -> dict[str, list[str]]:
    deep = folder / "deep.yaml"
    deep.write_text(f"/**: {json.dumps({'ros__parameters': {'qos_overrides': _DEEP}})}\n")
    sim = ["-p", "use_sim_time:=true"]
    common = [*sim, "--params-file", str(flight.folder / "params.yaml")]
    player = {"bag": flight.bag, "rate": RATE, "period_s": PERIOD_S, "ledger": ledger}
    player |= {"wait_for": _AWAITED}
    return {
        "ekf_node": common,
        "gimbal_node": [*common, "--params-file", str(deep)],
        "overlay_node": [*common, "-p", f"map:={flight.folder / 'map.geojson'}"],
        "soak_player": [w for key, value in player.items() for w in ("-p", f"{key}:={value}")],
        "soak_mute": sim,
        GUEST: sim,
        WITNESS: [*sim, "-p", f"output:={record}"],
    }


def _stop(lives: Lives) -> None:
    """End the player first, so that the others' last reports tell of its last frame."""
    player = lives.current("soak_player")
    player.process.signal(signal.SIGINT)
    if player.process.wait(_STOP_S) is not None:
        player.ended_s = time.monotonic()
    time.sleep(_SETTLE_S)
    lives.sample()
    lives.stop(_STOP_S)


class _Soak:
    """The time between the first and the last message."""

    def __init__(self, lives: Lives, events: list[Event]) -> None:
        self._lives = lives
        self._todo: list[tuple[float, Callable[[], object]]] = []
        self._players = 0
        self._busy = ExitStack()
        for event in events:
            self._todo += self._steps(event)
        self._todo.sort(key=lambda step: step[0])

    def last(self, duration_s: float, progress: Report) -> None:
        """Do what is due, for so long; a node that ends by itself is started again."""
        begun_s, sampled_s = time.monotonic(), 0.0
        with self._busy:
            while (now_s := time.monotonic() - begun_s) < duration_s:
                progress(now_s, duration_s)
                while self._todo and self._todo[0][0] <= now_s:
                    self._todo.pop(0)[1]()
                if now_s - sampled_s >= _SAMPLE_S:
                    sampled_s = now_s
                    self._lives.sample()
                    for life in self._lives.ended():
                        self._start(life.node)
                time.sleep(_TICK_S)

    def _steps(self, event: Event) -> list[tuple[float, Callable[[], object]]]:
        """What is to be done when: the begin of an event, and its end."""
        node, end_s = event.node, event.at_s + event.lasts_s
        if event.kind is Kind.JUMP:
            return [(event.at_s, self._jump)]
        begin, end = {
            Kind.KILL: (lambda: self._kill(node), lambda: self._start(node)),
            Kind.STOP: (
                lambda: self._signal(node, signal.SIGSTOP),
                lambda: self._signal(node, signal.SIGCONT),
            ),
            Kind.BUSY: (lambda: self._busy.enter_context(busy(2)), self._busy.close),
        }[event.kind]
        return [(event.at_s, begin), (end_s, end)]

    def _signal(self, node: str, number: int) -> None:
        self._lives.current(node).process.signal(number)

    def _jump(self) -> None:
        # Before it plays the signal would end it.
        if self._lives.current("soak_player").process.said("playing"):
            self._signal("soak_player", signal.SIGUSR1)

    def _kill(self, node: str) -> None:
        self._lives.sample()
        self._lives.kill(node)

    def _start(self, node: str) -> None:
        more: list[str] = []
        if node == "soak_player":
            self._players += 1
            values = {"first_epoch": self._players * EPOCHS, "shift_ms": self._players * _BACK_MS}
            more = [word for key, value in values.items() for word in ("-p", f"{key}:={value}")]
        self._lives.start(node, *more)

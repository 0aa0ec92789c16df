"""The whole node graph as separate processes over DDS, with a bag played through it."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import time
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.stop_signals import stop_signals
from tirgeo_ros.io.messages import SENSED_TOPICS
from tirgeo_ros.tools.graph.localhost import localhost_environment
from tirgeo_ros.tools.graph.node_process import NodeProcess
from tirgeo_ros.tools.graph.resources import find_resource
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_topics import PICTURES

_READY_TIMEOUT_S = 60.0
_STOP_TIMEOUT_S = 15.0
#: After the bag: the last diagnostics come within 1 s, and what a reader lost of the last pictures
#: is sent again at the writer's heartbeat, every 3 s.
_SETTLE_S = 3.5
_POLL_S = 0.1
#: Those that every method needs, so that they have a subscriber.
AWAITED = ("imu/data", "thermal/camera_info")

RECORDED = (
    "tirgeo/odometry",
    "tirgeo/origin",
    "tirgeo/camera_pose",
    "tirgeo/overlay/image/compressed",
    "tirgeo/locate/point",
    "/diagnostics",
)


@dataclass(frozen=True)
class GraphSetup:
    """What to run. ``folder`` takes the recording and the logs."""

    bag: Path
    folder: Path
    params: Path | None = None
    map: Path | None = None
    method: str | None = None
    rate: float = 1.0
    serial: bool = False  # the aircraft as bytes on a port, through dji_node; rate 1
    topics: Sequence[str] = RECORDED
    more_params: Sequence[Path] = ()  # each stands before those ahead of it
    environment: dict[str, str] = field(default_factory=dict)  # beside that of this process


@dataclass(frozen=True)
class GraphRun:
    """What came of it: the bag of outputs, and by node its processor time (s) and cores."""

    recording: Path
    play_s: float  # real time that the bag took
    cpu_s: dict[str, float]  # from start to end
    cores: dict[str, float]  # while the bag played
    error: str | None  # what of the bag was lost
    shift_ns: int = 0  # stamps of the recording less the bag's


def run_graph(setup: GraphSetup, duration_s: float, progress: Report = silent) -> GraphRun:
    """Start all nodes, play the bag through them, stop them, and say what it cost.

    ``duration_s`` is the length of the bag, for ``progress``. Whatever happens, no process is
    left. Raises GraphError for a node that dies, with the last line that it said.
    """
    setup.folder.mkdir(parents=True, exist_ok=True)
    recording = setup.folder / "recording.mcap"
    environment = graph_environment(setup)
    with node_processes() as processes:
        for name, arguments in _nodes(setup, recording).items():
            log = setup.folder / f"{name}.log"
            processes.append(NodeProcess(name, arguments, environment, log))
        await_words(processes, "ready")
        player = NodeProcess(
            "bag_player", _player(setup), environment, setup.folder / "bag_player.log"
        )
        processes.append(player)
        await_words([player], "playing")
        play_s, cores = _watch(processes, player, duration_s / setup.rate, progress)
        time.sleep(_SETTLE_S)
        _stop([process for process in processes if process is not player])
    cpu_s = {process.name: process.cpu_s() for process in processes}
    return GraphRun(recording, play_s, cpu_s, cores, _loss(player), _shift_ns(player))


def graph_environment(setup: GraphSetup) -> dict[str, str]:
    """The environment of the nodes: a DDS domain of their own, on this machine alone."""
    given = {**os.environ, **setup.environment}
    environment = localhost_environment(given, find_resource("config"))
    environment.setdefault("ROS_LOG_DIR", str(setup.folder / "ros"))
    if "ROS_DOMAIN_ID" not in setup.environment:
        environment["ROS_DOMAIN_ID"] = str(free_domain())
    return environment


def free_domain(but: Collection[int] = ()) -> int:
    """A DDS domain whose first participant's port is free (RTPS 2.2, section 9.6.1.1)."""
    for step in range(100):
        domain = 1 + (os.getpid() + step) % 100
        if domain in but:
            continue
        probe = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        with probe, contextlib.suppress(OSError):
            probe.bind(("", 7410 + 250 * domain))
            return domain
    raise GraphError("no free ROS_DOMAIN_ID: all ports from 7660 on are taken")


def _nodes(setup: GraphSetup, recording: Path) -> dict[str, list[str]]:
    # The serial link has the host's clock, so all have it.
    clock = [] if setup.serial else ["-p", "use_sim_time:=true"]
    common = clock + _params(setup)
    method = ["-p", f"method:={setup.method}"] if setup.method else []
    map_file = ["-p", f"map:={setup.map}"] if setup.map else []
    record = ["-p", f"output:={recording}", "-p", f"topics:={','.join(setup.topics)}"]
    nodes = {
        "ekf_node": common + method,
        "gimbal_node": common,
        "overlay_node": common + map_file,
        "recorder": clock + record,
    }
    if setup.serial:
        port = ["-p", "source:=serial", "-p", f"port:={_port(setup)}"]
        return {"dji_node": common + port, **nodes}
    return nodes


def _player(setup: GraphSetup) -> list[str]:
    values: dict[str, object] = {"bag": setup.bag, "rate": float(setup.rate)}
    if setup.serial:
        values |= {"live": "true", "serial_port": _port(setup)}
    values["wait_for"] = ",".join(_awaited(setup))
    words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
    return _params(setup) + words


def _awaited(setup: GraphSetup) -> list[str]:
    """What the player waits to be listened to: else the first pictures may find nobody."""
    played = BagReader(setup.bag).topics()
    names = [name for name in (*AWAITED, *PICTURES) if f"/{name}" in played]
    return [name for name in names if not (setup.serial and name in SENSED_TOPICS)]


def _params(setup: GraphSetup) -> list[str]:
    files = [path for path in (setup.params, *setup.more_params) if path is not None]
    return [word for path in files for word in ("--params-file", str(path))]


def _port(setup: GraphSetup) -> Path:
    """The pseudo-terminal that the player makes."""
    return setup.folder / "aircraft"


@contextlib.contextmanager
def node_processes() -> Iterator[list[NodeProcess]]:
    """A list whose processes are all ended when the block is left, however it is left."""
    processes: list[NodeProcess] = []
    try:
        yield processes
    finally:
        # A second Ctrl-C must not leave half of them behind; the wait is bounded.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, stop_signals())
        try:
            _end(processes)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _end(processes: Sequence[NodeProcess]) -> None:
    for process in processes:
        process.signal(signal.SIGINT)
    for process in processes:
        if process.wait(_STOP_TIMEOUT_S) is None:
            process.signal(signal.SIGKILL)
            process.wait(_STOP_TIMEOUT_S)


def await_words(processes: Sequence[NodeProcess], words: str) -> None:
    """Wait until each process has said the words. Raises GraphError if one does not or ends."""
    end_s = time.monotonic() + _READY_TIMEOUT_S
    while silent_ones := [process for process in processes if not process.said(words)]:
        for process in processes:
            process.check_running()
        if time.monotonic() > end_s:
            raise GraphError(
                f"{silent_ones[0].name} is not {words} after {_READY_TIMEOUT_S:g} s: "
                f"{silent_ones[0].last_line()}"
            )
        time.sleep(_POLL_S)


def _watch(
    processes: Sequence[NodeProcess], player: NodeProcess, expected_s: float, progress: Report
) -> tuple[float, dict[str, float]]:
    """Wait for the player's end: real seconds of playing, and cores by node meanwhile."""
    begin_s = time.monotonic()
    before = {process.name: process.cpu_s() for process in processes}
    others = [process for process in processes if process is not player]
    while player.poll() is None and not player.said("played"):
        for process in others:
            process.check_running()
        progress(time.monotonic() - begin_s, expected_s)
        time.sleep(_POLL_S)
    play_s = time.monotonic() - begin_s
    cores = {p.name: (p.cpu_s() - before[p.name]) / play_s for p in processes}
    ended = player.wait(_STOP_TIMEOUT_S)
    if ended is None or not player.said("played"):
        raise GraphError(player.last_line())
    return play_s, cores


def _shift_ns(player: NodeProcess) -> int:
    """By how much the player made the stamps later, as it says when it plays live."""
    said = re.search(r"stamps are later than the bag's by (\d+) ns", player.text())
    return 0 if said is None else int(said[1])


def _loss(player: NodeProcess) -> str | None:
    """What the player said at the end of a bag that is damaged."""
    whole = player.ended is not None and player.ended.exit_code == 0
    return None if whole else player.last_line().removeprefix(f"{player.name}: ")


def _stop(processes: Sequence[NodeProcess]) -> None:
    for process in processes:
        process.check_running()
        process.signal(signal.SIGINT)
    for process in processes:
        ended = process.wait(_STOP_TIMEOUT_S)
        if ended is None:
            raise GraphError(f"{process.name} did not stop within {_STOP_TIMEOUT_S:g} s")
        if ended.exit_code != 0:
            raise GraphError(
                f"{process.name} stopped with exit code {ended.exit_code}: {process.last_line()}"
            )

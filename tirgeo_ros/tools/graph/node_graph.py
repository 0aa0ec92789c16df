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
"""Run the whole node graph as separate processes over DDS, and play a bag to it.

Only this machine reaches the nodes, unless the user's own DDS profile allows more.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import secrets
import signal
import socket
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from tirgeo_ros.core.config.viewer_parameters import TOKEN_SEED
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.child_process import node_command
from tirgeo_ros.io.files.dds_profiles import PROFILES
from tirgeo_ros.io.files.stop_signals import stop_signals
from tirgeo_ros.io.messages import DJI_TOPICS
from tirgeo_ros.io.messages.topics import PICTURES
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import values_without_rates

#: Variables that would let other machines reach the nodes.
_WIDER = ("ROS_LOCALHOST_ONLY", "ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER")
_FAST_DDS = ("", "rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")
#: Times of waiting for processes: between two polls, for readiness, for the end, before a restart.
_WAIT_S, _POLL_S = 0.02, 0.1  # for one process, for all
_READY_TIMEOUT_S = 60.0
_STOP_TIMEOUT_S = 15.0
_RESTART_S = 2.0
#: Wait after the bag: the last diagnostics come within 1 s, and lost parts of the last pictures
#: are sent again at the writer's heartbeat, every 3 s.
_SETTLE_S = 3.5
_PORT = "aircraft"  # the pseudo-terminal that the player creates
#: Topics that every method needs, so that they always have a subscriber.
AWAITED = ("imu/data", "thermal/camera_info")
#: Topics that the recorder writes by default.
RECORDED = (
    "tirgeo/odometry",
    "tirgeo/origin",
    "tirgeo/camera_pose",
    "tirgeo/overlay/image/compressed",
    "tirgeo/locate/point",
    "tirgeo/state",
    "tirgeo/findings",
    "/diagnostics",
)


def video_environment(environment: Mapping[str, str], config: Path) -> dict[str, str]:
    """Return an environment with shared memory for whole frames, unless a profile is set."""
    if any(name in environment for name in PROFILES):
        return dict(environment)
    return {**environment, PROFILES[0]: str(config / "fastdds.xml")}


def localhost_environment(environment: Mapping[str, str], config: Path | None) -> dict[str, str]:
    """Return an environment in which only this machine reaches the nodes.

    ``config`` is the folder of the profiles, None if they are not installed. A user's own profile
    stays; ROS then limits discovery to this machine, but with sockets on every interface.
    """
    kept = {name: value for name, value in environment.items() if name not in _WIDER}
    profile = str(config / "fastdds_localhost.xml") if config else ""
    others = {environment[name] for name in PROFILES if name in environment} - {profile}
    if not profile or others or environment.get("RMW_IMPLEMENTATION", "") not in _FAST_DDS:
        return {**kept, "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    return {
        **kept,
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT",  # the profile is narrower
        PROFILES[0]: profile,
        "SKIP_DEFAULT_XML_FILE": "1",  # else a profile in the working directory takes precedence
    }


@dataclass(frozen=True, slots=True)
class Ended:
    """Hold how a process ended."""

    exit_code: int  # negative: minus the number of the signal that ended it
    cpu_s: float  # user and system, from its start


class NodeProcess:
    """Run a node of a package in its own process group, with its output in a log file."""

    def __init__(
        self,
        name: str,
        arguments: Sequence[str],
        environment: Mapping[str, str],
        log: Path,
        package: str = "tirgeo_ros.nodes",
    ) -> None:
        self.name = name
        self.log = log
        self._command = node_command(name, arguments, package)
        self._environment = dict(environment)
        log.unlink(missing_ok=True)
        self.start()

    def start(self) -> None:
        """Start the process, or start it again after it has ended; the log is continued."""
        self.ended: Ended | None = None
        flags = os.O_WRONLY | os.O_CREAT | os.O_APPEND
        self.pid = os.posix_spawn(
            self._command[0],
            self._command,
            self._environment,
            file_actions=[
                (os.POSIX_SPAWN_OPEN, 0, os.devnull, os.O_RDONLY, 0),
                (os.POSIX_SPAWN_OPEN, 1, str(self.log), flags, 0o600),
                (os.POSIX_SPAWN_DUP2, 1, 2),
            ],
            setpgroup=0,  # so that Ctrl-C on the terminal reaches only this process, not the nodes
            # The signals are blocked from the first instruction; the node polls for them later.
            setsigmask=stop_signals(),
        )

    def poll(self) -> Ended | None:
        """Return how the process ended, or None while it runs."""
        if self.ended is None:
            pid, status, usage = os.wait4(self.pid, os.WNOHANG)
            if pid:
                cpu_s = usage.ru_utime + usage.ru_stime
                self.ended = Ended(os.waitstatus_to_exitcode(status), cpu_s)
        return self.ended

    def cpu_s(self) -> float:
        """Return the processor time so far, user and system (s)."""
        if self.ended is not None:
            return self.ended.cpu_s
        fields = Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / _TICKS_PER_S

    def said(self, words: str) -> bool:
        """Return whether the log contains the words."""
        return words in self.text()

    def text(self) -> str:
        """Return the log so far."""
        return self.log.read_text(errors="replace")

    def last_line(self) -> str:
        """Return the last line of the log."""
        lines = [line for line in self.text().splitlines() if line]
        return lines[-1].strip() if lines else "its log is empty"

    def check_running(self) -> None:
        """Raise GraphError with the last line of the log if the process has ended."""
        if self.poll() is not None:
            raise GraphError(self.why_ended())

    def why_ended(self) -> str:
        """Return the exit code and the last line of the log."""
        code = self.ended.exit_code if self.ended else "unknown"
        return f"{self.name} ended (exit code {code}): {self.last_line()}"

    def signal(self, number: int) -> None:
        """Send a signal, if the process still runs."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def wait(self, timeout_s: float) -> Ended | None:
        """Return how the process ended, or None if it has not ended within ``timeout_s``."""
        end_s = time.monotonic() + timeout_s
        while self.poll() is None and time.monotonic() < end_s:
            time.sleep(_WAIT_S)
        return self.ended


@dataclass(frozen=True)
class GraphSetup:
    """Hold the set-up of a run; ``folder`` is for the recording and the logs."""

    bag: Path
    folder: Path
    params: Sequence[Path] = ()  # each overrides those before it
    map: Path | None = None
    method: str | None = None
    rate: float = 1.0
    # Send the aircraft's data as bytes on a port, through dji_node; needs rate 1.
    serial: bool = False
    topics: Sequence[str] = RECORDED
    environment: dict[str, str] = field(default_factory=dict)  # added to that of this process


@dataclass(frozen=True)
class GraphRun:
    """Hold the result: the bag of outputs, and each node's processor time (s) and cores."""

    recording: Path
    play_s: float  # real time of playing
    cpu_s: dict[str, float]  # from start to end
    cores: dict[str, float]  # while the bag played
    error: str | None  # what was lost of the bag, or None
    shift_ns: int = 0  # the recording's stamps minus the bag's


def run_graph(setup: GraphSetup, duration_s: float, progress: Report = silent) -> GraphRun:
    """Start all nodes, play the bag to them, stop them, and return the recording and costs.

    ``duration_s`` is the length of the bag, for ``progress``. No process is left running in any
    case. Raise GraphError, with the last line of its log, if a node ends too early.
    """
    setup.folder.mkdir(parents=True, exist_ok=True)
    recording = setup.folder / "recording.mcap"
    environment = graph_environment(setup)
    with node_processes() as processes:
        for name, arguments in _nodes(setup, recording).items():
            log = setup.folder / f"{name}.log"
            processes.append(NodeProcess(name, arguments, environment, log))
        await_words(processes, "ready")
        log = setup.folder / "bag_player.log"
        player = NodeProcess("bag_player", _player(setup), environment, log)
        processes.append(player)
        await_words([player], "playing")
        play_s, cores = _watch(processes, player, duration_s / setup.rate, progress)
        time.sleep(_SETTLE_S)
    for process in processes:
        if process is not player and (process.ended is None or process.ended.exit_code):
            raise GraphError(process.why_ended())
    cpu_s = {process.name: process.cpu_s() for process in processes}
    # The player's log tells what was lost of the bag (last line), and how stamps were shifted.
    is_whole = player.ended is not None and player.ended.exit_code == 0
    error = None if is_whole else player.last_line().removeprefix(f"{player.name}: ")
    shift = re.search(r"stamps are later than the bag's by (\d+) ns", player.text())
    return GraphRun(recording, play_s, cpu_s, cores, error, int(shift[1]) if shift else 0)


def show_graph(
    setup: GraphSetup,
    page: Mapping[str, object],
    on_ready: Callable[[NodeProcess], None],
    say: Callable[[str], object],
) -> NoReturn:
    """Start all nodes and the operator's page, and play the bag again and again.

    ``page`` has viewer_node's parameters. ``on_ready`` is called with its process once the page is
    served. A node that ends after this is started again, and ``say`` is called with a line about
    it. Raise KeyboardInterrupt at the end, or GraphError if a node does not start; no process is
    left running in any case.
    """
    setup.folder.mkdir(parents=True, exist_ok=True)
    environment = graph_environment(setup)
    nodes = _nodes(setup, setup.folder / "recording.mcap")
    del nodes["recorder"]
    nodes["viewer_node"] = nodes["overlay_node"] + parameter_words(page)
    with node_processes() as processes:

        def start(name: str, arguments: list[str]) -> NodeProcess:
            log = setup.folder / f"{name}.log"
            processes.append(NodeProcess(name, arguments, environment, log))
            return processes[-1]

        started = {name: start(name, arguments) for name, arguments in nodes.items()}
        await_words(processes, "ready")
        start("bag_player", [*_player(setup), "-p", "loop:=true"])
        on_ready(started["viewer_node"])
        while True:
            for process in processes:
                if process.poll():
                    say(f"{process.why_ended()}; started again in {_RESTART_S:g} s\n")
                    time.sleep(_RESTART_S)
                    process.start()
            time.sleep(_POLL_S)


def graph_environment(setup: GraphSetup) -> dict[str, str]:
    """Return the environment of the nodes: their own DDS domain, on this machine only."""
    wider = {**os.environ, **setup.environment}
    environment = localhost_environment(wider, find_resource("config"))
    environment.setdefault(TOKEN_SEED, secrets.token_urlsafe())
    environment.setdefault("ROS_LOG_DIR", str(setup.folder / "ros"))
    if "ROS_DOMAIN_ID" not in setup.environment:
        environment["ROS_DOMAIN_ID"] = str(free_domain())
    return environment


def free_domain(but: Collection[int] = ()) -> int:
    """Return a DDS domain whose first participant's port is free (RTPS 2.2, section 9.6.1.1)."""
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
    """Return the arguments of each node."""
    # The host's clock stamps the data of the serial link, so all nodes use that clock.
    clock: dict[str, object] = {} if setup.serial else {"use_sim_time": True}
    record = {"output": recording, "topics": ",".join(setup.topics)}
    fitting = values_without_rates(setup.bag, setup.params)
    common = parameter_words(clock | fitting, setup.params)
    nodes = {
        "ekf_node": common + parameter_words({"method": setup.method} if setup.method else {}),
        "gimbal_node": common,
        "overlay_node": common + parameter_words({"map": setup.map} if setup.map else {}),
        "recorder": parameter_words(clock | record),
    }
    if not setup.serial:
        return nodes
    link = {"source": "serial", "port": setup.folder / _PORT}
    return {"dji_node": common + parameter_words(link), **nodes}


def _player(setup: GraphSetup) -> list[str]:
    """Return the player's arguments; it waits for subscribers, so that no picture is lost."""
    played = BagReader(setup.bag).topics()
    awaited = [name for name in (*AWAITED, *PICTURES) if f"/{name}" in played]
    values: dict[str, object] = {"bag": setup.bag, "rate": float(setup.rate)}
    if setup.serial:
        values |= {"live": True, "serial_port": setup.folder / _PORT}
        awaited = [name for name in awaited if name not in DJI_TOPICS]
    return parameter_words(values | {"wait_for": ",".join(awaited)}, setup.params)


def parameter_words(values: Mapping[str, object], files: Iterable[Path] = ()) -> list[str]:
    """Return the arguments that give a node parameters; ``values`` override ``files``."""
    paths = [*map(str, files), *([_file_of(values)] if values else [])]
    return [word for path in paths for word in ("--params-file", path)]


def _file_of(values: Mapping[str, object]) -> str:
    """Return a file in memory with parameters of all nodes; it lasts as long as this process.

    In ROS, a file that names a node overrides ``-p NAME:=VALUE``. The last file overrides the
    others, if it names the nodes too.
    """
    plain = {
        name: value if isinstance(value, bool | int | float) else str(value)
        for name, value in values.items()
    }
    content = json.dumps({"/**/*": {"ros__parameters": plain}}, ensure_ascii=False)
    file = os.memfd_create("parameters", 0)  # open in the programs that this process becomes
    os.write(file, os.fsencode(content))
    return f"/proc/{os.getpid()}/fd/{file}"


@contextlib.contextmanager
def node_processes() -> Iterator[list[NodeProcess]]:
    """Yield a list of processes, all of which are ended when the block is left in any way."""
    processes: list[NodeProcess] = []
    try:
        yield processes
    finally:
        # A second Ctrl-C must not leave processes running; the wait is limited.
        before = signal.pthread_sigmask(signal.SIG_BLOCK, stop_signals())
        try:
            for process in processes:
                process.signal(signal.SIGINT)
            for process in processes:
                if process.wait(_STOP_TIMEOUT_S) is None:
                    process.signal(signal.SIGKILL)
                    process.wait(_STOP_TIMEOUT_S)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


def await_words(processes: Sequence[NodeProcess], words: str) -> None:
    """Wait until each log contains ``words``. Raise GraphError at a time-out, or if one ends."""
    end_s = time.monotonic() + _READY_TIMEOUT_S
    while waiting := [process for process in processes if not process.said(words)]:
        for process in processes:
            process.check_running()
        if time.monotonic() > end_s:
            raise GraphError(
                f"{waiting[0].name} is not {words} after {_READY_TIMEOUT_S:g} s: "
                f"{waiting[0].last_line()}"
            )
        time.sleep(_POLL_S)


def _watch(
    processes: Sequence[NodeProcess], player: NodeProcess, expected_s: float, progress: Report
) -> tuple[float, dict[str, float]]:
    """Wait until the player ends; return the real time of playing (s) and the cores by node."""
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

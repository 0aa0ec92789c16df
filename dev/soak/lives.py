"""The processes of a soak: each life of each node, its memory, and what it leaves behind."""

from __future__ import annotations

import contextlib
import os
import signal
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from dev.nodes import package_of
from dev.soak.schedule import GUEST
from tirgeo_ros.tools.graph.node_graph import NodeProcess

_SHARED = Path("/dev/shm")  # noqa: S108 where Fast DDS puts its files
_DELETED = " (deleted)"
#: Names the soak in the environment of all that it starts, their children too.
MARK = "TIRGEO_SOAK"


@dataclass
class Life:
    """One process of a node, from its start to its end; times by the steady clock."""

    node: str
    process: NodeProcess
    began_s: float
    killed: bool = False
    ended_s: float | None = None
    #: Seconds of life; bytes resident in all, and those of them that are shared with others.
    memory: list[tuple[float, int, int]] = field(default_factory=list)


class Lives:
    """Starts nodes again and again, and notes what each life takes of memory."""

    def __init__(
        self, arguments: Mapping[str, Sequence[str]], environment: dict[str, str], logs: Path
    ) -> None:
        """``arguments`` by node."""
        self.all: list[Life] = []
        self.by_themselves: list[str] = []  # last words of those that ended without being asked
        self.processes: list[NodeProcess] = []
        self._arguments = arguments
        self._environment = environment | {MARK: str(os.getpid())}
        self._logs = logs
        self._before = set(shared_files())
        self._own: set[str] = set()

    def start(self, node: str, *more: str) -> Life:
        """Begin a life."""
        number = sum(life.node == node for life in self.all)
        log = self._logs / f"{node}.{number}.log"
        program = "soak_mute" if node == GUEST else node
        words = [*self._arguments[node], *more]
        process = NodeProcess(program, words, self._environment, log, package_of(program))
        self.processes.append(process)
        self.all.append(Life(node, process, time.monotonic()))
        return self.all[-1]

    def current(self, node: str) -> Life:
        """The newest life of a node."""
        return next(life for life in reversed(self.all) if life.node == node)

    def kill(self, node: str) -> None:
        """End a life with no chance to say a word."""
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
                    life.memory.append((now_s - life.began_s, *_resident(life.process.pid)))
                    self._own |= held_by(life.process.pid)

    def ended(self) -> list[Life]:
        """Those that have ended by themselves since the last call; they are noted."""
        found = [
            life for life in self.all if life.ended_s is None and life.process.poll() is not None
        ]
        for life in found:
            life.ended_s = time.monotonic()
            assert life.process.ended is not None
            code = life.process.ended.exit_code
            self.by_themselves.append(f"{life.node}: exit code {code}: {life.process.last_line()}")
        return found

    def stop(self, timeout_s: float) -> None:
        """End all that live as a user would, and note those that do not end well."""
        living = [life for life in self.all if life.ended_s is None]
        for life in living:
            life.process.signal(signal.SIGCONT)
            life.process.signal(signal.SIGINT)
        for life in living:
            ended = life.process.wait(timeout_s)
            life.ended_s = time.monotonic()
            if ended is None or ended.exit_code:
                self.by_themselves.append(
                    f"{life.node}: asked to stop: "
                    + (f"exit code {ended.exit_code}" if ended else f"not in {timeout_s:g} s")
                )

    def left_files(self) -> list[str]:
        """The files of shared memory that lives have made or used, and nobody uses any more.

        The ports from 7000 on are shared by all domains: another program may have them.
        """
        used = {_thing(name) for pid in _processes() for name in held_by(pid)}
        left = (self._own - self._before) & set(shared_files())
        return sorted(name for name in left if _thing(name) not in used)

    def left_processes(self) -> list[int]:
        """Processes that bear the mark of this soak and still run."""
        mark = f"{MARK}={os.getpid()}".encode()
        return [pid for pid in _processes() if mark in _environment(pid)]


def shared_files() -> list[str]:
    """The files of Fast DDS in shared memory, of everybody on this machine."""
    return [path.name for path in _SHARED.glob("*fastrtps*")]


def held_by(pid: int) -> set[str]:
    """The files in shared memory that a process has mapped or open."""
    mapped, links = set(), []
    with contextlib.suppress(OSError):  # it may have ended, or be another user's
        maps = Path(f"/proc/{pid}/maps").read_text()
        mapped = {line.partition("/")[2] for line in maps.splitlines() if f"{_SHARED}/" in line}
        for entry in Path(f"/proc/{pid}/fd").iterdir():
            with contextlib.suppress(OSError):
                links.append(str(entry.readlink()).lstrip("/"))
    names = {Path(name.removesuffix(_DELETED)).name for name in (*mapped, *links)}
    return {name for name in names if "fastrtps" in name}


def _thing(name: str) -> str:
    """The segment or port that a file is of: itself, its locks, its mutex."""
    name = name.removeprefix("sem.").removesuffix("_mutex")
    return name.removesuffix("_el").removesuffix("_sl")


def _resident(pid: int) -> tuple[int, int]:
    """Bytes resident in all, and those of shared memory (proc(5), status)."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    kib = {
        name: words.split()[0]
        for name, _, words in (line.partition(":") for line in lines)
        if name in {"VmRSS", "RssShmem"}
    }
    return 1024 * int(kib["VmRSS"]), 1024 * int(kib["RssShmem"])


def _processes() -> list[int]:
    return [int(path.name) for path in Path("/proc").glob("[0-9]*")]


def _environment(pid: int) -> list[bytes]:
    try:
        return Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:
        return []

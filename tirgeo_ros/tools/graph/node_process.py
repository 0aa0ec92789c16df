"""Run one ROS node as a child process: start it, watch its log, stop it, measure its CPU time."""

from __future__ import annotations

import os
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.io.files.child_process import node_command, stop_signals

_POLL_S = 0.02
_TICKS_PER_S = os.sysconf("SC_CLK_TCK")


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
        """Start the process, at first or again after it has ended; the log goes on."""
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
            setpgroup=0,  # a Ctrl-C on the terminal is for the watching process, not for the nodes
            # Blocked from the first instruction; the node polls for signals later.
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
        return lines[-1].strip() if lines else "it said nothing"

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
            time.sleep(_POLL_S)
        return self.ended

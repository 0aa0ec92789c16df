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
"""Run child processes of this Python, and exchange objects with them through pipes.

child = ChildProcess("from somewhere import main; main()")     # in the parent
child.send(task)
answer = child.receive()

with parent_pipes() as (tasks, answers):                       # in the child's ``main``
    task = pickle.load(tasks)

A child finds this process's modules, and no others: ``python -c`` and ``python -m`` put the
working directory first on the path, so that a ``yaml.py`` beside a recording would be run. In
isolated mode (``-I``) they do not, and ignore PYTHONPATH. The path of this process is passed on
instead, without the working directory.
"""

from __future__ import annotations

import ctypes
import fcntl
import os
import pickle
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

import tirgeo_ros

_PR_SET_PDEATHSIG = 1  # of prctl (linux/prctl.h)
_NODE = "import sys; from tirgeo_ros.nodes.start import start; sys.exit(start({!r}, {!r}))"
_ENDS_WITH = """\
import signal
from tirgeo_ros.io.files.child_process import end_with
end_with({}, signal.SIGTERM)
"""
_SAID_BYTES = 4000  # of a child's last output on stderr: the length of a traceback
#: What a pipe holds before its writer has to wait: a picture or two. Linux allows every user this.
_PIPE_BYTES = 1 << 20
_parents: set[int] = set()  # the process with which this one ends, if any


def python_command(code: str, *arguments: str) -> list[str]:
    """Return the command that runs ``code`` with ``arguments`` in ``sys.argv[1:]``."""
    start = f"import sys; sys.path[:] = {_path()!r}\n{code}"
    return [sys.executable, "-I", "-c", start, *arguments]


def node_command(
    name: str, arguments: Sequence[str], package: str = "tirgeo_ros.nodes", *, ends_with: int = 0
) -> list[str]:
    """Return the command that runs a package's node with arguments of ROS.

    ``ends_with`` is the number of the process that will start the node: the node gets SIGTERM when
    that process, or its thread that started the node, ends for whatever reason.
    """
    first = _ENDS_WITH.format(ends_with) if ends_with else ""
    return python_command(first + _NODE.format(name, package), "--ros-args", *arguments)


def end_with(parent: int, number: signal.Signals) -> None:
    """Have the kernel send this process a signal when its parent ends, however it does (Linux)."""
    with suppress(AttributeError, OSError):
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, number, 0, 0, 0)
    _parents.add(parent)
    if parent_ended():
        sys.exit(1)


def parent_ended() -> bool:
    """Return whether this process should end because its parent has ended (``end_with``)."""
    return any(parent != os.getppid() or _exits(parent) for parent in _parents)


def _exits(pid: int) -> bool:
    """Return whether a process is ending or gone; one with many threads takes a moment to end."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except OSError:
        return True
    return fields[0] in "ZX" or bool(int(fields[6]) & 4)  # PF_EXITING: proc(5), sched.h


def _path() -> list[str]:
    """Return the module path of this process; last comes the folder that holds this package."""
    package = str(Path(tirgeo_ros.__file__).resolve().parents[1])
    here = os.path.realpath(".")
    entries = [each for each in sys.path if each and os.path.realpath(each) != here]
    return [*entries, package]


class ChildEndedError(Exception):
    """Report that a child ended before it answered."""

    def __init__(self, code: int, said: str) -> None:
        """Take its exit code (negative: the signal that ended it) and its last lines on stderr."""
        super().__init__(code, said)
        self.code, self.said = code, said

    @property
    def last(self) -> str:
        """Return the last line on stderr, after a colon; an empty text if there is none."""
        return f": {self.said.splitlines()[-1]}" if self.said else ""


class ChildProcess:
    """Run ``code`` in a child; it lives no longer than the thread that started it."""

    def __init__(self, code: str) -> None:
        self.said = ""  # its last lines on stderr, once it is closed
        self._stderr = tempfile.TemporaryFile()  # noqa: SIM115  until ``close``
        self._process = subprocess.Popen(  # noqa: S603  this very Python
            python_command(code, str(os.getpid())),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
        )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._to, self._from = self._process.stdin, self._process.stdout
        for pipe in (self._to, self._from):
            with suppress(AttributeError, OSError):  # not Linux, or too many large pipes already
                fcntl.fcntl(pipe, fcntl.F_SETPIPE_SZ, _PIPE_BYTES)

    def send(self, thing: object) -> None:
        """Send an object. Raises ChildEndedError; on this or another error the child is closed."""
        with self._open():
            pickle.dump(thing, self._to, protocol=pickle.HIGHEST_PROTOCOL)
            self._to.flush()

    def receive(self) -> Any:
        """Return the next object that the child sends. Raises as ``send``."""
        with self._open():
            # Loaded from the pipe: the interpreter is free while it waits for each part.
            return pickle.load(self._from)  # noqa: S301  from our own child

    @contextmanager
    def _open(self) -> Iterator[None]:
        try:
            yield
        except (EOFError, OSError, pickle.UnpicklingError):
            code = self._process.wait()  # the child closed its end of the pipe, so it has ended
            self.close()
            raise ChildEndedError(code, self.said) from None
        except BaseException:
            self.close()
            raise

    def answers_within(self, time_s: float) -> bool:
        """Return whether the child answers, or ends, within a time; ask anew for each answer."""
        return bool(select.select([self._from], [], [], time_s)[0])

    @property
    def number(self) -> int:
        """Return the number of the process."""
        return self._process.pid

    def end(self, patience_s: float) -> None:
        """Tell the child to end (SIGTERM), wait up to this time for it, and close it."""
        self._process.terminate()
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(patience_s)
        self.close()

    def kill(self) -> None:
        """Kill the child; a ``receive`` that waits for an answer raises ChildEndedError."""
        self._process.kill()

    def close(self) -> None:
        """Kill the child and close its pipes; a second call does nothing."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._to, self._from):
            with suppress(OSError):  # of bytes that the child never read
                pipe.close()
        if self._stderr.closed:
            return
        with self._stderr as file:
            file.seek(max(file.seek(0, os.SEEK_END) - _SAID_BYTES, 0))
            lines = file.read().decode(errors="replace").strip().splitlines()
        # Without control characters, which a terminal would obey.
        self.said = "\n".join("".join(x if x.isprintable() else "?" for x in y) for y in lines)


@contextmanager
def parent_pipes(
    number: signal.Signals = signal.SIGKILL,
) -> Iterator[tuple[IO[bytes], IO[bytes]]]:
    """Yield, in a child, the pipe from its parent and the pipe to it, until the parent ends.

    Then the child gets the signal ``number``. Other code that reads stdin or prints does not reach
    the pipes. Ctrl-C is left to the parent, which ends the child.
    """
    end_with(int(sys.argv[1]), number)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    tasks, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(2, 1)
    with suppress(EOFError):
        yield tasks, answers

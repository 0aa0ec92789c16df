"""Process a flight in a child process of this Python, and again if it is killed."""

from __future__ import annotations

import json
import os
import re
import selectors
import signal
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from pathlib import Path
from typing import IO, Any

from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.io.files.child_python import python_command
from tirgeo_ros.tools.season.flight_record import Record, written_record
from tirgeo_ros.tools.season.flight_task import FlightTask

#: How often a flight is begun whose process is killed.
ATTEMPTS = 3
_RUN = "from tirgeo_ros.tools.season.flight_child import main; main()"
_POLL_S = 0.2
_END_S = 10.0  # a child that is told to end removes what it has begun
_SAID_BYTES = 2000


class Stopped(Exception):  # noqa: N818  no error: the user has stopped the season
    """Report that a season was stopped while a flight was processed."""


def run_flight(
    task: FlightTask,
    is_stopped: Callable[[], bool],
    report: Callable[[float], None],
    cores: Sequence[int] = (),
) -> Record:
    """Process a flight, write its record and return it; ``report`` gets the part that is done.

    A flight that fails gives a record with its error. Its process keeps to ``cores``; with none
    given it may use all. Raises Stopped once ``is_stopped`` returns true.
    """
    found, attempts = None, 0
    while found is None and attempts < ATTEMPTS:
        found, fault = _once(task, is_stopped, report, cores)
        attempts += 1
    line = f"{task.bag}: its process ended {attempts} times without a result: {fault}"
    return written_record(task, found or {"error": line}, attempts)


def _once(
    task: FlightTask,
    is_stopped: Callable[[], bool],
    report: Callable[[float], None],
    cores: Sequence[int],
) -> tuple[dict[str, Any] | None, str]:
    """Return what a process found; or None, and how it ended without an answer."""
    found = None
    with tempfile.TemporaryFile() as stderr, _child(task, cores, stderr) as process:
        for line in _lines(process, is_stopped):
            answer = json.loads(line)
            found = answer.get("found", found)
            report(answer.get("part", 1.0))
        with suppress(subprocess.TimeoutExpired):
            process.wait(_END_S)
        return found, _fault(process.returncode or 0, stderr)


@contextmanager
def _child(
    task: FlightTask, cores: Sequence[int], stderr: IO[bytes]
) -> Iterator[subprocess.Popen[bytes]]:
    """Run the child; it has ended when the block does, and left no unfinished file."""
    # As the command sets them. OpenCV's threads are as many as there are cores to use.
    alone = {"OPENBLAS_NUM_THREADS": "1", "OPENCV_LOG_LEVEL": "ERROR"}
    threads = {"OPENCV_FOR_THREADS_NUM": str(max(len(cores), 1))}
    # Without what only the record needs: an argument has at most 128 KiB.
    text = json.dumps(asdict(replace(task, made_from={})))
    arguments = (str(os.getpid()), text, json.dumps(list(cores)))
    process = subprocess.Popen(  # noqa: S603  this very Python
        python_command(_RUN, *arguments),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=stderr,
        env=alone | os.environ | threads,
        cwd=task.working_folder,
    )
    try:
        with process:
            try:
                yield process
            finally:
                _end(process)
    finally:
        remove_parts(task, process.pid)


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a child that still runs: it cleans up, or is killed."""
    process.terminate()
    try:
        process.wait(_END_S)
    except subprocess.TimeoutExpired:
        process.kill()


def remove_parts(task: FlightTask, number: int | None = None) -> None:
    """Remove the unfinished files that a killed process, or any, has left of a flight."""
    which = r"\d+" if number is None else str(number)
    part = re.compile(rf"\.{re.escape(task.name)}\.(mcap|mp4|webm|ts|jpg|json)\.{which}\.\w+")
    for path in Path(task.folder).iterdir():
        if part.fullmatch(path.name):
            path.unlink(missing_ok=True)


def _lines(process: subprocess.Popen[bytes], is_stopped: Callable[[], bool]) -> Iterator[bytes]:
    """Yield the lines of a child until it closes its output; raise Stopped."""
    assert process.stdout is not None
    rest, number = b"", process.stdout.fileno()
    with selectors.DefaultSelector() as selector:
        selector.register(number, selectors.EVENT_READ)
        while True:
            ready = selector.select(_POLL_S)
            if is_stopped():
                raise Stopped
            if not ready:
                continue
            piece = os.read(number, 1 << 16)
            if not piece:
                return
            *whole, rest = (rest + piece).split(b"\n")
            yield from whole


def _fault(code: int, stderr: IO[bytes]) -> str:
    """Return how a child ended, with its last words."""
    size = stderr.seek(0, os.SEEK_END)
    stderr.seek(max(size - _SAID_BYTES, 0))
    said = stderr.read().decode(errors="replace").strip().splitlines()
    how = f"exit code {code}"
    if code < 0:
        how = f"signal {-code} ({signal.Signals(-code).name})"
    if code == -signal.SIGKILL:
        how += "; if memory ran out, use fewer --workers"
    return f"{how}{f': {shown(said[-1])}' if said else ''}"

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
"""Run nodes: start them, spin each in a thread, stop them on a signal, return the exit code.

rclpy's own signal handlers sometimes fail when a signal meets ``spin`` in the main thread, or when
two signals come within a tenth of a second. Here they are off: the signals stay blocked
(``start``), the main thread polls for pending ones, and a node never sees a signal.
"""

from __future__ import annotations

import ctypes
import fcntl
import gc
import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, nullcontext, suppress
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.experimental import EventsExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions
from rclpy.task import Future as RclpyFuture

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.nodes.parameters import check_arguments, explained, idle_overrides
from tirgeo_ros.nodes.start import STOP_SIGNALS

FOLDER = Path("/dev/shm")  # noqa: S108 Fast DDS puts its segments there
_SEGMENT = re.compile(r"fastrtps_[0-9a-f]{16}")
_LOCK = "_el"
#: A younger file may still be in creation, and not locked yet.
_YOUNG_S = 2.0
_POLL_S, _START_POLL_S = 0.1, 0.05
_RELEASE_PERIOD_S = 10.0
_SPIN_S = 60.0
T = TypeVar("T")
Work = Callable[[Any, threading.Event], int]


class Part(NamedTuple):
    """Hold how a node is built, and the work that it does beside its callbacks, if any."""

    build: Callable[[], Node]
    work: Work | None = None


def run(name: str, build: Callable[[], Node], work: Work | None = None) -> int:
    """Run one node as ``run_all`` does."""
    return run_all(name, {name: Part(build, work)})


def run_all(program: str, parts: Mapping[str, Part]) -> int:
    """Build nodes and spin them until a stop signal or the end of a ``work(node, stop)``.

    ``parts`` are the nodes by name. Return the exit code: 0 when stopped, the result of the work
    that ends by itself, 1 for a TirgeoError, with one line on stderr that begins with ``program``.
    If a node has ``resources``, a context manager, they are open while the nodes run.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        for name in parts:
            check_arguments(name, sys.argv)
        with _context(), ExitStack() as opened:
            nodes = [opened.enter_context(_node(part.build)) for part in parts.values()]
            for node in nodes:
                opened.enter_context(getattr(node, "resources", None) or nullcontext())
                node.get_logger().info("ready")
            gc.freeze()  # what lives until the end needs no search for garbage at each collection
            return _until_stopped(nodes, [part.work for part in parts.values()])
    except TirgeoError as error:
        sys.stderr.write(f"{program}: {error}\n")
        return 1


@contextmanager
def _context() -> Iterator[None]:
    remove_dead()
    with explained(sys.argv):
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()
        remove_dead()


@contextmanager
def _node(build: Callable[[], Node]) -> Iterator[Node]:
    with explained(sys.argv):
        node = build()
    for name in idle_overrides(node):
        node.get_logger().warning(f"{name} has no effect: this node and tirgeo lack the topic")
    try:
        yield node
    finally:
        node.destroy_node()


def _until_stopped(nodes: Sequence[Node], works: Sequence[Work | None]) -> int:
    stop, spun = threading.Event(), RclpyFuture()
    # rclpy's older executor checks every entity at every message, and takes 1.6 to 3 times the
    # processor time on a flight at 100 Hz.
    executors = [EventsExecutor() for _ in nodes]
    with ThreadPoolExecutor(max_workers=2 * len(nodes)) as pool:
        jobs = []
        for executor, node, work in zip(executors, nodes, works, strict=True):
            executor.add_node(node)
            jobs.append(pool.submit(_spin, executor, spun))
            if work is not None:
                jobs.append(pool.submit(work, node, stop))
        try:
            caught = _wait(jobs)
            if caught is not None:
                name = signal.Signals(caught.si_signo).name
                nodes[0].get_logger().info(f"stopped by {name} from process {caught.si_pid}")
        finally:
            stop.set()
            spun.set_result(None)
            for executor in executors:
                executor.wake()
        code = max(job.result() for job in jobs)
    for executor, node in zip(executors, nodes, strict=True):
        executor.remove_node(node)
        executor.shutdown()
    return code


def _wait(jobs: list[Future[int]]) -> signal.struct_siginfo | None:
    """Wait until a job is done; return the stop signal that came before, or None.

    ``sigtimedwait`` is not used: if the process is stopped meanwhile and continued (Ctrl-Z and fg,
    a computer that slept), Python's version returns a signal that never came.
    """
    released_s = time.monotonic()
    while not wait(jobs, _POLL_S, FIRST_COMPLETED).done:
        if time.monotonic() - released_s > _RELEASE_PERIOD_S:
            released_s = time.monotonic()
            # Free memory that glibc's malloc keeps, of the longest queues and of dead DDS peers,
            # goes back to the system: 0.1 to 1.4 ms. Other C libraries have no malloc_trim.
            with suppress(AttributeError):
                ctypes.CDLL(None).malloc_trim(0)
        if not signal.sigpending().isdisjoint(STOP_SIGNALS):
            return signal.sigwaitinfo(STOP_SIGNALS)
    return None


def _spin(executor: Any, spun: RclpyFuture) -> int:
    # These versions of the events executor deliver messages only while they wait for a time that
    # ends. spin_once does too, but costs a fifth more. The future keeps some bytes of each call.
    with suppress(ExternalShutdownException):
        while not spun.done():
            executor.spin_until_future_complete(spun, timeout_sec=_SPIN_S)
    return 0


def done_or_stopped(done: threading.Event) -> bool:
    """Wait for ``done``; return False if a stop signal comes before."""
    while not done.wait(_START_POLL_S):
        if not signal.sigpending().isdisjoint(STOP_SIGNALS):
            return False
    return True


def unless_stopped(work: Callable[[], T]) -> T | None:
    """Run ``work`` in a thread; return or raise its result, or None if a stop signal comes first.

    In that case the thread is left behind: it ends with the process.
    """
    done, result = threading.Event(), Future[T]()

    def run() -> None:
        try:
            result.set_result(work())
        except BaseException as error:  # noqa: BLE001  raised again below
            result.set_exception(error)
        done.set()

    threading.Thread(target=run, name="before the node runs", daemon=True).start()
    return result.result() if done_or_stopped(done) else None


def remove_dead(folder: Path = FOLDER) -> list[str]:
    """Remove this user's segments whose processes are dead; return their names."""
    names = {path.name.removesuffix(_LOCK) for path in folder.glob("fastrtps_*")}
    dead = []
    for name in sorted(filter(_SEGMENT.fullmatch, names)):
        files = folder / name, folder / (name + _LOCK)
        if not (any(map(_young, files)) or _locked(files[1])):
            dead.append(name)
            for file in files:
                with suppress(OSError):
                    file.unlink()
    return dead


def _young(path: Path) -> bool:
    with suppress(OSError):
        return time.time() - path.lstat().st_mtime < _YOUNG_S
    return False


def _locked(path: Path) -> bool:
    """Return whether a process holds the lock of a file, or the file cannot be opened."""
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC
    try:
        with os.fdopen(os.open(path, flags)) as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        return not isinstance(error, FileNotFoundError)
    return False

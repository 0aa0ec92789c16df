"""One way to run a node: start, spin in a thread, stop on a signal, exit code.

rclpy's own signal handlers end badly now and then when a signal meets ``spin`` in the main
thread, or when two come within a tenth of a second. Here they are off: the signals stay blocked
(``start``), the main thread asks for them with ``sigtimedwait``, and a node never sees one.
"""

from __future__ import annotations

import signal
import sys
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

from tirgeo_ros.core.errors import TirgeoError
from tirgeo_ros.nodes.arguments import check_arguments, explained
from tirgeo_ros.nodes.start import STOP_SIGNALS

_POLL_S = 0.1
Work = Callable[[Any, threading.Event], int]


def run(name: str, build: Callable[[], Node], work: Work | None = None) -> int:
    """Build a node and spin it until SIGINT, SIGTERM or the end of ``work(node, stop)``.

    Returns the exit code: 0 when stopped, ``work``'s answer when that ends by itself, 1 with one
    line on stderr for a TirgeoError. The node's ``resources``, a context manager, where it has
    them, are open meanwhile.
    """
    signal.pthread_sigmask(signal.SIG_BLOCK, STOP_SIGNALS)
    try:
        check_arguments(name, sys.argv)
        with _context(), _node(build) as node, _resources(node):
            node.get_logger().info("ready")
            return _until_stopped(node, work)
    except TirgeoError as error:
        sys.stderr.write(f"{name}: {error}\n")
        return 1


def make_executor() -> Any:
    """The events executor where there is one, else the single-threaded one.

    The single-threaded one looks at every entity at every message, and a node has a dozen in its
    parameter services alone. Cores on a flight at 100 Hz, events against single-threaded:
    ekf_node 0.21 / 0.33, gimbal_node 0.13 / 0.28, recorder 0.07 / 0.23.
    """
    try:
        from rclpy.experimental import EventsExecutor  # noqa: PLC0415  absent before Jazzy 7.1.4
    except ImportError:
        return SingleThreadedExecutor()
    return EventsExecutor()


@contextmanager
def _context() -> Iterator[None]:
    with explained(sys.argv):
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    try:
        yield
    finally:
        rclpy.try_shutdown()


@contextmanager
def _node(build: Callable[[], Node]) -> Iterator[Node]:
    with explained(sys.argv):
        node = build()
    try:
        yield node
    finally:
        node.destroy_node()


def _resources(node: Node) -> AbstractContextManager[Any]:
    return getattr(node, "resources", None) or nullcontext()


def _until_stopped(node: Node, work: Work | None) -> int:
    stop = threading.Event()
    executor = make_executor()
    executor.add_node(node)
    with ThreadPoolExecutor(max_workers=2) as pool:
        jobs = [pool.submit(_spin, executor, stop)]
        if work is not None:
            jobs.append(pool.submit(work, node, stop))
        try:
            caught = _wait(jobs)
            if caught is not None:
                name = signal.Signals(caught.si_signo).name
                node.get_logger().info(f"stopped by {name} from process {caught.si_pid}")
        finally:
            stop.set()
            executor.wake()
        code = max(job.result() for job in jobs)
    executor.remove_node(node)
    executor.shutdown()
    return code


def _wait(jobs: list[Future[int]]) -> signal.struct_siginfo | None:
    """Until a job is done, or the signal that came before."""
    caught = None
    while caught is None and not any(job.done() for job in jobs):
        caught = signal.sigtimedwait(STOP_SIGNALS, _POLL_S)
    return caught


def _spin(executor: Any, stop: threading.Event) -> int:
    # Only spin_once delivers in the events executor of these versions; spin() does not.
    with suppress(ExternalShutdownException):
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.5)
    return 0

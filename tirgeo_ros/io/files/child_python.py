"""Run child processes in this Python: they find this process's modules, and no others.

Also list the signals that end a command or a node.

``python -c`` and ``python -m`` put the working directory first on the path, so that a ``yaml.py``
beside a recording would be run. In isolated mode (``-I``) they do not, and ignore PYTHONPATH. The
path of this process is passed on instead, without the working directory.
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import tirgeo_ros

_PR_SET_PDEATHSIG = 1  # of prctl (linux/prctl.h)
_NODE = "import sys; from tirgeo_ros.nodes.start import start; sys.exit(start({!r}, {!r}))"
_ENDS_WITH = """\
import signal
from tirgeo_ros.io.files.child_python import end_with
end_with({}, signal.SIGTERM)
"""
_parents: set[int] = set()  # with which this process ends: none or one


def python_command(code: str, *arguments: str) -> list[str]:
    """Return the command that runs ``code`` with ``arguments`` in ``sys.argv[1:]``."""
    start = f"import sys; sys.path[:] = {_path()!r}\n{code}"
    return [sys.executable, "-I", "-c", start, *arguments]


def node_command(
    name: str, arguments: Sequence[str], package: str = "tirgeo_ros.nodes", *, ends_with: int = 0
) -> list[str]:
    """Return the command that runs a package's node with arguments of ROS.

    With ``ends_with``, the number of the process that will start it, the node gets SIGTERM when
    that process ends, for whatever reason, or the thread of it that started the node.
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
    """Return whether this process ends with its parent (``end_with``), and that has ended."""
    return any(parent != os.getppid() for parent in _parents)


def _path() -> list[str]:
    """Return the module path of this process; last comes the folder that holds this package."""
    package = str(Path(tirgeo_ros.__file__).resolve().parents[1])
    here = os.path.realpath(".")
    found = [each for each in sys.path if each and os.path.realpath(each) != here]
    return [*found, package]


@contextmanager
def safe_workers() -> Iterator[None]:
    """Keep the working directory out of the path of ``multiprocessing``'s processes meanwhile.

    ``multiprocessing`` builds their commands itself; from Python 3.11 on they obey the
    environment.
    """
    safe = {"PYTHONSAFEPATH": "1", "PYTHONPATH": os.pathsep.join(_path())}
    before = {name: os.environ.get(name) for name in safe}
    os.environ |= safe
    try:
        yield
    finally:
        for name, value in before.items():
            del os.environ[name]
            if value is not None:
                os.environ[name] = value


def stop_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT, SIGTERM and SIGHUP (the terminal was closed).

    SIGHUP is left out if it is ignored: that is how nohup keeps a program running. An ignored
    SIGINT is included all the same, since a shell sets it for everything that it starts in the
    background.
    """
    always = (signal.SIGINT, signal.SIGTERM)
    kept = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return always if kept else (*always, signal.SIGHUP)

"""Children in this very Python: they find the modules that this process finds, and no others.

``python -c`` and ``python -m`` put the working directory first on the path, so that a ``yaml.py``
beside a recording would be run. Isolated (``-I``) they put nothing there and ignore PYTHONPATH;
the path of this process is handed over instead, without the working directory.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import tirgeo_ros


def python_command(code: str, *arguments: str) -> list[str]:
    """The command that runs ``code`` with ``arguments`` in ``sys.argv[1:]``."""
    start = f"import sys; sys.path[:] = {_path()!r}\n{code}"
    return [sys.executable, "-I", "-c", start, *arguments]


def _path() -> list[str]:
    """Where this process finds modules; last the package itself, wherever it stands."""
    package = str(Path(tirgeo_ros.__file__).resolve().parents[1])
    here = os.path.realpath(".")
    found = [each for each in sys.path if each and os.path.realpath(each) != here]
    return [*found, package]


@contextmanager
def safe_workers() -> Iterator[None]:
    """While this is open, processes that ``multiprocessing`` spawns leave the directory out too.

    It builds their commands itself; from Python 3.11 on they heed the environment.
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

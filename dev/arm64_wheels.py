"""Ask pip whether every dependency has a wheel for Linux on ARM64: ``make check-arm64``.

ROS itself has none: on ARM64 it comes from Ubuntu's packages (docs/install.md).
"""

from __future__ import annotations

import argparse
import json
import re
import runpy
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Any
from unittest import mock

from dev.judging import MarkedTable
from tirgeo_ros.io.files.child_process import python_command
from tirgeo_ros.tools.presentation.progress import Progress

PYTHONS = ("3.10", "3.11", "3.12", "3.13")
#: The oldest system with a Python 3.10 is Ubuntu 22.04, glibc 2.35: wheels for any older one run.
_TAGS = ("manylinux2014", *(f"manylinux_2_{minor}" for minor in range(17, 36)))
_FROM_APT = "ros"
#: Without a wheel for any computer: plain Python, of which pip makes one.
_FROM_SOURCE = ("taky",)
_NAME = re.compile(r"[A-Za-z0-9._-]+")
_NONE = "none"


def requirements(setup_py: Path) -> list[str]:
    """Return what ``setup.py`` requires as wheels, with its extras but those of ROS."""
    with mock.patch("setuptools.setup") as setup:
        runpy.run_path(str(setup_py))
    arguments = setup.call_args.kwargs
    extras = [wanted for name, wanted in arguments["extras_require"].items() if name != _FROM_APT]
    every = chain(arguments["install_requires"], *extras)
    return [wanted for wanted in every if not wanted.startswith(_FROM_SOURCE)]


def versions(wanted: Sequence[str], python: str) -> dict[str, str]:
    """Return name to version of the wheels that pip would install, dependencies included.

    Empty if one of them has no wheel. Raises OSError where pip fails for another reason.
    """
    with tempfile.TemporaryDirectory() as work:
        report = Path(work, "report.json")
        options = ["--dry-run", "--ignore-installed", "--only-binary=:all:", "--target", work]
        options += ["--python-version", python, "--report", str(report), "--quiet"]
        options += [word for tag in _TAGS for word in ("--platform", f"{tag}_aarch64")]
        command = [*python_command("import runpy; runpy.run_module('pip', run_name='__main__')")]
        command += ["install", *options, *wanted]
        done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603
        if done.returncode:
            if "No matching distribution" in done.stderr:
                return {}
            raise OSError(f"pip: {done.stderr.strip().splitlines()[-1:]}")
        installed: dict[str, Any] = json.loads(report.read_text())
    wheels = [one["metadata"] for one in installed["install"]]
    return {_plain(wheel["name"]): wheel["version"] for wheel in wheels}


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


def found_for(wanted: Sequence[str], python: str) -> dict[str, str]:
    """Return for each requirement the version for a Python, or ``none``.

    All are asked for at once; only where that fails, one by one.
    """
    together = versions(wanted, python)
    rows = {}
    for one in wanted:
        name = _plain(_NAME.match(one).group())  # type: ignore[union-attr]
        rows[one] = (together or versions([one], python)).get(name, _NONE)
    return rows


def table(wanted: Sequence[str], columns: dict[str, dict[str, str]]) -> Iterator[str]:
    """Yield the lines: a requirement each, a column a Python."""
    rows = MarkedTable(36, 12)
    yield rows.row("wheels for Linux on aarch64", [f"Python {python}" for python in columns])
    for one in wanted:
        yield rows.row(one, [found[one] for found in columns.values()])


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; return 1 if a wheel is missing, 2 if pip cannot be asked."""
    parser = argparse.ArgumentParser(prog="python -m dev.arm64_wheels", description=__doc__)
    parser.add_argument("setup_py", type=Path, nargs="?", default=Path("setup.py"))
    wanted = requirements(parser.parse_args(argv).setup_py)
    columns = {}
    try:
        with Progress("asking pip", unit="Python") as bar:
            for done, python in enumerate(PYTHONS):
                bar(done, len(PYTHONS))
                columns[python] = found_for(wanted, python)
    except OSError as error:
        sys.stderr.write(f"check-arm64: {error}\n")
        return 2
    missing = sum(each == _NONE for found in columns.values() for each in found.values())
    sys.stdout.write("\n".join(table(wanted, columns)) + "\n")
    sys.stdout.write(f"{missing} missing; ROS 2 Jazzy comes from Ubuntu's packages there\n")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())

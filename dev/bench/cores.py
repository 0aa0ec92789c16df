"""Measure what several cores gain: ``tirgeo process`` with images, on one core and on all.

    python -m dev.bench.cores DIR [--runs 5] [--video out.mp4] [--against CHECKOUT]

DIR holds a simulated flight; two minutes or more, since starting takes a second on any number of
cores. The runs take turns; the fastest of each kind counts. ``--against`` adds another checkout
of the project, with its own speed on all cores, and says whether the bytes are the same.
"""

from __future__ import annotations

import argparse
import hashlib
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from dev.judging import Figure, print_figures

_PROJECT = Path(__file__).resolve().parents[2]
_CODE = """\
import os, sys
cores, folder, out, video = sys.argv[1:]
if cores == "1":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
from tirgeo_ros.tools.replay.process import process
files = {"params": f"{folder}/params.yaml", "map": f"{folder}/map.geojson"}
process(f"{folder}/flight.mcap", out, video=video or None, **files)
"""


class _Kind(NamedTuple):
    name: str
    checkout: Path
    cores: str  # "1" or "all"


class Run(NamedTuple):
    """Hold one run: its time, the processor time of all its processes, its output's hash."""

    wall_s: float
    cpu_s: float
    digest: str


def core_figures(
    folder: Path, runs: int, video: str = "", against: Path | None = None
) -> Iterator[Figure]:
    """Yield the times of the flight in ``folder`` on one core and on all, and their ratios."""
    kinds = [_Kind("one core", _PROJECT, "1"), _Kind("all cores", _PROJECT, "all")]
    if against is not None:
        kinds.append(_Kind(str(against), against, "all"))
    done: dict[str, list[Run]] = {kind.name: [] for kind in kinds}
    for _ in range(runs):
        for kind in kinds:
            done[kind.name].append(_run(kind, folder, video))
    for name, kind_runs in done.items():
        yield Figure(f"process with images, {name}", _least(kind_runs), "s")
        yield Figure(f"process with images, {name}: CPU", min(one.cpu_s for one in kind_runs), "s")
    best_s = _least(done["all cores"])
    yield Figure("all cores over one", _least(done["one core"]) / best_s, "ratio", ">= 1.6")
    if against is not None:
        yield Figure(f"all cores over {against}", _least(done[str(against)]) / best_s, "ratio")
    digests = {one.digest for kind_runs in done.values() for one in kind_runs}
    yield Figure("different outputs", len(digests) - 1, "", "= 0")


def _least(runs: Sequence[Run]) -> float:
    return min((one.wall_s for one in runs), default=math.nan)


def _run(kind: _Kind, folder: Path, video: str) -> Run:
    with tempfile.TemporaryDirectory() as work:
        out, film = Path(work) / "out.mcap", Path(work) / video if video else None
        begun_s, used_s = time.perf_counter(), _children_s()
        subprocess.run(  # noqa: S603  this very Python
            [sys.executable, "-c", _CODE, kind.cores, folder.resolve(), out, film or ""],
            cwd=kind.checkout,
            env=os.environ | {"PYTHONPATH": str(kind.checkout)},
            check=True,
        )
        wall_s, cpu_s = time.perf_counter() - begun_s, _children_s() - used_s
        files = [out, *([film] if film else [])]
        return Run(
            wall_s, cpu_s, hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()
        )


def _children_s() -> float:
    used = os.times()
    return used.children_user + used.children_system


def main(argv: Sequence[str] | None = None) -> int:
    """Print the figures."""
    parser = argparse.ArgumentParser(prog="python -m dev.bench.cores")
    parser.add_argument("folder", type=Path, metavar="DIR", help="a simulated flight")
    parser.add_argument("--runs", type=int, default=5, metavar="N", help="of each kind")
    parser.add_argument("--video", default="", metavar="NAME", help="write a video too: out.mp4")
    parser.add_argument("--against", type=Path, metavar="CHECKOUT", help="of the project")
    args = parser.parse_args(argv)
    sys.stdout.write(f"{args.folder}, {len(os.sched_getaffinity(0))} cores\n")
    print_figures(core_figures(args.folder, args.runs, args.video, args.against))
    return 0


if __name__ == "__main__":
    sys.exit(main())

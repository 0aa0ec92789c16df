"""Print the figures of the page's server."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from dev.judging import Figure, in_processes, line
from dev.page_load.served import ServedPage, draw_pictures, pictures_in
from dev.page_load.thin_link import ThinLink
from dev.page_load.viewer import Job, Watched, watch
from tirgeo_ros.tools.graph import find_resource

_VIEWERS = 3
_THIN_BITS_A_S = 1e6


def figures(pictures: Path, work: Path, seconds: float) -> Iterator[Figure]:
    """Yield the figures of three viewers alone, then of two beside one on a thin link."""
    sizes = [len(jpeg) for jpeg in pictures_in(pictures)]
    yield Figure("pictures, mean size", float(np.mean(sizes)) / 1e3, "kB")
    with ServedPage(pictures, work) as page:
        jobs = [Job(page.url, seconds, clicks=k == 0) for k in range(_VIEWERS)]
        seen, cores = _watched(page, jobs)
        yield from _alone(seen, cores)
        port = int(page.url.rpartition(":")[2])
        with ThinLink(port, _THIN_BITS_A_S) as near:
            thin = Job(f"http://127.0.0.1:{near}", seconds)
            seen, cores = _watched(page, [*jobs[1:], thin])
        yield from _beside(seen, cores)
        yield Figure("server, memory at the end", page.memory_bytes() * 2**-20, "MiB")


def _watched(page: ServedPage, jobs: Sequence[Job]) -> tuple[list[Watched], float]:
    """Return what the viewers saw, and the server's cores meanwhile."""
    begun, used = time.monotonic(), page.cpu_s()
    seen = in_processes(watch, jobs, len(jobs))
    return seen, (page.cpu_s() - used) / (time.monotonic() - begun)


def _alone(seen: Sequence[Watched], cores: float) -> Iterator[Figure]:
    ages = [age for one in seen for age in one.ages_ms]
    clicks = seen[0].clicks_ms
    yield _lateness("three viewers", seen)
    yield Figure("three viewers: pictures a second, least", min(one.hz for one in seen), "Hz")
    yield Figure("three viewers: frame to screen, median", float(np.median(ages)), "ms")
    yield Figure("three viewers: frame to screen, 95 %", _p95(ages), "ms", "<= 120")
    yield Figure("three viewers: click to answer, median", float(np.median(clicks)), "ms")
    yield Figure("three viewers: click to answer, 95 %", _p95(clicks), "ms", "<= 150")
    yield Figure("three viewers: server", cores, "cores", "<= 0.35")


def _beside(seen: Sequence[Watched], cores: float) -> Iterator[Figure]:
    *others, thin = seen
    ages = [age for one in others for age in one.ages_ms]
    yield _lateness("1 Mbit/s", seen)
    yield Figure("1 Mbit/s: pictures a second", thin.hz, "Hz")
    yield Figure("1 Mbit/s: mean size", float(np.mean(thin.sizes)) / 1e3, "kB")
    yield Figure("1 Mbit/s: age, median", float(np.median(thin.ages_ms)), "ms")
    yield Figure("1 Mbit/s: age, 95 %", _p95(thin.ages_ms), "ms", "<= 500")
    yield Figure("others beside it: pictures a second", min(o.hz for o in others), "Hz")
    yield Figure("others beside it: frame to screen, 95 %", _p95(ages), "ms", "<= 120")
    yield Figure("others beside it: server", cores, "cores", "<= 0.35")


def _lateness(name: str, seen: Sequence[Watched]) -> Figure:
    late = [one for viewer in seen for one in viewer.late_ms]
    return Figure(f"{name}: own sleep late, 95 %", _p95(late), "ms")


def _p95(values: Sequence[float]) -> float:
    return float(np.percentile(values, 95)) if values else float("nan")


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m dev.page_load", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", metavar="DIR", help="a simulated flight")
    parser.add_argument("--seconds", type=float, default=20.0, help="of watching, twice")
    args = parser.parse_args(argv)
    flight = args.folder or find_resource("bags/sample")
    if flight is None:
        parser.error("no sample flight is installed: give a folder")
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        draw_pictures(flight, work, work / "pictures")
        sys.stdout.write(f"{flight}, {os.cpu_count()} CPUs\n")
        for figure in figures(work / "pictures", work, args.seconds):
            sys.stdout.write(line(figure) + "\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""``make soak`` runs ``python -m dev.soak``: a table, and exit code 1 if a figure is missed."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from itertools import count
from pathlib import Path

import numpy as np

from dev.flights import SoakFlight, make_soak_flight
from dev.judging import Figure, exit_code, print_figures
from dev.soak.account import (
    FATES,
    Balance,
    Ledger,
    Record,
    balance,
    deviations,
    has_lines,
    lines_without_pose,
    read_ledger,
    read_record,
    witnessed,
)
from dev.soak.run import (
    GUEST,
    LEDGER,
    RECORD,
    WITNESS,
    Event,
    Life,
    Lives,
    run_soak,
    schedule,
)
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.cli.main import unwind_on_signals
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

#: What is shorter cannot tell of memory.
_SHORT_S = 300.0
_SETTLED_S = 60.0
#: Means over so long are compared: single samples show what a frame borrows.
_BLOCK_S = 15.0
#: So long may no pose and no picture come, by the clock on the wall: a node is down for 3 s, and
#: on a machine with much other work takes many more to start and to be found.
_SILENCE = "<= 60"
_GROWTH, _SIGMAS, _NONE = "<= 2", "<= 4", "<= 0"


def growth(samples: Sequence[tuple[float, int]]) -> float:
    """Return how much more memory a life has later than after its first minute: a part of that.

    ``samples``: seconds of life, and the bytes of its own, without the pages of Fast DDS's shared
    memory, of which docs/soak.md tells. Return nan where it was too short to have a later block.
    """
    means: list[float] = []  # of each block
    for number in count():
        begin_s = _SETTLED_S + number * _BLOCK_S
        block = [held for at_s, held in samples if begin_s <= at_s < begin_s + _BLOCK_S]
        if not block or samples[-1][0] < begin_s + _BLOCK_S:
            break
        means.append(float(np.mean(block)))
    return max(means[1:]) / means[0] - 1 if len(means) > 1 else math.nan


def memory_figures(lives: Sequence[Life], *, short: bool = False) -> Iterator[Figure]:
    """Yield each node's largest growth; the witness's is not the product's.

    A short soak cannot tell.
    """
    for node in dict.fromkeys(life.node for life in lives if life.node != GUEST):
        grown = [growth(life.memory) for life in lives if life.node == node]
        most = max((one for one in grown if not math.isnan(one)), default=math.nan)
        judged = node != WITNESS and not (short and math.isnan(most))
        asked = _GROWTH if judged else ""
        yield Figure(f"{node}: memory grown after its first minute", 100 * most, "%", asked)


def leftover_figures(lives: Lives) -> Iterator[Figure]:
    """Yield what is left, and who went without being asked."""
    ended = len(lives.by_themselves)
    yield Figure("segments left in shared memory", len(lives.left_files()), "", _NONE)
    yield Figure("processes left", len(lives.left_processes()), "", _NONE)
    yield Figure("nodes that ended by themselves or with an error", ended, "", _NONE)


def frame_figures(frames: Balance, sent: int) -> Iterator[Figure]:
    """Yield what became of the frames."""
    yield Figure("frames sent", sent)
    yield from (Figure(f"  {fate}", frames.fates[fate]) for fate in FATES)
    yield Figure("  without account", frames.unaccounted, "", _NONE)
    yield Figure("reports that contradict themselves", len(frames.contradictions), "", _NONE)
    yield Figure("lives of overlay_node of 20 s and more without a line", frames.blind, "", _NONE)


def pose_figures(record: Record, ledger: Ledger, flight: SoakFlight) -> Iterator[Figure]:
    """Yield the poses against the truth, in sigmas, axis by axis."""
    against = deviations(
        record.poses, flight.cameras, ledger.shift_ns, flight.period_ns, flight.start_ns
    )
    sigmas = against.sigmas if len(against.sigmas) else np.full((1, 6), math.nan)
    position, attitude = float(sigmas[:, :3].max()), float(sigmas[:, 3:].max())
    yield Figure("camera poses", len(against.stamps_ns))
    yield Figure("  at times of which nothing was sent", against.strangers, "", _NONE)
    yield Figure("  farthest from the truth, position", position, "sigma", _SIGMAS)
    yield Figure("  farthest from the truth, attitude", attitude, "sigma", _SIGMAS)
    yield Figure("longest time without a pose", _silence_s(record.poses.came_s), "s", _SILENCE)


def picture_figures(record: Record, lives: Sequence[Life]) -> Iterator[Figure]:
    """Yield the pictures with lines, and those of them that had no pose."""
    latency_ns = round(OverlayConfig().video_latency_s * 1e9)
    gimbals = [life.began_s for life in lives if life.node == "gimbal_node"]
    judged = witnessed(record.pictures, record.poses, gimbals)
    wrong = lines_without_pose(judged, record.poses.stamps_ns, latency_ns)
    came_s = np.array([picture.came_s for picture in record.pictures])
    yield Figure("pictures with lines", sum(map(has_lines, judged)))
    yield Figure("  where there is no pose", len(wrong), "", _NONE)
    left_out = len(record.pictures) - len(judged)
    yield Figure("pictures not judged: the witness had not found the poses", left_out)
    yield Figure("longest time without a picture", _silence_s(came_s), "s", _SILENCE)


def _silence_s(came_s: Array) -> float:
    """Return the longest time between two that came; infinite where none or one did."""
    return float(np.diff(came_s).max()) if len(came_s) > 1 else math.inf


def judged(lives: Lives, folder: Path, flight: SoakFlight, *, short: bool) -> list[Figure]:
    """Return all figures of a soak."""
    ledger, record = read_ledger(folder / LEDGER), read_record(folder / RECORD)
    overlays = [life for life in lives.all if life.node == "overlay_node"]
    spans = [(life.began_s, life.ended_s or math.inf, life.killed) for life in overlays]
    return [
        *memory_figures(lives.all, short=short),
        *leftover_figures(lives),
        *frame_figures(balance(ledger, record.reports, spans), len(ledger.stamps_ns)),
        *pose_figures(record, ledger, flight),
        *picture_figures(record, lives.all),
    ]


def soak(
    flight: SoakFlight,
    folder: Path,
    duration_s: float,
    events: list[Event],
    progress: Report = silent,
) -> list[Figure]:
    """Run a soak and judge it; ``soak.json`` is left in the folder.

    Raises GraphError for a node that does not start.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lives = run_soak(flight, events, folder, duration_s, progress)
    figures = judged(lives, folder, flight, short=duration_s < _SHORT_S)
    result = {
        "figures": [figure._asdict() | {"missed": figure.missed} for figure in figures],
        "events": [[e.at_s, e.kind.value, e.node, e.lasts_s] for e in events],
        "ended_by_themselves": lives.by_themselves,
        "memory": [{"node": life.node, "s_bytes": life.memory} for life in lives.all],
    }
    (folder / "soak.json").write_text(json.dumps(result, indent=2) + "\n")
    return figures


def _run(minutes: float, seed: int, folder: Path) -> int:
    duration_s = 60 * minutes
    events = schedule(seed, duration_s)
    with tempfile.TemporaryDirectory() as made:
        with Progress("simulating the flight", "s") as bar:
            flight = make_soak_flight(Path(made), bar)
        with Progress("soaking", "s") as bar:
            figures = soak(flight, folder, duration_s, events, bar)
    happened = Counter(event.kind.value for event in events)
    words = ", ".join(f"{number} x {what}" for what, number in happened.items())
    sys.stdout.write(f"{minutes:g} minutes; {words}\n")
    missed = sum(figure.missed for figure in print_figures(figures))
    if missed:
        sys.stdout.write(f"{missed} figures are missed, marked with !: see {folder}\n")
    return 1 if missed else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m dev.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="of the clock on the wall")
    parser.add_argument("--seed", type=int, default=1, help="of what happens when")
    parser.add_argument("-o", "--out", type=Path, default=Path("soak"), metavar="DIR")
    args = parser.parse_args(argv)
    if not args.minutes > 0:
        parser.error("--minutes: more than 0")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    return exit_code("soak", lambda: _run(args.minutes, args.seed, args.out))


if __name__ == "__main__":
    unwind_on_signals()
    sys.exit(main())

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
from dataclasses import dataclass
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
from dev.soak.run import GUEST, WITNESS, Event, Life, SoakRun, run_soak, schedule
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
Sample = tuple[float, int, int]  # seconds of life, bytes resident, bytes of them shared


@dataclass(frozen=True)
class Growth:
    """Hold how much more memory a process has later than after its first minute: parts of that.

    A process's own memory is judged: what is resident, less the pages of shared memory. These are
    all of Fast DDS's segments, each of which the process that makes it fills whole at its start; a
    reader counts those pages of a peer's segment as resident that it has ever read from.
    docs/soak.md tells why they become more where a peer is killed, and the table how many did.
    """

    own: float
    resident: float  # with the pages of shared memory that it has touched


def growth(samples: Sequence[Sample]) -> Growth | None:
    """Return the growth of one life, None where it was too short to have a later block."""
    means: list[Array] = []  # own and resident bytes of each block
    for number in count():
        begin_s = _SETTLED_S + number * _BLOCK_S
        block = [sample for sample in samples if begin_s <= sample[0] < begin_s + _BLOCK_S]
        if not block or samples[-1][0] < begin_s + _BLOCK_S:
            break
        _, resident, shared = np.mean(block, axis=0)
        means.append(np.array([resident - shared, resident]))
    return Growth(*(np.max(means[1:], axis=0) / means[0] - 1)) if len(means) > 1 else None


def memory_figures(lives: Sequence[Life], *, short: bool = False) -> Iterator[Figure]:
    """Yield each node's largest growth; the witness's is not the product's.

    A short soak cannot tell.
    """
    for node in dict.fromkeys(life.node for life in lives if life.node != GUEST):
        grown = [one for life in lives if life.node == node and (one := growth(life.memory))]
        own = max((one.own for one in grown), default=math.nan)
        resident = max((one.resident for one in grown), default=math.nan)
        judged = node != WITNESS and not (short and not grown)
        asked = _GROWTH if judged else ""
        yield Figure(f"{node}: memory grown after its first minute", 100 * own, "%", asked)
        yield Figure("  with the pages of shared memory that it has touched", 100 * resident, "%")


def leftover_figures(run: SoakRun) -> Iterator[Figure]:
    """Yield what is left, and who went without being asked.

    A killed process's ports (0.1 MB each) stay until the next one takes their numbers: to remove
    one might cut off that next one.
    """
    ports = sum("port" in name for name in run.left_files)
    ended = len(run.lives.by_themselves)
    yield Figure("segments left in shared memory", len(run.left_files) - ports, "", _NONE)
    yield Figure("  files of ports left there", ports)
    yield Figure("processes left", len(run.left_processes), "", _NONE)
    yield Figure("nodes that ended by themselves or with an error", ended, "", _NONE)


def frame_figures(frames: Balance) -> Iterator[Figure]:
    """Yield the balance of the frames."""
    yield Figure("frames sent", frames.sent)
    for key, words in FATES.items():
        yield Figure(f"  {words}", frames.fates[key])
    yield Figure("  sent while overlay_node was down or had not found the sender", frames.down)
    yield Figure("  after the last report of a killed overlay_node", frames.died)
    yield Figure("  last and first frames of a killed player and its successor", frames.changed)
    lost = frames.unaccounted + abs(frames.sent - frames.accounted)
    yield Figure("  without account", lost, "", _NONE)
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
    judged = witnessed(record.pictures, record.poses, gimbals, latency_ns)
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


def judged(run: SoakRun, flight: SoakFlight, *, short: bool) -> list[Figure]:
    """Return all figures of a soak."""
    ledger, record, lives = read_ledger(run.ledger), read_record(run.record), run.lives.all
    overlays = [life for life in lives if life.node == "overlay_node"]
    spans = [(life.began_s, life.ended_s or math.inf, life.killed) for life in overlays]
    return [
        *memory_figures(lives, short=short),
        *leftover_figures(run),
        *frame_figures(balance(ledger, record.reports, spans)),
        *pose_figures(record, ledger, flight),
        *picture_figures(record, lives),
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
    run = run_soak(flight, events, folder, duration_s, progress)
    figures = judged(run, flight, short=duration_s < _SHORT_S)
    _save(folder, run, events, figures)
    return figures


def _save(folder: Path, run: SoakRun, events: Sequence[Event], figures: Sequence[Figure]) -> None:
    result = {
        "figures": [
            figure._asdict()
            | {
                "value": figure.value if math.isfinite(figure.value) else None,
                "missed": figure.missed,
            }
            for figure in figures
        ],
        "events": [[e.at_s, e.kind.value, e.node, e.lasts_s] for e in events],
        "ended_by_themselves": run.lives.by_themselves,
        "left_files": run.left_files,
        "left_processes": run.left_processes,
        "memory": [
            {"node": life.node, "s_rss_shared": life.memory, "killed": life.killed}
            for life in run.lives.all
        ],
    }
    (folder / "soak.json").write_text(json.dumps(result, indent=2) + "\n")


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

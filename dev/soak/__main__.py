"""``make soak`` runs ``python -m dev.soak``: a table, and exit code 1 if missed."""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from dev.soak.balance import balance
from dev.soak.flight import SoakFlight, make_flight
from dev.soak.judge import (
    Figure,
    as_json,
    frame_figures,
    leftover_figures,
    memory_figures,
    picture_figures,
    pose_figures,
    table,
)
from dev.soak.records import read_ledger, read_record
from dev.soak.run import SoakRun, run_soak
from dev.soak.schedule import Event, schedule
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.tools.cli.main import INTERRUPTED, unwind_on_signals
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

#: What is shorter cannot tell of memory.
_SHORT_S = 300.0


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


def judged(run: SoakRun, flight: SoakFlight, *, short: bool) -> list[Figure]:
    """All figures of a soak."""
    ledger, record, lives = read_ledger(run.ledger), read_record(run.record), run.lives.all
    overlays = [life for life in lives if life.node == "overlay_node"]
    spans = [(life.began_s, life.ended_s or math.inf, life.killed) for life in overlays]
    return [
        *memory_figures(lives, short=short),
        *leftover_figures(run.left_files, run.left_processes, run.lives.by_themselves),
        *frame_figures(balance(ledger, record.reports, spans)),
        *pose_figures(record, ledger, flight),
        *picture_figures(record, lives),
    ]


def _save(folder: Path, run: SoakRun, events: Sequence[Event], figures: Sequence[Figure]) -> None:
    result = {
        "figures": as_json(figures),
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
    write = sys.stdout.write
    duration_s = 60 * args.minutes
    events = schedule(args.seed, duration_s)
    try:
        with tempfile.TemporaryDirectory() as made:
            with Progress("simulating the flight", "s") as bar:
                flight = make_flight(Path(made), bar)
            with Progress("soaking", "s") as bar:
                figures = soak(flight, args.out, duration_s, events, bar)
    except (TirgeoError, OSError) as error:
        sys.stderr.write(f"soak: {error}\n")
        return 1
    except KeyboardInterrupt:
        sys.stderr.write("soak: interrupted\n")
        return INTERRUPTED
    happened = Counter(event.kind.value for event in events)
    told = ", ".join(f"{number} x {what}" for what, number in happened.items())
    write("\n".join([f"{args.minutes:g} minutes; {told}", *table(figures), ""]))
    missed = sum(figure.missed for figure in figures)
    if missed:
        write(f"{missed} figures are missed, marked with !: see {args.out}\n")
    return 1 if missed else 0


if __name__ == "__main__":
    unwind_on_signals()
    sys.exit(main())

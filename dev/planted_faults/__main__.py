"""Plants every fault in the sample flight and prints what ``tirgeo check`` says of each."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dev.planted_faults.faults import FAULTS, Fault
from dev.planted_faults.live import CLEAN, Live, live_table, outcomes
from dev.planted_faults.planting import FlightFiles
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.replay.check import check

_JOBS = 2  # graphs at a time: each takes most of a core
_ROW = "| {:<31} | {:<5} | {}"


def found_in(fault: Fault, good: FlightFiles, folder: Path) -> list[dict[str, Any]]:
    """Return what is worse than a note in a flight with a fault; a refusal counts as one."""
    try:
        items: Any = check(**fault.plant(good, folder).arguments)["findings"]
    except TirgeoError as error:
        return [{"severity": "stop", "evidence": str(error), "parameter": str(error)}]
    return [one for one in items if one["severity"] != "note"]


def naming(fault: Fault, items: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return those that name what is wrong."""
    return [one for one in items if any(name in one["parameter"] for name in fault.names)]


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; 0 where all but two are named."""
    parser = argparse.ArgumentParser(prog="python -m dev.planted_faults")
    parser.add_argument("folder", type=Path, help="of a flight that tirgeo simulate wrote")
    parser.add_argument("--only", default="", metavar="WORDS", help="faults with these words")
    parser.add_argument("--live", nargs="*", metavar="NAME", help="through the node graph: these")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="recordings and logs, live")
    args = parser.parse_args(argv)
    good = FlightFiles.in_folder(args.folder)
    faults = [one for one in FAULTS if args.only in one.name]
    if args.live is not None:
        return _live(
            good,
            [one for one in (CLEAN, *faults) if one.name in args.live or not args.live],
            args.keep,
        )
    sys.stdout.write(_ROW.format("fault", "named", "by, and what else is said\n"))
    named = 0
    for fault in faults:
        with tempfile.TemporaryDirectory() as folder:
            items = found_in(fault, good, Path(folder))
        right = naming(fault, items)
        named += bool(right)
        said = "; ".join(f"{one['parameter']}: {one['evidence']}" for one in right[:1])
        more = [one["parameter"] for one in items if one not in right]
        also = f" (also {', '.join(more)})" if more else ""
        row = _ROW.format(fault.name, "yes" if right else "NO", said + also)
        sys.stdout.write(f"{row}\n")
        sys.stdout.flush()
    sys.stdout.write(f"{named} of {len(faults)} named\n")
    return 0 if len(faults) - named <= 2 else 1


def _live(good: FlightFiles, faults: Sequence[Fault], keep: Path | None) -> int:
    """Print the table of the graph; 0 where it is as it must be."""
    with tempfile.TemporaryDirectory() as folder, Progress("playing", unit="s") as bar:
        found = outcomes(Live(good, keep or Path(folder)), faults, _JOBS, bar)
    sys.stdout.write(live_table(found))
    return 0 if all(one.is_good for one in found) else 1


if __name__ == "__main__":
    sys.exit(main())

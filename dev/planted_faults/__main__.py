# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Plants every fault in a flight and prints what ``tirgeo check`` says of each."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import median
from typing import Any

from dev.planted_faults.ellipses import flight_times
from dev.planted_faults.faults import FAULTS, Fault, FlightFiles
from dev.planted_faults.live import CLEAN, live_table, outcomes
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.tools.presentation.progress import Progress
from tirgeo_ros.tools.replay.check import check
from tirgeo_ros.tools.replay.process import process

_ROW = "| {:<31} | {:<5} | {:<7} | {:>14} | {}\n"
_HEAD = ("fault", "named", "process", "ellipses", "by, and what else is said")
#: A fault may be missed, as the next ones to find are: a small boresight, a map some metres off.
_MISSED = 4
_MOST_TIMES = 3.0  # no silent fault moves the map by more ellipses


def found_in(fault: Fault, good: FlightFiles, folder: Path) -> list[dict[str, Any]]:
    """Return what is worse than a note in a flight with a fault; a refusal counts too."""
    return _found(lambda: check(**fault.plant(good, folder).arguments))


def _found(run: Callable[[], Any]) -> list[dict[str, Any]]:
    try:
        items: Any = run()["findings"]
    except TirgeoError as error:
        return [{"severity": "stop", "evidence": str(error), "parameter": str(error), "mend": ""}]
    return [item for item in items if item["severity"] != "note"]


def naming(fault: Fault, items: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return those that name what is wrong."""
    return [
        item
        for item in items
        if any(name in item["parameter"] for name in fault.names)
        and fault.word in item["evidence"] + item["mend"]
    ]


def _judged(fault: Fault, good: FlightFiles, folder: Path) -> tuple[bool, bool, str]:
    """Return whether a fault is named, whether it is silent and wrong, and its row."""
    planted, poses = fault.plant(good, folder), folder / "poses.mcap"
    items = _found(lambda: check(**planted.arguments))
    options = {**planted.arguments, "images": False}
    del options["bag"]
    right = naming(fault, items)
    processed = naming(fault, _found(lambda: process(planted.bag, poses, **options)))
    times = flight_times(good, planted, poses, fault.flipped) if poses.exists() else []
    first = "; ".join(
        f"{item['severity']} {item['parameter']}: {item['evidence']}" for item in right[:1]
    )
    more = [f"{item['severity']} {item['parameter']}" for item in items if item not in right]
    ahead = "after " if items and right and items[0] is not right[0] else "also "
    also = f" ({ahead}{', '.join(more)})" if more else ""
    size = f"{median(times):.1f}, {max(times):.1f}" if times else ""
    words = ("yes" if right else "NO", "yes" if processed else "NO", size, first + also)
    lies = not items and bool(times) and median(times) > _MOST_TIMES
    return bool(right), lies, _ROW.format(fault.name, *words)


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table; 0 where all but some are named, and none is silent and far off."""
    parser = argparse.ArgumentParser(prog="python -m dev.planted_faults")
    parser.add_argument("folder", type=Path, help="of a flight that tirgeo simulate wrote")
    parser.add_argument("--only", default="", metavar="WORDS", help="faults with these words")
    parser.add_argument("--live", action="store_true", help="play them through the node graph")
    args = parser.parse_args(argv)
    good = FlightFiles.in_folder(args.folder)
    faults = [fault for fault in FAULTS if args.only in fault.name]
    if args.live:
        with tempfile.TemporaryDirectory() as folder, Progress("playing", unit="s") as bar:
            results = outcomes(good, [CLEAN, *faults], Path(folder), bar)
        sys.stdout.write(live_table(results))
        return 0 if all(outcome.is_good for outcome in results) else 1
    sys.stdout.write(_ROW.format(*_HEAD))
    named = 0
    lying: list[str] = []
    for fault in faults:
        with tempfile.TemporaryDirectory() as folder:
            right, lies, row = _judged(fault, good, Path(folder))
        named, lying = named + right, lying + [fault.name] * lies
        sys.stdout.write(row)
        sys.stdout.flush()
    silent = ", ".join(lying) or "none"
    sys.stdout.write(f"{named} of {len(faults)} named; silent beyond 3 ellipses: {silent}\n")
    return 0 if len(faults) - named <= _MISSED and not lying else 1


if __name__ == "__main__":
    sys.exit(main())

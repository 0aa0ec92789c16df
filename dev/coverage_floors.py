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
"""Print which branches the tests have run, and fail below the floors: ``make coverage``.

It reads the report that ``coverage json`` writes. Exit code 1 where a part is below its floor.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeAlias

#: Part of the tree -> least share of its branches, %.
FLOORS = {"tirgeo_ros/core/": 95.0, "tirgeo_ros/": 90.0}
WORST = 15

#: By file what coverage.py calls its summary: ``num_branches``, ``covered_branches`` and so on.
Summaries: TypeAlias = Mapping[str, Mapping[str, int]]


def share(files: Summaries, what: str = "branches") -> float:
    """Return how much of the files' branches, or ``lines``, the tests ran, %."""
    total = "num_branches" if what == "branches" else "num_statements"
    there = sum(summary[total] for summary in files.values())
    return 100.0 * sum(summary[f"covered_{what}"] for summary in files.values()) / max(there, 1)


def below_floors(files: Summaries) -> list[str]:
    """Print a row for each part that has a floor; return the parts that are below theirs."""
    low = []
    for part, floor in FLOORS.items():
        inside = {path: summary for path, summary in files.items() if path.startswith(part)}
        branches = share(inside)
        row = f"{part:20} branches {branches:5.1f} % (floor {floor:.0f})"
        sys.stdout.write(f"{row}, lines {share(inside, 'lines'):5.1f} %\n")
        if branches < floor:
            low.append(part)
    return low


def print_worst(files: Summaries) -> None:
    """Print the files with most branches that no test ran."""
    missing = {path: one["num_branches"] - one["covered_branches"] for path, one in files.items()}
    for path in sorted(files, key=lambda path: -missing[path])[:WORST]:
        sys.stdout.write(f"{missing[path]:5} of {files[path]['num_branches']:4}  {path}\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """Read the report and print it; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m dev.coverage_floors", description=__doc__)
    parser.add_argument("report", type=Path)
    report = json.loads(parser.parse_args(arguments).report.read_text())
    files = {path: file["summary"] for path, file in report["files"].items()}
    sys.stdout.write("most branches that no test ran:\n")
    print_worst(files)
    low = below_floors(files)
    if low:
        sys.stderr.write(f"below the floor: {', '.join(low)}\n")
    return int(bool(low))


if __name__ == "__main__":
    sys.exit(main())

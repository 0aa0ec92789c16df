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
"""``make states``: what the filter says over a recorded flight, ten times a second, as CSV.

The table of the sample flight is tracked (``test/data/sample_states.csv``) and compared with a
fresh one by a test, so a change of the numbers shows in review. Digits stop far below every sigma
and far above what versions of NumPy and processors make of the last bits.
"""

from __future__ import annotations

import argparse
import csv
import io
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from dev.judging import exit_code
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.streams.stamps import RateLimit
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import csv_text
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.presentation.progress import silent
from tirgeo_ros.tools.replay.flight import Flight
from tirgeo_ros.tools.replay.registration import SAMPLES, Sample, navigated

RATE_HZ = 10.0
_NED = ("north", "east", "down")
#: Name -> decimals.
COLUMNS = {
    **dict.fromkeys(("latitude_deg", "longitude_deg"), 9),  # 0.1 mm
    "height_m": 4,
    **{f"velocity_{axis}_m_s": 4 for axis in _NED},
    **{f"{angle}_deg": 4 for angle in ("roll", "pitch", "heading")},
    **{f"sigma_position_{axis}_m": 5 for axis in _NED},
    **{f"sigma_attitude_{axis}_deg": 5 for axis in _NED},
    **{f"sigma_velocity_{axis}_m_s": 5 for axis in _NED},
}
HEADER = ("stamp_ns", *COLUMNS, "state")
#: One in the last digit, for values at a tie that round apart. They differ by 6e-14 at the most
#: between NumPy 1.26 and 2.4, and between BLAS kernels with and without fused multiplication.
_TOLERANCE_DIGITS = 1.5


def states_text(bag: Path, params: Path) -> str:
    """Return the table of a bag under the parameters of a file. Raises BagError, ConfigError."""
    return csv_text([HEADER, *_rows(bag, params)])


def _rows(bag: Path, params: Path) -> Iterator[list[str]]:
    navigation = Navigation(ParameterFile(params).config("ekf_node", EkfConfig))
    rate, samples = RateLimit(RATE_HZ), list[Sample]()
    flight = Flight(BagReader(bag), needs_camera=False)
    flight.add(SAMPLES, samples.append)
    flight.read_all(silent)
    for sample in samples:
        solution = navigated(navigation, sample)
        if solution is None or not rate.due(solution.stamp_ns):
            continue
        place_deg = np.degrees([solution.latitude_rad, solution.longitude_rad])
        roll, pitch, heading = np.degrees(euler_from_quat(solution.q_nb)).tolist()
        sigma = np.sqrt(solution.covariance.diagonal())
        sigma[3:6] = np.degrees(sigma[3:6])
        angles = roll, pitch, heading % 360.0
        values = [*place_deg, solution.height_m, *solution.velocity_n, *angles, *sigma]
        written = [f"{x:.{n}f}" for x, n in zip(values, COLUMNS.values(), strict=True)]
        yield [str(solution.stamp_ns), *written, navigation.status().state.value]


def changes(old: str, new: str) -> list[str]:
    """Return what a new table says otherwise than an old one, a line for each column.

    Raises BagError where either is no such table.
    """
    before, now = _read(old), _read(new)
    if [row[0] for row in before] != [row[0] for row in now]:
        return [f"stamps differ: {len(before)} rows before, {len(now)} now"]
    was, is_now = (np.array([row[1:-1] for row in rows], float) for rows in (before, now))
    lines = []
    for k, (name, decimals) in enumerate(COLUMNS.items()):
        apart, tolerance = is_now[:, k] - was[:, k], _TOLERANCE_DIGITS * 10.0**-decimals
        if name == "heading_deg":
            apart = (apart + 180.0) % 360.0 - 180.0
        moved = int(np.count_nonzero(~(np.abs(apart) <= tolerance)))
        if moved:
            worst = int(np.argmax(np.abs(apart)))
            lines.append(
                f"{name}: {moved} of {len(now)} rows moved, most by {apart[worst]:+.{decimals}f} "
                f"at {now[worst][0]}, where it was {before[worst][k + 1]}"
            )
    states = [(a[0], a[-1], b[-1]) for a, b in zip(before, now, strict=True) if a[-1] != b[-1]]
    if states:
        stamp, first, second = states[0]
        lines.append(f"state: {len(states)} rows, first at {stamp}: {first} before, {second} now")
    return lines


def _read(text: str) -> list[list[str]]:
    header, *rows = list(csv.reader(io.StringIO(text))) or [[]]
    if tuple(header) != HEADER or any(len(row) != len(HEADER) for row in rows):
        raise BagError("no table of states: its header or the length of a row is another")
    return rows


def main(argv: Sequence[str] | None = None) -> int:
    """Write the table and tell what is new in it."""
    parser = argparse.ArgumentParser(prog="python -m dev.state_table")
    parser.add_argument("folder", type=Path, help="with flight.mcap and params.yaml")
    parser.add_argument("table", type=Path, help="the CSV file to write")
    args = parser.parse_args(argv)

    def write() -> int:
        text = states_text(args.folder / "flight.mcap", args.folder / "params.yaml")
        if args.table.is_file():
            lines = changes(args.table.read_text(encoding="ascii"), text) or ["nothing moved"]
            sys.stdout.write("\n".join([*lines, ""]))
        args.table.write_text(text, encoding="ascii")
        return 0

    return exit_code("states", write)


if __name__ == "__main__":
    sys.exit(main())

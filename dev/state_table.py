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
from itertools import chain
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dev.judging import exit_code
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.streams.stamps import RateLimit
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import csv_text
from tirgeo_ros.io.parameters.parameter_file import load_config
from tirgeo_ros.tools.presentation.progress import silent
from tirgeo_ros.tools.replay.flight import Flight
from tirgeo_ros.tools.replay.registration import SAMPLES, Sample, navigated

RATE_HZ = 10.0


class Column(NamedTuple):
    """Hold the name of a number in the table, and its decimals."""

    name: str
    decimals: int

    @property
    def tolerance(self) -> float:
        """Return one in the last digit, for values at a tie that round apart.

        The values themselves differ by 6e-14 at the most between NumPy 1.26 and 2.4 and between
        BLAS kernels with and without fused multiplication.
        """
        return 1.5 * 10.0**-self.decimals


_NED = ("north", "east", "down")
COLUMNS = (
    Column("latitude_deg", 9),  # 0.1 mm
    Column("longitude_deg", 9),
    Column("height_m", 4),
    *(Column(f"velocity_{axis}_m_s", 4) for axis in _NED),
    *(Column(f"{angle}_deg", 4) for angle in ("roll", "pitch", "heading")),
    *(Column(f"sigma_position_{axis}_m", 5) for axis in _NED),
    *(Column(f"sigma_attitude_{axis}_deg", 5) for axis in _NED),
    *(Column(f"sigma_velocity_{axis}_m_s", 5) for axis in _NED),
)
HEADER = ("stamp_ns", *(column.name for column in COLUMNS), "state")
_TURN_DEG = 360.0


def states_text(bag: Path, params: Path) -> str:
    """Return the table of a bag under the parameters of a file. Raises BagError, ConfigError."""
    return csv_text([HEADER, *_rows(bag, params)])


def _rows(bag: Path, params: Path) -> Iterator[list[str]]:
    navigation = Navigation(load_config(params, "ekf_node", EkfConfig))
    rate, samples = RateLimit(RATE_HZ), list[Sample]()
    flight = Flight(BagReader(bag), needs_camera=False)
    flight.add(SAMPLES, samples.append)
    flight.read_all(silent)
    for sample in samples:
        solution = navigated(navigation, sample)
        if solution is not None and rate.due(solution.stamp_ns):
            written = (f"{v:.{c.decimals}f}" for v, c in zip(_values(solution), COLUMNS))  # noqa: B905 as long as each other
            yield [str(solution.stamp_ns), *written, navigation.status().state.value]


def _values(solution: NavSolution) -> Iterator[float]:
    """Yield the values in the order of COLUMNS."""
    roll, pitch, heading = np.degrees(euler_from_quat(solution.q_nb)).tolist()
    sigma = np.sqrt(solution.covariance.diagonal())
    sigma[3:6] = np.degrees(sigma[3:6])
    place = np.degrees([solution.latitude_rad, solution.longitude_rad]).tolist()
    return chain(
        (*place, solution.height_m),
        solution.velocity_n.tolist(),
        (roll, pitch, heading % _TURN_DEG),
        sigma.tolist(),
    )


def changes(old: str, new: str) -> list[str]:
    """Return what a new table says otherwise than an old one, a line for each column.

    Raises BagError where either is no such table.
    """
    before, now = _read(old), _read(new)
    if [row[0] for row in before] != [row[0] for row in now]:
        return [f"stamps differ: {_span(before)} before, {_span(now)} now"]
    differences = []
    for index, column in enumerate(COLUMNS, start=1):
        apart = [float(b[index]) - float(a[index]) for a, b in zip(before, now)]  # noqa: B905 the same stamps
        if column.name == "heading_deg":
            apart = [(x + _TURN_DEG / 2) % _TURN_DEG - _TURN_DEG / 2 for x in apart]
        line = _moved(column, apart, before)
        differences += [line] if line else []
    other = [(a, b) for a, b in zip(before, now) if a[-1] != b[-1]]  # noqa: B905
    if other:
        (stamp, *_, was), (*_, is_now) = other[0]
        differences.append(
            f"state: {len(other)} rows, first at {stamp}: {was} before, {is_now} now"
        )
    return differences


def _moved(column: Column, apart: list[float], rows: list[list[str]]) -> str:
    """Return a line on a column that moved by more than rounding, or nothing."""
    beyond = [k for k, x in enumerate(apart) if not abs(x) <= column.tolerance]
    if not beyond:
        return ""
    worst = max(beyond, key=lambda k: abs(apart[k]))
    after_s = (int(rows[worst][0]) - int(rows[0][0])) * 1e-9
    was = rows[worst][HEADER.index(column.name)]
    return (
        f"{column.name}: {len(beyond)} of {len(rows)} rows moved, most by "
        f"{apart[worst]:+.{column.decimals}f} at {rows[worst][0]} ({after_s:.1f} s after the "
        f"first row), where it was {was}; {column.tolerance:g} is rounding"
    )


def _read(text: str) -> list[list[str]]:
    header, *rows = list(csv.reader(io.StringIO(text))) or [[]]
    if tuple(header) != HEADER or any(len(row) != len(HEADER) for row in rows):
        raise BagError("no table of states: its header or the length of a row is another")
    return rows


def _span(rows: list[list[str]]) -> str:
    return f"{len(rows)} rows from {rows[0][0]} to {rows[-1][0]}" if rows else "no rows"


def main(argv: Sequence[str] | None = None) -> int:
    """Write the table and tell what is new in it."""
    parser = argparse.ArgumentParser(prog="python -m dev.state_table")
    parser.add_argument("folder", type=Path, help="with flight.mcap and params.yaml")
    parser.add_argument("table", type=Path, help="the CSV file to write")
    args = parser.parse_args(argv)
    return exit_code("states", lambda: _write(args.folder, args.table))


def _write(folder: Path, table: Path) -> int:
    text = states_text(folder / "flight.mcap", folder / "params.yaml")
    if table.is_file():
        lines = changes(table.read_text(encoding="ascii"), text) or ["nothing moved"]
        sys.stdout.write("\n".join([*lines, ""]))
    table.parent.mkdir(parents=True, exist_ok=True)
    table.write_text(text, encoding="ascii")
    return 0


if __name__ == "__main__":
    sys.exit(main())

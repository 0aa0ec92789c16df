"""The verb ``tirgeo budget``."""

from __future__ import annotations

import argparse
import math
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._arguments import add_parameters
from tirgeo_ros.tools.cli._verb import Subparsers
from tirgeo_ros.tools.presentation.progress import Progress

#: Option, name of the value, unit, help text.
_VALUES = (
    ("--height", "height_m", "M", "of the camera above the ground"),
    ("--tilt", "depression_deg", "DEG", "of the optical axis below the horizon"),
    ("--speed", "speed_m_s", "M_S", "along which an error of time acts"),
    ("--east-error", "east_error_m", "M", "of the camera's position"),
    ("--north-error", "north_error_m", "M", "of the camera's position"),
    ("--height-error", "height_error_m", "M", "of the camera's position"),
    ("--heading-error", "heading_error_deg", "DEG", "of the camera's attitude"),
    ("--roll-error", "roll_error_deg", "DEG", "of the camera's attitude"),
    ("--pitch-error", "pitch_error_deg", "DEG", "of the camera's attitude"),
)


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "budget",
        help="the errors on the ground that errors of the pose make",
        description="The error budget over the camera's picture: root mean square errors on level "
        "ground by factor, by the closed form of Ren et al. 2022 (section 3.5, a pinhole camera) "
        "and by the whole covariance of the pose, with the lens. Without a bag the errors, the "
        "view and the camera are those of the paper. With a bag they are the flight's: its "
        "ordinary GPS against RTK, its autopilot's heading against the filter's (Eq. 22), and a "
        "second table is made of the filter's own covariance.",
        epilog="example:\n  tirgeo budget --height 60 --tilt 45 -o budget\n"
        "  tirgeo budget bags/sample/flight.mcap --params bags/sample/params.yaml",
    )
    parser.add_argument("bag", nargs="?", type=Path, metavar="IN.mcap", help="a flight")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", help="for CSV and maps (PNG)")
    add_parameters(parser)
    for option, name, unit, what in _VALUES:
        parser.add_argument(option, dest=name, type=float, metavar=unit, help=what)
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Compute the budget; return it as plain values."""
    from tirgeo_ros.tools.budget.budget_files import make_budget  # noqa: PLC0415 heavy

    values = {name: getattr(args, name) for _, name, _, _ in _VALUES}
    with Progress("reading", unit="s") as bar:
        return make_budget(
            {name: value for name, value in values.items() if value is not None},
            bag=args.bag,
            output=args.output,
            params=args.params,
            camera=args.camera,
            namespace=args.namespace,
            progress=bar,
        )


def describe(result: dict[str, Any]) -> str:
    """Return the tables for a person."""
    view = f"{result['height_m']:.4g} m above the ground, {result['depression_deg']:.4g} deg down"
    parts = [f"camera {view}"]
    if "flight" in result:
        measured = "\n".join(
            f"{name:<20}{_measured(value)}" for name, value in result["flight"].items()
        )
        parts.append(f"GPS against RTK, autopilot against filter (Eq. 22)\n{measured}")
    parts.append(f"errors on the ground, m\n{_table(result['rows'])}")
    sky = 1 - result["ground_share"]
    if sky > 0:
        parts.append(
            f"{sky:.0%} of the picture lies over the horizon and is left out; just below it "
            "errors grow without bound: take the median"
        )
    if "rows_of_the_filter" in result:
        parts.append(f"by the filter's own covariance, m\n{_table(result['rows_of_the_filter'])}")
    if "output" in result:
        parts.append("\n".join(result["output"]))
    return "\n\n".join(parts)


_WIDE = 1e6  # m: larger values do not fit the columns with their millimetres
_COLUMNS = ("middle", "mean", "median", "percentile 95", "largest")


def _table(rows: list[dict[str, Any]]) -> str:
    lines = [f"{'factor':<16}{'form':<9}" + "".join(f"{name:>14}" for name in _COLUMNS)]
    for row in rows:
        numbers = [row[f"{name.replace(' ', '_')}_m"] for name in _COLUMNS]
        lines.append(
            f"{row['factor']:<16}{row['form']:<9}"
            + "".join(f"{_number(value):>14}" for value in numbers)
        )
    return "\n".join(lines)


def _measured(value: float) -> str:
    return f"{value:.4g}" if math.isfinite(value) else "not recorded; that of the paper is taken"


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.3f}" if value < _WIDE else f"{value:.4g}"

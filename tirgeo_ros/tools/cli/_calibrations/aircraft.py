"""The verb ``tirgeo calibrate aircraft``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._arguments import add_flight
from tirgeo_ros.tools.cli._verb import Subparsers
from tirgeo_ros.tools.presentation.progress import Progress

_NAMES = (
    "antenna",
    "baseline",
    "elevation",
    "position_delay",
    "velocity_delay",
    "heading_delay",
    "level",
    "rtk",
)
_KNOWN = ", ".join(_NAMES)


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "aircraft",
        help="antennas, delays and the IMU's level, from an ordinary flight",
        description="Finds from a flight with turns, without any point on the ground, where the "
        "RTK antenna is, where the two antennas point, how late positions, velocities and "
        "headings are against the IMU, and how the IMU sits against the autopilot's level. What "
        "the flight cannot tell is named, with what to fly for it. The file is given to --params "
        "and to the nodes after the aircraft's own.",
        epilog="example:\n  tirgeo calibrate aircraft flight.mcap --params aircraft.yaml "
        "-o found.yaml --plot found.png\n"
        "  tirgeo process flight.mcap -o out.mcap --params aircraft.yaml --params found.yaml",
    )
    add_flight(parser)
    parser.add_argument(
        "-o", "--output", type=Path, metavar="YAML", help="the parameters (without: shown only)"
    )
    parser.add_argument(
        "--params",
        action="append",
        type=Path,
        metavar="YAML",
        help="ROS 2 parameter file; may be repeated: a later one stands before an earlier",
    )
    parser.add_argument("--namespace", default="", metavar="NS", help="of the bag's topics")
    parser.add_argument(
        "--hold",
        type=_names,
        default=[],
        metavar="NAMES",
        help=f"with commas, of {_KNOWN}: as --params has them. Only differences of delays are "
        "seen: by itself the IMU's stays; rtk holds that of positions and finds the IMU's",
    )
    parser.add_argument("--plot", type=Path, metavar="PNG", help="innovations before and after")
    return parser


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in _NAMES:
            raise argparse.ArgumentTypeError(f"{name} is none of {_KNOWN}")
    return names


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run the calibration; return its summary."""
    from tirgeo_ros.tools.calibrate.aircraft import calibrate_aircraft  # noqa: PLC0415 heavy

    with Progress("calibrating", unit="runs") as bar:
        return calibrate_aircraft(
            args.bag,
            args.output,
            params=args.params,
            hold=args.hold,
            namespace=args.namespace,
            plot=args.plot,
            progress=bar,
        )


def describe(result: dict[str, Any]) -> str:
    """Return the estimates as a table, what was not determined, and the innovations' size."""
    from tirgeo_ros.tools.calibrate.estimates import closing_lines, table  # noqa: PLC0415 heavy

    lines = table(result["parameters"])
    lines += [f"not told: {name}: {reason}" for name, reason in result["not_told"].items()]
    nis = [
        f"{source} {one['before']:.3g} before, {one['after']:.2f} after"
        for source, one in result["nis"].items()
    ]
    lines.append(f"squared innovations over what is foreseen: {'; '.join(nis)}")
    return "\n".join([*lines, *closing_lines(result)])

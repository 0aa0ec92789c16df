"""The verb ``tirgeo calibrate imu``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._arguments import add_flight, add_window, check_window
from tirgeo_ros.tools.cli._verb import Subparsers
from tirgeo_ros.tools.presentation.progress import Progress


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "imu",
        help="noise of the IMU in flight, and what shakes it",
        description="Measures the white noise of gyroscopes and accelerometers in a flight, "
        "between the lines of vibration above 8 Hz, beside the second differences that the filter "
        "follows by itself, and the strongest lines. Writes the noise of the flight's calmest "
        "tenth as parameters for ekf_node, and a plot. Without -o it only tells.",
        epilog="example:\n  tirgeo calibrate imu flight.mcap -o imu.yaml\n"
        "  tirgeo process flight.mcap -o out.mcap --params aircraft.yaml --params imu.yaml",
    )
    add_flight(parser)
    parser.add_argument("-o", "--output", type=Path, metavar="YAML")
    parser.add_argument(
        "--params",
        action="append",
        type=Path,
        metavar="YAML",
        help="ROS 2 parameter file, whose noise is not gone below; may be repeated",
    )
    parser.add_argument("--namespace", default="", metavar="NS", help="of the bag's topics")
    add_window(parser)
    parser.add_argument(
        "--plot", type=Path, metavar="PNG", help="the plot's place (default: beside the YAML)"
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Measure the noise; return a summary."""
    from tirgeo_ros.tools.calibrate.imu import calibrate_imu  # noqa: PLC0415 heavy

    check_window(args)
    with Progress("reading", unit="s") as bar:
        return calibrate_imu(
            args.bag,
            args.output,
            params=args.params,
            namespace=args.namespace,
            from_s=args.from_s,
            to_s=args.to_s,
            plot=args.plot,
            progress=bar,
        )


def describe(result: dict[str, Any]) -> str:
    """Return the axes as a table, and what was written."""
    from tirgeo_ros.tools.calibrate.imu_noise_tables import flight_table  # noqa: PLC0415 heavy

    rest = f", {result['resting_s']} s at rest left out" if result["resting_s"] else ""
    skipped = f", {result['skipped_s']} s with gaps left out" if result["skipped_s"] else ""
    return (
        f"{result['samples']} samples of {result['topic']} at {result['rate_hz']:.2f} Hz: "
        f"{result['flying_s']} s in flight{rest}{skipped}\n"
        f"{flight_table(result['axes'])}\n"
        f"written: {', '.join(result['output']) or 'nothing; -o writes it'}"
    )

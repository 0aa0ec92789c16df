"""The verb ``tirgeo calibrate allan``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._arguments import add_window, check_window
from tirgeo_ros.tools.cli._verb import Subparsers
from tirgeo_ros.tools.presentation.progress import Progress


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "allan",
        help="noise of the IMU from hours at rest (Allan variance)",
        description="Overlapping Allan deviation of each axis of an IMU that lay still for hours, "
        "with motors off: random walk N, bias instability B (flicker floor over 0.664, the plain "
        "minimum beside it), rate random walk K, and the Gauss-Markov bias that the filter "
        "models. Writes parameters for ekf_node and a plot.",
        epilog="example:\n  tirgeo calibrate allan still.mcap -o imu.yaml --csv imu.csv\n"
        "  tirgeo process flight.mcap -o out.mcap --params imu.yaml",
    )
    parser.add_argument("bag", type=Path, metavar="IN.mcap", help="the record at rest")
    parser.add_argument("-o", "--output", type=Path, metavar="YAML", required=True)
    parser.add_argument(
        "--topic", default="imu/data", help="of sensor_msgs/Imu (default: %(default)s)"
    )
    parser.add_argument("--namespace", default="", metavar="NS", help="of the bag's topics")
    add_window(parser)
    parser.add_argument(
        "--plot", type=Path, metavar="PNG", help="the plot's place (default: beside the YAML)"
    )
    parser.add_argument("--csv", type=Path, metavar="CSV", help="the curves as numbers too")
    parser.add_argument(
        "--moved", action="store_true", help="write the figures of a record that moved, too"
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Estimate the noise; return a summary."""
    from tirgeo_ros.tools.calibrate.allan import calibrate_allan  # noqa: PLC0415 heavy

    check_window(args)
    with Progress("reading", unit="s") as bar:
        return calibrate_allan(
            args.bag,
            args.output,
            topic=args.topic,
            namespace=args.namespace,
            from_s=args.from_s,
            to_s=args.to_s,
            plot=args.plot,
            csv=args.csv,
            moved=args.moved,
            progress=bar,
        )


def describe(result: dict[str, Any]) -> str:
    """Return the axes as a table, and what was written."""
    from tirgeo_ros.tools.calibrate.imu_noise_tables import rest_table  # noqa: PLC0415 heavy

    odd = ", ".join(f"{number} {what}" for what, number in result["irregular"].items() if number)
    return (
        f"{result['samples']} samples of {result['topic']}, {result['span_s'] / 3600:.2f} h at "
        f"{result['rate_hz']:.2f} Hz, stamps to {result['jitter_ms']:.2g} ms"
        f"{'; ' if odd else ''}{odd.replace('_', ' ')}\n"
        f"{rest_table(result['axes'])}\n"
        f"written: {', '.join(result['output'])}"
    )

"""The verb ``tirgeo simulate``."""

from __future__ import annotations

import argparse
from pathlib import Path

from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS
from tirgeo_ros.tools.cli._verb import Subparsers, UsageError
from tirgeo_ros.tools.presentation.progress import Progress

_MOST_HZ = 50  # as in the scenario


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "simulate",
        help="fly a scenario, with truth",
        description="Flies a scenario and writes flight.mcap (what the aircraft recorded, with "
        "thermal video), truth.mcap, map.geojson, survey.geojson, targets.geojson (what is "
        "warm in it), observations.csv and params.yaml. The same seed gives the same bytes.",
        epilog="example:\n  tirgeo simulate config/scenarios/paper_flight.yaml -o flight "
        "--start 30 --duration 30",
    )
    parser.add_argument("scenario", type=Path, metavar="SCENARIO", help="YAML file")
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", required=True)
    parser.add_argument("--seed", type=int, metavar="N", help="instead of the scenario's")
    parser.add_argument(
        "--joint-order",
        metavar="ORDER",
        choices=JOINT_ORDERS,
        help="fly a gimbal whose joints follow each other in this order from the aircraft to the "
        f"camera, instead of the scenario's: {', '.join(JOINT_ORDERS)}. The angles in the bag and "
        "joint_order in params.yaml are those of that gimbal; the camera moves as before",
    )
    parser.add_argument(
        "--barometer",
        type=float,
        metavar="HZ",
        help="fly with a barometer: write baro/pressure at this rate, instead of the scenario's",
    )
    parser.add_argument(
        "--start", type=float, default=0.0, metavar="S", help="write from this second on"
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="write so many seconds (default: to the end)"
    )
    parser.add_argument("--no-images", action="store_true", help="no video: quick")
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Fly the scenario and write it; return a summary."""
    from tirgeo_ros.tools.simulate import simulate  # noqa: PLC0415 heavy

    if args.seed is not None and args.seed < 0:
        raise UsageError("--seed must not be negative")
    if args.barometer is not None and not 0 <= args.barometer <= _MOST_HZ:
        raise UsageError(f"--barometer must be 0 to {_MOST_HZ} Hz")
    with Progress("simulating", unit="s") as bar:
        return simulate(
            args.scenario,
            args.output,
            seed=args.seed,
            joint_order=args.joint_order,
            barometer_hz=args.barometer,
            start_s=args.start,
            duration_s=args.duration,
            images=not args.no_images,
            progress=bar,
        )

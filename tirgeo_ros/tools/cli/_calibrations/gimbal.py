"""The verb ``tirgeo calibrate gimbal``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._arguments import add_verbose
from tirgeo_ros.tools.cli._board import add_board, add_pictures
from tirgeo_ros.tools.cli._lines import each_not_used, not_used
from tirgeo_ros.tools.cli._verb import Subparsers, UsageError
from tirgeo_ros.tools.presentation.progress import Progress


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "gimbal",
        help="how still a gimbal holds its camera, from a video of a fixed checkerboard",
        description="Finds the camera's roll, pitch and yaw against a fixed checkerboard in every "
        "picture of a video, while the aircraft is turned about, and their standard deviations. "
        "Roll and pitch tell the gimbal's stability; yaw follows the aircraft.",
        epilog="example:\n  tirgeo calibrate gimbal wall.mcap --board 9x6 --square 0.1 "
        "--camera camera.yaml -o attitude.csv --plot attitude.png",
    )
    add_pictures(parser)
    add_board(parser)
    parser.add_argument(
        "--camera", type=Path, metavar="YAML", help="calibration file (default: the bag's own)"
    )
    parser.add_argument(
        "--rate",
        type=float,
        default=10.0,
        metavar="HZ",
        help="pictures a second: looked at in a bag, or that files were taken at "
        "(default %(default)g)",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="CSV", help="the angles over time")
    parser.add_argument("--plot", type=Path, metavar="PNG", help="the angles as a picture")
    add_verbose(parser, describe_all, "each picture that was not used, with its reason")
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Measure the attitudes; return a summary."""
    if not args.rate > 0:
        raise UsageError("--rate must be positive")
    from tirgeo_ros.core.calibration.checkerboard.board import board_of  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.calibrate.gimbal import calibrate_gimbal  # noqa: PLC0415 heavy

    with Progress("looking for the board") as bar:
        return calibrate_gimbal(
            args.pictures,
            board_of(args.board, args.square),
            camera=args.camera,
            rate_hz=args.rate,
            output=args.output,
            plot=args.plot,
            namespace=args.namespace,
            progress=bar,
        )


def describe(result: Mapping[str, Any]) -> str:
    """Return the standard deviations as a table, and how many pictures were not used."""
    columns = {
        "std_deg": "std",
        "noise_deg": "of noise",
        "std_without_noise_deg": "without",
        "span_deg": "span",
        "mean_deg": "mean",
    }
    lines = ["deg   " + "".join(f"{name:>12}" for name in columns.values())]
    lines += [
        f"{axis:6}" + "".join(f"{result[name][axis]:12.4f}" for name in columns)
        for axis in ("pitch", "yaw", "roll")
    ]
    lines.append(
        f"{result['used']} of {result['pictures']} pictures used, over "
        f"{result['duration_s']:.1f} s; reprojection error {result['reprojection_rms_px']:.3f} px"
    )
    lines += not_used(result["refused"])
    lines += [f"written: {path}" for path in result["output"]]
    return "\n".join(lines)


def describe_all(result: Mapping[str, Any]) -> str:
    """Return the same, then each picture that was not used with its reason."""
    return f"{describe(result)}\n{each_not_used(result['refused'])}".rstrip()

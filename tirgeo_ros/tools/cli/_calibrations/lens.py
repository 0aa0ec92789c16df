"""The verb ``tirgeo calibrate lens``."""

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
        "lens",
        help="a lens from pictures of a thermal checkerboard",
        description="Finds focal lengths, principal point and distortion from pictures of a "
        "checkerboard: foil on the dark squares shows it to a thermal camera. Writes a "
        "calibration file as ROS's camera_calibration does. Pictures that would spoil the result "
        "are refused, each with its reason.",
        epilog="example:\n  tirgeo calibrate lens pictures/ --board 9x6 --square 0.1 "
        "-o camera.yaml --plot coverage.png",
    )
    add_pictures(parser)
    add_board(parser)
    parser.add_argument("-o", "--output", type=Path, metavar="YAML", required=True)
    parser.add_argument("--plot", type=Path, metavar="PNG", help="corners and errors as a picture")
    parser.add_argument(
        "--model",
        choices=("plumb_bob", "rational"),
        default="plumb_bob",
        help="k1 k2 p1 p2, or with k3 to k6 as a quotient (default %(default)s)",
    )
    parser.add_argument("--k3", action="store_true", help="estimate k3 too")
    parser.add_argument(
        "--name", default="thermal", metavar="NAME", help="camera_name of the file"
    )
    parser.add_argument(
        "--every",
        type=float,
        default=0.5,
        metavar="S",
        help="of a bag, look at the sharpest picture of so many seconds (default %(default)s)",
    )
    parser.add_argument(
        "--max-views",
        type=int,
        default=60,
        metavar="N",
        help="use the N most different views (default %(default)s)",
    )
    add_verbose(parser, describe_all, "each picture that was not used, with its reason")
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run the calibration; return its summary."""
    if not args.every > 0:
        raise UsageError("--every must be positive")
    if args.k3 and args.model == "rational":
        raise UsageError("--k3 is part of --model rational already")
    from tirgeo_ros.core.calibration.checkerboard.board import board_of  # noqa: PLC0415 heavy
    from tirgeo_ros.core.calibration.checkerboard.lens_fit import FEWEST_VIEWS, LensModel  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.calibrate.lens import calibrate_lens  # noqa: PLC0415 heavy

    if args.max_views < FEWEST_VIEWS:
        raise UsageError(f"--max-views must be {FEWEST_VIEWS} or more")
    with Progress("looking for the board") as bar:
        return calibrate_lens(
            args.pictures,
            board_of(args.board, args.square),
            args.output,
            model=LensModel(args.model, args.k3),
            every_s=args.every,
            max_views=args.max_views,
            plot=args.plot,
            camera_name=args.name,
            namespace=args.namespace,
            progress=bar,
        )


def describe(result: Mapping[str, Any]) -> str:
    """Return the parameters with their standard deviations, and how many views were not used."""
    lines = [
        f"{name:<3}{value:14.6g} +- {result['sigma'][name]:.2g}"
        for name, value in result["parameters"].items()
    ]
    lines.append(
        f"reprojection error {result['reprojection_rms_px']:.3f} px rms, "
        f"{result['reprojection_mean_px']:.3f} px mean, worst view "
        f"{result['reprojection_worst_view_px']:.3f} px"
    )
    lines.append(
        f"{result['views']} of {result['pictures']} pictures used; they cover "
        f"{100 * result['covered_share']:.0f} % of the frame, tilted up to "
        f"{result['tilt_deg']:.0f} deg"
    )
    lines += not_used(result["refused"])
    if result["views_spare"]:
        lines.append(f"not needed: {result['views_spare']} views")
    lines += [f"written: {path}" for path in result["output"]]
    return "\n".join(lines)


def describe_all(result: Mapping[str, Any]) -> str:
    """Return the same, then each picture that was not used with its reason."""
    return f"{describe(result)}\n{each_not_used(result['refused'])}".rstrip()

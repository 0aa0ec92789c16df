"""The verb ``tirgeo calibrate boresight``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._arguments import add_flight, add_parameters, add_survey
from tirgeo_ros.tools.cli._verb import Subparsers, UsageError
from tirgeo_ros.tools.presentation.progress import Progress

_NAMES = ("roll", "pitch", "yaw", "latency", "gimbal_north", "heading_offset", "ground_height")
_KNOWN = ", ".join(_NAMES)


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "boresight",
        help="the camera's mounting error and the video's latency, from a flight",
        description="Finds from surveyed points and their pixels in one flight how the camera "
        "sits on its gimbal and how late the video is. Refuses what it cannot tell apart. "
        "The file is given to --params and to the nodes after the aircraft's own.",
        epilog="example:\n  tirgeo calibrate boresight bags/sample/flight.mcap "
        "--survey bags/sample/survey.geojson \\\n    --observations bags/sample/observations.csv "
        "--params bags/sample/params.yaml -o boresight.yaml",
    )
    add_flight(parser)
    add_survey(parser)
    parser.add_argument("-o", "--output", type=Path, metavar="YAML", required=True)
    add_parameters(parser)
    parser.add_argument(
        "--estimate",
        type=_names,
        metavar="LIST",
        help=f"with commas, of {_KNOWN}; by itself the first four, and gimbal_north where the "
        "flight tells it from them",
    )
    parser.add_argument(
        "--hold", type=_names, default=[], metavar="LIST", help="of the same: as --params has them"
    )
    parser.add_argument(
        "--click-sigma",
        type=_pixels,
        default=1.0,
        metavar="PX",
        help="how well a point was hit, one standard deviation per axis (%(default)s)",
    )
    parser.add_argument("--plot", type=Path, metavar="PNG", help="residuals before and after")
    return parser


def _names(text: str) -> list[str]:
    names = [name.strip() for name in text.split(",") if name.strip()]
    for name in names:
        if name not in _NAMES:
            raise argparse.ArgumentTypeError(f"{name} is none of {_KNOWN}")
    return names


def _pixels(text: str) -> float:
    value = float(text)
    if not 0 < value < 100:
        raise argparse.ArgumentTypeError(f"{text} is not between 0 and 100 px")
    return value


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run the calibration; return its summary."""
    from tirgeo_ros.tools.calibrate.boresight import calibrate_boresight  # noqa: PLC0415 heavy

    both = sorted(set(args.estimate or ()) & set(args.hold))
    if both:
        raise UsageError(f"{', '.join(both)}: either --estimate or --hold")
    if not set(_NAMES[:5] if args.estimate is None else args.estimate) - set(args.hold):
        raise UsageError("nothing to estimate")
    with Progress("calibrating", unit="s") as bar:
        return calibrate_boresight(
            args.bag,
            args.survey,
            args.observations,
            args.output,
            params=args.params,
            camera=args.camera,
            estimate=args.estimate,
            hold=args.hold,
            namespace=args.namespace,
            click_sigma_px=args.click_sigma,
            plot=args.plot,
            progress=bar,
        )


def describe(result: dict[str, Any]) -> str:
    """Return the estimates as a table, and how well they fit."""
    from tirgeo_ros.tools.calibrate.estimates import closing_lines, table  # noqa: PLC0415 heavy

    lines = table(result["parameters"])
    pixels, ground = result["residual_rms_px"], result["ground_rmse_m"]
    lines.append(
        f"residuals: {pixels['before']:.2f} px before, {pixels['after']:.2f} px after (rms)"
    )
    lines.append(
        f"on the ground: {ground['before']:.3f} m before, {ground['after']:.3f} m after, "
        f"{ground['leave_one_point_out']:.3f} m each point by the others alone (rmse)"
    )
    lines.append(
        f"{result['observations']} observations of {result['points']} points in "
        f"{result['pictures']} pictures, composition {result['composition']}"
    )
    return "\n".join([*lines, *closing_lines(result)])

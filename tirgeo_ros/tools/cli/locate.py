"""The verb ``tirgeo locate``."""

from __future__ import annotations

import argparse
from pathlib import Path

from tirgeo_ros.tools.cli._arguments import (
    add_flight,
    add_ground,
    add_method,
    add_parameters,
    check_ground,
)
from tirgeo_ros.tools.cli._verb import Subparsers
from tirgeo_ros.tools.presentation.progress import Progress


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "locate",
        help="pixels of a flight's pictures to ground points",
        description="Locates pixels of a recorded flight's pictures on the ground, each with its "
        "ellipse of 95 %. A pixel is given by its picture's stamp; one that cannot be located is "
        "written with its reason. Cursor-on-Target has one standard deviation for ce and le.",
        epilog="example:\n  tirgeo locate bags/sample/flight.mcap "
        "--pixels bags/sample/observations.csv -o points.geojson "
        "--params bags/sample/params.yaml --kml points.kml",
    )
    add_flight(parser)
    parser.add_argument(
        "--pixels",
        type=Path,
        metavar="CSV",
        required=True,
        help="a line id,stamp_ns,u,v, then the pixels: the picture's header stamp, column, row",
    )
    parser.add_argument(
        "-o", "--output", type=Path, metavar="GEOJSON", required=True, help="points and ellipses"
    )
    add_parameters(parser)
    add_method(parser)
    add_ground(parser)
    parser.add_argument("--kml", type=Path, metavar="KML", help="the points as KML too")
    parser.add_argument("--cot", type=Path, metavar="XML", help="and as Cursor-on-Target")
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Locate the pixels; return a summary."""
    from tirgeo_ros.tools.replay.locate import locate_pixels  # noqa: PLC0415 heavy

    check_ground(args)
    with Progress("locating", unit="s") as bar:
        return locate_pixels(
            args.bag,
            args.pixels,
            args.output,
            params=args.params,
            dem=args.dem,
            ground_height=args.ground_height,
            method=args.method,
            camera=args.camera,
            kml_out=args.kml,
            cot_out=args.cot,
            namespace=args.namespace,
            progress=bar,
        )

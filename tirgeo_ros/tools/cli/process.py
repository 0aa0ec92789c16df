"""The verb ``tirgeo process``."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._arguments import (
    add_flight,
    add_ground,
    add_method,
    add_parameters,
    add_verbose,
    check_ground,
)
from tirgeo_ros.tools.cli._lines import lines
from tirgeo_ros.tools.cli._verb import Subparsers, UsageError
from tirgeo_ros.tools.presentation.progress import Progress


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "process",
        help="geo-register a recorded flight",
        description="Runs filter, gimbal composition and overlay over a bag, faster than real "
        "time, and writes every output topic of the nodes to a new bag. The same input gives the "
        "same bytes. A damaged bag is processed as far as it can be read (exit code 1).",
        epilog="example:\n  tirgeo process bags/sample/flight.mcap -o out.mcap "
        "--params bags/sample/params.yaml --map bags/sample/map.geojson --video out.mp4",
    )
    add_flight(parser)
    parser.add_argument("-o", "--output", type=Path, metavar="OUT.mcap", required=True)
    add_parameters(parser)
    add_method(parser)
    add_ground(parser)
    parser.add_argument("--map", type=Path, metavar="MAP", help="the map; without it no overlay")
    parser.add_argument("--no-images", action="store_true", help="poses only, no overlay")
    parser.add_argument("--raw-images", action="store_true", help="write the overlay raw as well")
    video = "the overlay as a video, H.264 (.mp4) or VP9 (.webm)"
    parser.add_argument("--video", type=Path, metavar="OUT.mp4", help=video)
    add_verbose(parser, describe_all, "after the six lines a line for each key of the result")
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Process the bag; return a summary."""
    from tirgeo_ros.tools.replay.process import process  # noqa: PLC0415 heavy

    if args.no_images and (args.video or args.raw_images):
        raise UsageError("--no-images goes with neither --video nor --raw-images")
    check_ground(args)
    with Progress("processing", unit="s") as bar:
        return process(
            args.bag,
            args.output,
            params=args.params,
            map=args.map,
            method=args.method,
            camera=args.camera,
            dem=args.dem,
            ground_height=args.ground_height,
            images=not args.no_images,
            raw_images=args.raw_images,
            video=args.video,
            namespace=args.namespace,
            progress=bar,
        )


def describe(result: Mapping[str, Any]) -> str:
    """Return the six lines for a person."""
    from tirgeo_ros.tools.replay.process_summary import six_lines  # noqa: PLC0415 heavy

    return six_lines(result)


def describe_all(result: Mapping[str, Any]) -> str:
    """Return the six lines, then a line for each key."""
    return f"{describe(result)}\n\n{lines(result)}"

r"""Geo-register a recorded flight.

Runs filter, gimbal composition and overlay over a bag, faster than real time, and writes every
output topic of the nodes to a new bag. The same input gives the same bytes. A damaged bag is
processed as far as it can be read (exit code 1).

example:
  tirgeo process bags/sample/flight.mcap -o out.mcap --params bags/sample/params.yaml \
    --map bags/sample/map.geojson --video out.mp4
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import Any

from tirgeo_ros.tools.cli._lines import lines
from tirgeo_ros.tools.cli._verb import (
    FLIGHT,
    GROUND,
    METHOD,
    NEEDED,
    PARAMETERS,
    SMOOTH,
    UsageError,
    call,
)

OPTIONS = (
    *FLIGHT,
    ("-o --output", "OUT.mcap", "the new bag", NEEDED),
    *PARAMETERS,
    *METHOD,
    *SMOOTH,
    *GROUND,
    ("--map", "MAP", "the map; without it no overlay"),
    ("--no-images", None, "poses only, no overlay"),
    ("--raw-images", None, "write the overlay raw as well"),
    (
        "--video",
        "OUT.mp4",
        "the overlay as a video: .mp4 (H.264), .webm (VP9), or .ts (H.264 with KLV metadata)",
    ),
)
VERBOSE = "after the summary, a line for each key of the result"


def run(args: argparse.Namespace) -> dict[str, object]:
    """Process the bag; return a summary."""
    from tirgeo_ros.tools.replay.process import process  # noqa: PLC0415 heavy

    if args.no_images and (args.video or args.raw_images):
        raise UsageError("--no-images excludes --video and --raw-images")
    names = "params map method camera dem ground_height raw_images video namespace smooth"
    images = not args.no_images
    return call(process, args, "processing, s", "bag output", names, images=images)


def describe(result: Mapping[str, Any]) -> str:
    """Return the six lines for a person."""
    from tirgeo_ros.tools.replay.process_summary import six_lines  # noqa: PLC0415 heavy

    return six_lines(result)


def describe_all(result: Mapping[str, Any]) -> str:
    """Return the six lines, then a line for each key."""
    return f"{describe(result)}\n\n{lines(result)}"

# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
r"""Geo-register a recorded flight, or many.

Runs filter, gimbal composition and overlay over a bag, faster than real time, and writes every
output topic of the nodes to a new bag. The same input gives the same bytes. A damaged bag is
processed as far as it can be read (exit code 1).

A folder of stills, an MP4 with its SRT and a MISB stream are imported first. Stills with a folder
as output are drawn into it, each full size with its own EXIF and XMP, with their contact page
index.html and a bag.

Several flights, or one with a folder as output, are processed into the folder: it gets NAME.mcap
and NAME.json of each flight and the page index.html. Each flight has a process of its own; flights
that an earlier run has processed from the same files with the same options are kept. If a flight
fails, the others go on (exit code 1). With --scheduler the workers of a Dask cluster process the
flights; flights, files and DIR must be on a file system that all share, under the same names.

example:
  tirgeo process bags/sample/flight.mcap -o out.mcap --params bags/sample/params.yaml \
    --map bags/sample/map.geojson --video out.mp4
  tirgeo process flights/* -o season/ --params aircraft.yaml --map park.geojson --video
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._verb import (
    ANY_FLIGHT,
    FLIGHT,
    NEEDED,
    REGISTRATION,
    WORD,
    UsageError,
    call,
    log_options,
)

_OUTPUT = "the new bag; the folder for several flights (or with an existing one or DIR/) or stills"
_VIDEO = (
    "the overlay as a video: .mp4 (H.264), or .ts (H.264 with KLV metadata); for "
    "several flights only the ending, or nothing for .mp4"
)
_WORKERS = "for several flights: processes at a time; default: the number of cores"
_SCHEDULER = "for several flights: use the Dask cluster of this scheduler, as tcp://HOST:8786"
OPTIONS = (
    *FLIGHT,
    ("bag", "FLIGHT", f"the recorded flights: {ANY_FLIGHT}", {"nargs": "+"}),
    ("-o --output", "OUT", _OUTPUT, WORD | NEEDED),
    *REGISTRATION,
    ("--map", "MAP", "the map to draw; without it there is no overlay"),
    ("--no-images", None, "compute only poses, no overlay"),
    ("--raw-images", None, "write the overlay also as raw images"),
    ("--video", "OUT.mp4", _VIDEO, {"nargs": "?", "const": Path()}),
    ("--workers", "N", _WORKERS, {"type": int}),
    ("--scheduler", "ADDRESS", _SCHEDULER, WORD),
)
_NAMES = "params map method camera dem ground_height raw_images namespace smooth adjust"
_ENDINGS = (".mp4", ".ts")


def run(args: argparse.Namespace) -> dict[str, object]:
    """Process the flight or the flights; return a summary."""
    if args.no_images and (args.video or args.raw_images):
        raise UsageError("--no-images cannot be used with --video or --raw-images")
    from tirgeo_ros.io.logs.forms import STILLS  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.direct_input import direct_form  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.replay.process import process  # noqa: PLC0415 heavy

    output, one = Path(args.output), args.bag[0]
    to_folder = args.output.endswith("/") or output.is_dir()
    draws_stills = len(args.bag) == 1 and (to_folder or not output.suffix)
    draws_stills = draws_stills and direct_form(one) is STILLS
    if not draws_stills and (len(args.bag) > 1 or to_folder):
        return _many_flights(args)
    if args.workers is not None or args.scheduler is not None:
        raise UsageError("--workers and --scheduler are for several flights: give -o DIR/")
    if args.video == Path():
        raise UsageError("--video needs a name, as OUT.mp4")
    files = {"bag_in": one, "bag_out": output}
    if draws_stills:
        files |= {"bag_out": output / f"{one.resolve().name}.mcap", "stills": output}
    return call(process, args, "processing, s", **files, images=not args.no_images)


def _many_flights(args: argparse.Namespace) -> dict[str, object]:
    """Process flights into a folder."""
    from tirgeo_ros.tools.many_flights.many_flights import process_flights  # noqa: PLC0415 heavy

    if args.workers is not None and (args.workers < 1 or args.scheduler):
        raise UsageError("--workers must be 1 or more, and cannot be used with --scheduler")
    if Path(args.output).suffix == ".mcap" and not Path(args.output).is_dir():
        raise UsageError(f"several flights need a folder, not {args.output}: give -o DIR")
    options = {name: getattr(args, name) for name in _NAMES.split()}
    options |= {"images": not args.no_images, "video": _ending(args.video)}
    logs = asdict(log_options(args))
    options |= {"logs": logs} if any(logs.values()) else {}
    places = {"flights": args.bag, "folder": args.output}
    return call(process_flights, args, "processing, flights", **places, **options)


def _ending(video: Path | None) -> str:
    """Return the ending of all flights' videos, "" for none."""
    if video is None:
        return ""
    if video == Path():
        return _ENDINGS[0]
    if str(video) not in _ENDINGS:
        listed = ", ".join(_ENDINGS)
        raise UsageError(f"--video {video}: give one of {listed} for several flights")
    return str(video)


def describe(result: Mapping[str, Any]) -> str:
    """Return the result in a few lines for a person."""
    if "flights" in result:
        from tirgeo_ros.tools.many_flights.many_flights import summary_lines  # noqa: PLC0415 heavy

        return summary_lines(result)
    from tirgeo_ros.tools.replay.process import six_lines  # noqa: PLC0415 heavy

    return six_lines(result)

r"""Locate pixels of a flight's pictures on the ground, or convert targets.

Each point comes with its ellipse of 95 %. A pixel is given by its picture's stamp; one that cannot
be located is written with its reason. ce and le of Cursor-on-Target are CE90 and LE90.
Without --pixels, IN is a file of targets (.gpkg or .geojson, of tirgeo) that is written in
another format.

example:
  tirgeo locate bags/sample/flight.mcap --pixels bags/sample/observations.csv -o points.geojson \
    --params bags/sample/params.yaml --kml points.kml
  tirgeo locate targets.gpkg -o targets.gpx
"""

from __future__ import annotations

import argparse

from tirgeo_ros.tools.cli._verb import (
    ANY_BAG,
    GROUND,
    METHOD,
    NEEDED,
    PARAMETERS,
    SMOOTH,
    UsageError,
    call,
)

_PIXELS = "a line id,stamp_ns,u,v, then the pixels: the picture's header stamp, column, row"
_OUTPUT = "points and ellipses; by its ending .geojson, .kml, .gpx, .csv or .gpkg"
OPTIONS = (
    ("bag", "IN", f"the recorded flight: {ANY_BAG}; or targets"),
    ("--pixels", "CSV", _PIXELS),
    ("-o --output", "OUT", _OUTPUT, NEEDED),
    *PARAMETERS,
    *METHOD,
    *SMOOTH,
    *GROUND,
    ("--kml", "KML", "the points as KML too"),
    ("--cot", "XML", "and as Cursor-on-Target"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Locate the pixels, or convert the targets; return a summary."""
    if args.pixels is None:
        return _converted(args)
    from tirgeo_ros.tools.replay.locate import locate_pixels  # noqa: PLC0415 heavy

    places = {"kml_out": args.kml, "cot_out": args.cot}
    names = "params dem ground_height method camera namespace smooth"
    return call(locate_pixels, args, "locating, s", "bag pixels output", names, **places)


def _converted(args: argparse.Namespace) -> dict[str, object]:
    from tirgeo_ros.tools.replay.locate import convert_targets  # noqa: PLC0415 heavy

    if args.cot:
        raise UsageError("--cot needs --pixels; the operator's page sends targets to the team")
    return convert_targets(args.bag, args.output, args.kml)

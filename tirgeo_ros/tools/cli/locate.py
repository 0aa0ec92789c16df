r"""Locate pixels of a flight's pictures on the ground.

Each point comes with its ellipse of 95 %. A pixel is given by its picture's stamp; one that cannot
be located is written with its reason. Cursor-on-Target has one standard deviation for ce and le.

example:
  tirgeo locate bags/sample/flight.mcap --pixels bags/sample/observations.csv -o points.geojson \
    --params bags/sample/params.yaml --kml points.kml
"""

from __future__ import annotations

import argparse

from tirgeo_ros.tools.cli._verb import FLIGHT, GROUND, METHOD, NEEDED, PARAMETERS, call

_PIXELS = "a line id,stamp_ns,u,v, then the pixels: the picture's header stamp, column, row"
OPTIONS = (
    *FLIGHT,
    ("--pixels", "CSV", _PIXELS, NEEDED),
    ("-o --output", "GEOJSON", "points and ellipses", NEEDED),
    *PARAMETERS,
    *METHOD,
    *GROUND,
    ("--kml", "KML", "the points as KML too"),
    ("--cot", "XML", "and as Cursor-on-Target"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Locate the pixels; return a summary."""
    from tirgeo_ros.tools.replay.locate import locate_pixels  # noqa: PLC0415 heavy

    places = {"kml_out": args.kml, "cot_out": args.cot}
    names = "params dem ground_height method camera namespace"
    return call(locate_pixels, args, "locating, s", "bag pixels output", names, **places)

"""Simulate a flight, with truth.

Writes flight.mcap (what the aircraft recorded, with thermal video), truth.mcap, map.geojson,
survey.geojson, targets.geojson (the warm things in it), observations.csv and params.yaml. The same
seed gives the same bytes.

example:
  tirgeo simulate config/scenarios/paper_flight.yaml -o flight --start 30 --duration 30
"""

from __future__ import annotations

import argparse

from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS
from tirgeo_ros.tools.cli._verb import NEEDED, NUMBER, UsageError, call

_ORDER_HELP = (
    "simulate a gimbal with this order of joints, from the aircraft to the camera, "
    f"instead of the scenario's: {', '.join(JOINT_ORDERS)}. The angles in the bag and joint_order "
    "in params.yaml are those of that gimbal; the camera moves as before"
)
_BAROMETER_HELP = "simulate a barometer: baro/pressure at this rate, instead of the scenario's"
_MOST_HZ = 50  # as in the scenario
OPTIONS = (
    ("scenario", "SCENARIO", "YAML file"),
    ("-o --output", "DIR", "for the files", NEEDED),
    ("--seed", "N", "instead of the scenario's", {"type": int}),
    ("--joint-order", "ORDER", _ORDER_HELP, {"choices": JOINT_ORDERS}),
    ("--barometer", "HZ", _BAROMETER_HELP, NUMBER),
    ("--start", "S", "write from this second on", NUMBER | {"default": 0.0}),
    ("--duration", "S", "seconds to write; default: to the end", NUMBER),
    ("--no-images", None, "no video: quick"),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Fly the scenario and write it; return a summary."""
    from tirgeo_ros.tools.simulate import simulate  # noqa: PLC0415 heavy

    if args.seed is not None and args.seed < 0:
        raise UsageError("--seed must not be negative")
    if args.barometer is not None and not 0 <= args.barometer <= _MOST_HZ:
        raise UsageError(f"--barometer must be 0 to {_MOST_HZ} Hz")
    part = {
        "barometer_hz": args.barometer,
        "start_s": args.start,
        "duration_s": args.duration,
        "images": not args.no_images,
    }
    return call(simulate, args, "simulating, s", "scenario output", "seed joint_order", **part)

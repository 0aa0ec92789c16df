"""The verb ``tirgeo calibrate``, with a verb of its own for each thing that is calibrated."""

from __future__ import annotations

import argparse
import importlib
import pkgutil

from tirgeo_ros.tools.cli import _calibrations
from tirgeo_ros.tools.cli._verb import Subparsers, complete


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verbs and their arguments."""
    parser = subparsers.add_parser(
        "calibrate",
        help="find parameters from recordings: lens, boresight, IMU noise, ...",
        description="Finds parameters from recordings. What boresight, aircraft, allan and imu "
        "write, the nodes and --params take after the aircraft's own file; what lens writes, "
        "--camera and overlay_node's parameter camera take.",
        epilog="tirgeo calibrate WHAT --help tells of one, with an example.",
    )
    inner = parser.add_subparsers(dest="what", metavar="WHAT", required=True)
    for found in pkgutil.iter_modules(_calibrations.__path__):
        module = importlib.import_module(f"{_calibrations.__name__}.{found.name}")
        complete(module.add_parser(inner), module)
    return parser

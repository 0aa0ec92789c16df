"""Define arguments that several verbs share."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._verb import UsageError

METHODS = ("raw", "rtk", "ekf", "ekf_heading")


def add_flight(parser: argparse.ArgumentParser) -> None:
    """Add the argument of the recorded flight."""
    parser.add_argument("bag", type=Path, metavar="IN.mcap", help="the recorded flight")


def add_survey(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of surveyed points and their observations."""
    parser.add_argument(
        "--survey", type=Path, metavar="GCPS", required=True, help="GeoJSON, or CSV id,lat,lon,h"
    )
    parser.add_argument(
        "--observations",
        type=Path,
        metavar="CSV",
        required=True,
        help="id,stamp_ns,u,v: the picture's header stamp, column, row",
    )


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of parameter files, calibration and namespace."""
    parser.add_argument(
        "--params",
        action="append",
        type=Path,
        metavar="YAML",
        help="ROS 2 parameter file; may be repeated: a later one stands before an earlier",
    )
    parser.add_argument(
        "--camera",
        type=Path,
        metavar="YAML",
        help="its calibration, in place of the bag's thermal/camera_info",
    )
    parser.add_argument("--namespace", default="", metavar="NS", help="of the bag's topics")


def add_method(parser: argparse.ArgumentParser) -> None:
    """Add the argument of the method that computes the aircraft's pose."""
    parser.add_argument(
        "--method",
        metavar="M",
        choices=METHODS,
        help="%(choices)s; default: as --params say, else ekf_heading where the bag has "
        "rtk/heading and ekf where it has none",
    )


def add_ground(parser: argparse.ArgumentParser, otherwise: str = "") -> None:
    """Add the arguments of the ground.

    ``otherwise`` says in the help what is used without them.
    """
    parser.add_argument(
        "--dem", metavar="TIF", help="elevation model of the ground; tiles of one with commas"
    )
    default = f"; default: {otherwise}" if otherwise else ""
    parser.add_argument(
        "--ground-height",
        type=float,
        metavar="M",
        help=f"ellipsoidal height of the ground, m{default}",
    )


def check_ground(args: argparse.Namespace) -> None:
    """Raise UsageError if two grounds are given."""
    if args.dem is not None and args.ground_height is not None:
        raise UsageError("--dem and --ground-height are two grounds: give one")


def add_window(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the part of a record that is measured."""
    parser.add_argument(
        "--from", dest="from_s", type=float, default=0.0, metavar="S", help="since the first"
    )
    parser.add_argument(
        "--to", dest="to_s", type=float, default=math.inf, metavar="S", help="message, s"
    )


def add_verbose(
    parser: argparse.ArgumentParser,
    describe_all: Callable[[Any], str],
    help: str,  # noqa: A002
) -> None:
    """Add ``-v``, which prints ``describe_all(result)`` instead of the short lines."""
    parser.add_argument(
        "-v",
        "--verbose",
        dest="describe",
        action="store_const",
        const=describe_all,
        help=f"{help} (--json has it too)",
    )


def check_window(args: argparse.Namespace) -> None:
    """Raise UsageError for a part that ends before it begins."""
    if not 0 <= args.from_s < args.to_s:
        raise UsageError("--from must be 0 or more, and less than --to")

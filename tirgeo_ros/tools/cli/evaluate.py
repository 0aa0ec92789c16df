"""The verb ``tirgeo evaluate``."""

from __future__ import annotations

import argparse
from pathlib import Path

from tirgeo_ros.tools.cli._arguments import (
    add_flight,
    add_ground,
    add_parameters,
    add_survey,
    check_ground,
)
from tirgeo_ros.tools.cli._verb import Subparsers
from tirgeo_ros.tools.presentation.progress import Progress


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "evaluate",
        help="a flight's ground accuracy against surveyed points, by method",
        description="The paper's experiment: locates every observed control point under the "
        "methods raw, rtk, ekf and ekf_heading, and calibrated (ekf_heading with the boresight "
        "file) where one is given. Prints each point's error, their means and the paired t-test "
        "between the methods, and writes report.html with plots and stills, points.csv, "
        "observations.csv, result.json and each method's parameters. A method that the bag has "
        "not the topics for is told as missing.",
        epilog="example:\n  tirgeo evaluate bags/sample/flight.mcap "
        "--survey bags/sample/survey.geojson \\\n    --observations bags/sample/observations.csv "
        "--params bags/sample/params.yaml -o evaluation",
    )
    add_flight(parser)
    add_survey(parser)
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", required=True)
    add_parameters(parser)
    parser.add_argument(
        "--boresight", type=Path, metavar="YAML", help="what calibrate boresight has written"
    )
    parser.add_argument(
        "--map", type=Path, metavar="MAP", help="drawn on the stills; default: the parameters'"
    )
    add_ground(parser, "the parameters', else the median of the observed points' heights")
    parser.add_argument(
        "--projection",
        choices=("gauss-krueger", "utm"),
        default="gauss-krueger",
        help="%(choices)s; default: %(default)s",
    )
    parser.add_argument(
        "--truth",
        type=Path,
        metavar="BAG",
        help="truth.mcap of a simulated flight: the aircraft's own errors are told too",
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Evaluate the flight and write the results; return a summary."""
    from tirgeo_ros.io.maps import map_files  # noqa: PLC0415 heavy
    from tirgeo_ros.io.parameters.parameter_file import paths_of  # noqa: PLC0415
    from tirgeo_ros.tools.evaluate.evaluate import evaluate  # noqa: PLC0415
    from tirgeo_ros.tools.evaluate.report import report_html  # noqa: PLC0415
    from tirgeo_ros.tools.evaluate.summary import (  # noqa: PLC0415
        check_folder,
        summary,
        write_evaluation,
    )
    from tirgeo_ros.tools.replay.node_configs import node_configs  # noqa: PLC0415

    check_ground(args)
    given = [*(args.params or ()), args.boresight] if args.boresight else args.params
    configs = node_configs(given, args.namespace, dem=args.dem, camera=args.camera)
    read = (args.bag, args.survey, args.observations, args.truth, *paths_of(given))
    check_folder(args.output, (*read, *configs.files, *map_files(str(args.map or ""))))
    with Progress("evaluating", unit="s") as bar:
        found = evaluate(
            args.bag,
            args.survey,
            args.observations,
            params=args.params,
            boresight=args.boresight,
            camera=args.camera,
            dem=args.dem,
            ground_height=args.ground_height,
            namespace=args.namespace,
            projection=args.projection,
            truth=args.truth,
            map_path=args.map,
            progress=bar,
        )
    page = {"report.html": report_html(found)}
    return summary(found) | {"output": write_evaluation(found, args.output, page)}


def describe(result: dict[str, object]) -> str:
    """Return the tables for a person."""
    from tirgeo_ros.tools.evaluate.tables import text_tables  # noqa: PLC0415

    return text_tables(result)

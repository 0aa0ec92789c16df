"""The verb ``tirgeo demo``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from tirgeo_ros.tools.cli._verb import Subparsers, UsageError
from tirgeo_ros.tools.presentation.progress import Progress, three


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "demo",
        help="run the whole node graph on the sample flight",
        description="Starts every node as a process of its own, over DDS in a domain of its own, "
        "plays a bag through them in real time and leaves overlay.mp4, still.png, summary.json, "
        "the recording and the logs. Needs ROS 2 Jazzy or its wheels.",
        epilog="example:\n  tirgeo demo -o demo",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="DIR", default=Path("demo"))
    parser.add_argument("--bag", type=Path, metavar="IN.mcap", help="another flight")
    parser.add_argument("--rate", type=float, metavar="X", default=1.0, help="times real time")
    parser.add_argument("--params", type=Path, metavar="YAML", help="default: beside the bag")
    parser.add_argument("--map", type=Path, metavar="MAP", help="default: beside the bag")
    parser.add_argument(
        "--method", metavar="M", choices=("raw", "rtk", "ekf", "ekf_heading"), help="%(choices)s"
    )
    parser.add_argument(
        "--serial",
        action="store_true",
        help="the aircraft speaks DJI's serial protocol to dji_node, on a pseudo-terminal",
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Run the graph; return the summary."""
    from tirgeo_ros.tools.graph.demo import check_place_of, demonstrate, sample_bag, with_sample  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.graph.node_graph import GraphSetup, free_domain  # noqa: PLC0415 heavy

    if not 0.01 <= args.rate <= 100:
        raise UsageError("--rate must be from 0.01 to 100")
    if args.serial and args.rate != 1:
        raise UsageError("--serial runs in real time: leave --rate out")
    bag = args.bag or sample_bag()
    given = (args.params, args.map, args.method, args.rate, args.serial)
    domain = {"ROS_DOMAIN_ID": str(free_domain())}
    graph = GraphSetup(bag.absolute(), args.output.absolute(), *given, environment=domain)
    setup = with_sample(graph)
    check_place_of(setup)
    sys.stderr.write(f"the nodes are in ROS_DOMAIN_ID={domain['ROS_DOMAIN_ID']}, here alone\n")
    with Progress("playing", unit="s") as bar:
        return demonstrate(setup, bar)


def describe(result: dict[str, object]) -> str:
    """Return the summary for a person; it ends with the files to look at."""
    folder = Path(str(result["video"])).parent
    cores = _number(_table(result["cores"]).get("total"))
    frames = f"{result['frames_in']} frames in, {result['frames_out']} out"
    heading = f"heading to {_number(result['heading_sigma_deg'])} deg"
    lines = [
        f"{frames}, {_number(result['frame_latency_ms'])} ms later; {cores} cores",
        f"{result['state']} by {result['method']}, {heading}{_against_truth(result)}",
        *_found(result),
        f"all numbers: {folder / 'summary.json'}",
        "",
        f"look at  {result['video']}",
        f"    and  {result['still']}",
        _seen(result),
    ]
    return "\n".join(lines)


def _seen(result: dict[str, object]) -> str:
    """Return what is to be seen there."""
    drawn = _table(result["overlay"]).get("drawn", 0)
    if not drawn:
        return "no frame has the map: the reason is in each of them"
    return (
        "There the map lies on what the camera sees: its lines on the edges of paths and beds, in "
        f"{drawn} frames from {_number(result['first_map_after_s'])} s on."
    )


def _against_truth(result: dict[str, object]) -> str:
    """Return how far the camera poses are off; empty without a truth."""
    truth = _table(result["camera_against_truth"])
    if not truth:
        return ""
    metres, degrees = (_number(truth[name]) for name in ("position_rms_m", "attitude_rms_deg"))
    return f"; the camera is {metres} m and {degrees} deg off (rms)"


def _table(value: object) -> dict[str, object]:
    return value if isinstance(value, dict) else {}


def _found(result: dict[str, object]) -> list[str]:
    """Return a line for each located click."""
    found = result.get("found")
    return [
        "{target}: {latitude_deg:.6f}, {longitude_deg:.6f}, {off_m:.1f} m from where it is "
        "(ellipse of 95 % {ellipse_95_m:.1f} m)".format(**one)
        for one in (found if isinstance(found, list) else [])
    ]


def _number(value: object) -> str:
    return three(value) if isinstance(value, float) else str(value)

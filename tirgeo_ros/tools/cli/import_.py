"""The verb ``tirgeo import``."""

from __future__ import annotations

import argparse
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from tirgeo_ros.tools.cli._verb import Subparsers, UsageError
from tirgeo_ros.tools.presentation.progress import Progress


def add_parser(subparsers: Subparsers) -> argparse.ArgumentParser:
    """Declare the verb's arguments."""
    parser = subparsers.add_parser(
        "import",
        help="make a bag of a ROS 1 bag or a serial capture",
        description="Makes a bag with the topics of tirgeo (imu/data, gps, rtk, gimbal, thermal) "
        "of a ROS 1 bag that DJI's wrapper was recorded in (dji_sdk/ or dji_osdk_ros/), or of the "
        "bytes that an aircraft's serial port sent. Topics of the wrong type and values that make "
        "no sense are told and left out. A damaged bag is imported as far as it can be read (exit "
        "code 1). The same input gives the same bytes.",
        epilog="example:\n  tirgeo import flight.bag -o flight.mcap --params params.yaml\n\n"
        "params.yaml needs at least\n"
        "  /**:\n"
        "    ros__parameters:\n"
        "      geoid_undulation_m: 43.2                      # where it flies\n"
        "      aircraft.rtk_antenna_m: [0.0, 0.55, 0.35]     # forward, left, up\n"
        "      aircraft.second_antenna_m: [0.0, -0.55, 0.35]",
    )
    parser.add_argument("flight", type=Path, metavar="IN", help="ROS 1 bag or serial capture")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT.mcap", required=True)
    parser.add_argument("--params", type=Path, metavar="YAML", help="parameters of dji_node")
    parser.add_argument(
        "--namespace", default="", metavar="NS", help="of the bag's topics and of the new ones"
    )
    bags = parser.add_argument_group("of ROS 1 bags")
    bags.add_argument(
        "--image-topic", default="", metavar="TOPIC", help="goes to thermal/image_raw[/compressed]"
    )
    bags.add_argument(
        "--camera-info-topic", default="", metavar="TOPIC", help="goes to thermal/camera_info"
    )
    captures = parser.add_argument_group("of captures")
    captures.add_argument(
        "--packages", type=Path, metavar="YAML", help="what the subscription packages hold"
    )
    captures.add_argument(
        "--key", default="", metavar="HEX", help="application key, for encrypted frames"
    )
    captures.add_argument(
        "--start-time",
        metavar="TIME",
        help="UTC of the first message, as 2024-06-11T07:44:39; default: by its receivers' date",
    )
    return parser


def run(args: argparse.Namespace) -> dict[str, object]:
    """Import the flight; return what was read and written."""
    from tirgeo_ros.tools.convert.import_capture import CaptureOptions  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_flight import import_flight  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_ros1 import Pictures  # noqa: PLC0415 heavy

    start_ns = None if args.start_time is None else _utc_ns(args.start_time)
    with Progress("importing") as bar:
        return import_flight(
            args.flight,
            args.output,
            params=args.params,
            namespace=args.namespace,
            pictures=Pictures(args.image_topic, args.camera_info_topic),
            capture=CaptureOptions(str(args.packages or ""), args.key, start_ns),
            progress=bar,
        )


def _utc_ns(text: str) -> int:
    """Return an ISO time in ns of Unix time; without a zone it is UTC. Raise UsageError."""
    try:
        time = datetime.fromisoformat(text.removesuffix("Z"))
        if time.tzinfo is None:
            time = time.replace(tzinfo=timezone.utc)
        return round(time.timestamp() * 1e6) * 1000
    except (ValueError, OverflowError):
        raise UsageError(f"--start-time {text}: not a time as 2024-06-11T07:44:39") from None


def describe(result: dict[str, Any]) -> str:
    """Return the tables of inputs and outputs."""
    parts = [_came_in(result), _went_out(result["written"])]
    if result["counts"]:
        parts.append("\n".join(f"{name:<32}{number}" for name, number in result["counts"].items()))
    parts += ["\n".join(result["notes"])] if result.get("notes") else []
    pictures = [t for t, kind in result.get("not_read", {}).items() if "Image" in kind]
    if pictures:
        parts.append(f"pictures in the bag that --image-topic may name: {', '.join(pictures)}")
    return "\n\n".join(parts)


def _came_in(result: dict[str, Any]) -> str:
    if result["kind"] == "capture":
        frames = [(f"frames {name}", str(number)) for name, number in result["frames"].items()]
        frames += [(name, str(number)) for name, number in result["telemetry"].items()]
        return "\n".join(
            f"{name:<32}{number}" for name, number in [*frames, ("time", result["time"])]
        )
    rows = [("topic in", "messages", "refused", "to")]
    rows += [
        (row["topic"], str(row["messages"]), str(row["refused"]), ", ".join(row["to"]))
        for row in result["topics"]
    ]
    return _table(rows)


def _went_out(written: dict[str, Any]) -> str:
    rows = [("topic out", "messages", "from (UTC)", "seconds")]
    for topic, seen in written.items():
        begun = datetime.fromtimestamp(seen["first_ns"] // 10**9, timezone.utc)
        lasts_s = (seen["last_ns"] - seen["first_ns"]) * 1e-9
        rows.append((topic, str(seen["messages"]), f"{begun:%Y-%m-%d %H:%M:%S}", f"{lasts_s:.1f}"))
    return _table(rows)


def _table(rows: list[tuple[str, str, str, str]]) -> str:
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return "\n".join(
        "  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    )

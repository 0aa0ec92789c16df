"""Make a bag from a ROS 1 bag or a serial capture.

Makes a bag with the topics of tirgeo (imu/data, gps, rtk, gimbal, thermal) from a ROS 1 bag with
the topics of DJI's wrapper (dji_sdk/ or dji_osdk_ros/), or from the bytes of an aircraft's serial
port. Topics of the wrong type and implausible values are reported and left out. A bag that
was cut off or never closed is refused; rosbag reindex mends it. The same input gives the same
bytes. --namespace and the topics are for ROS 1 bags; --packages, --key and --start-time for
captures.

example:
  tirgeo import flight.bag -o flight.mcap --params params.yaml

params.yaml needs at least
  /**:
    ros__parameters:
      geoid_undulation_m: 43.2                      # where it flies
      aircraft.rtk_antenna_m: [0.0, 0.55, 0.35]     # forward, left, up
      aircraft.second_antenna_m: [0.0, -0.55, 0.35]
"""

from __future__ import annotations

import argparse
from datetime import datetime, timezone
from typing import Any

from tirgeo_ros.tools.cli._lines import table
from tirgeo_ros.tools.cli._verb import NEEDED, NUMBER, WORD, UsageError, call
from tirgeo_ros.tools.cli.dump import CAPTURE

_TIME = "UTC of the first message, as 2024-06-11T07:44:39; default: the receivers' date"
_NAMESPACE = "namespace of the aircraft's topics in a ROS 1 bag, and in the new bag; default: none"
_MAP = "topic of a bag, and the topic of tirgeo that it becomes; may be repeated"
_RPY = "with --map-topic: rotation of the IMU's axes relative to base_link, deg"
_TOPIC = WORD | {"default": ""}
OPTIONS = (
    ("flight", "IN", "ROS 1 bag, serial capture, or any bag with --map-topic"),
    ("-o --output", "OUT.mcap", "the new bag", NEEDED),
    ("--params", "YAML", "parameters of dji_node"),
    ("--namespace", "NS", _NAMESPACE, _TOPIC),
    ("--image-topic", "TOPIC", "topic that becomes thermal/image_raw[/compressed]", _TOPIC),
    ("--camera-info-topic", "TOPIC", "topic that becomes thermal/camera_info", _TOPIC),
    ("--map-topic", "FROM=TO", _MAP, WORD | {"action": "append", "default": []}),
    ("--imu-rpy", ("R", "P", "Y"), _RPY, NUMBER | {"nargs": 3, "default": (0.0, 0.0, 0.0)}),
    *CAPTURE,
    ("--start-time", "TIME", _TIME, WORD),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Import the flight; return what was read and written."""
    from tirgeo_ros.tools.convert.import_capture import CaptureOptions  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_flight import import_flight  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_mapped import MappedTopics  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_ros1 import Pictures  # noqa: PLC0415 heavy

    args.mapped = MappedTopics(tuple(map(_pair, args.map_topic)), tuple(args.imu_rpy))
    if args.mapped.pairs and (args.image_topic or args.camera_info_topic):
        raise UsageError(
            "--image-topic is for DJI's bags: use --map-topic TOPIC=thermal/image_raw"
        )
    start_ns = None if args.start_time is None else _utc_ns(args.start_time)
    args.pictures = Pictures(args.image_topic, args.camera_info_topic)
    args.capture = CaptureOptions(str(args.packages or ""), args.key, start_ns)
    names = "params namespace pictures capture mapped"
    return call(import_flight, args, "importing", "flight output", names)


def _pair(text: str) -> tuple[str, str]:
    """Return a topic and the topic of the contract that it becomes. Raise UsageError."""
    from tirgeo_ros.tools.convert.topic_types import MAPPABLE  # noqa: PLC0415 heavy

    topic, _, contract = text.partition("=")
    contract = contract.strip("/")
    if not topic.strip("/") or contract not in MAPPABLE:
        raise UsageError(f"--map-topic {text}: not FROM=TO, TO one of {', '.join(MAPPABLE)}")
    return topic, contract


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
        parts.append(_pairs(result["counts"]))
    parts += result.get("notes", [])
    pictures = [t for t, kind in result.get("not_read", {}).items() if "Image" in kind]
    if pictures:
        parts.append(f"pictures in the bag that --image-topic may name: {', '.join(pictures)}")
    return "\n\n".join(parts)


def _pairs(numbers: dict[str, Any]) -> str:
    return "\n".join(f"{name:<32}{number}" for name, number in numbers.items())


def _came_in(result: dict[str, Any]) -> str:
    if result["kind"] == "capture":
        frames = {f"frames {name}": number for name, number in result["frames"].items()}
        return _pairs(frames | result["telemetry"] | {"time": result["time"]})
    rows = [
        (row["topic"], str(row["messages"]), str(row["refused"]), ", ".join(row["to"]))
        for row in result["topics"]
    ]
    return table([("topic in", "messages", "refused", "to"), *rows])


def _went_out(written: dict[str, Any]) -> str:
    rows = [("topic out", "messages", "from (UTC)", "seconds")]
    for topic, seen in written.items():
        begun = datetime.fromtimestamp(seen["first_ns"] // 10**9, timezone.utc)
        lasts_s = (seen["last_ns"] - seen["first_ns"]) * 1e-9
        rows.append((topic, str(seen["messages"]), f"{begun:%Y-%m-%d %H:%M:%S}", f"{lasts_s:.1f}"))
    return table(rows)

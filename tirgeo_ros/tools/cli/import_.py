"""Make a bag from another maker's logs, a bag with other topics or a serial capture.

Makes a bag with the topics of tirgeo (imu/data, gps, rtk, gimbal, thermal) from logs, from a
ROS 1 bag with the topics of DJI's wrapper (dji_sdk/ or dji_osdk_ros/), from any bag of ROS 1 or
ROS 2 whose topics --map-topic names, or from the bytes of an aircraft's serial port. Each file is
recognised by its content. Topics of the wrong type and implausible values are reported and left
out. A ROS 1 bag that was cut off or never closed is read up to the cut, with exit code 1. The same
input gives the same bytes. --namespace and the topics are for bags; --packages and --key for
captures.

Logs: CSV (with --columns), RTKLIB .pos, u-blox UBX (NAV-PVT, NAV-RELPOSNED), PX4 ULog, ArduPilot
DataFlash, subtitles of DJI's cameras (SRT). Several of one flight are merged by their time stamps;
a topic that two of them have for the same time comes from the first. What a log does not tell is
asked for. docs/import.md and docs/import_autopilots.md tell what comes out of each.

example:
  tirgeo import flight.bag -o flight.mcap --params params.yaml

params.yaml needs at least
  /**:
    ros__parameters:
      geoid_undulation_m: 43.2                      # where it flies
      aircraft.rtk_antenna_m: [0.0, 0.55, 0.35]     # forward, left, up
      aircraft.second_antenna_m: [0.0, -0.55, 0.35]

A bag with other topics, and an autopilot's log:
  tirgeo import IN.bag -o flight.mcap --map-topic /xsens/imu=imu/data --map-topic /fix=gps/fix
  tirgeo import flight.bin -o flight.mcap --geoid-undulation 43.2

An IMU's CSV and RTKLIB's solution:
  tirgeo import --example -o imu.yaml               # then say in it what the columns mean
  tirgeo import imu.csv rover.pos --columns imu.yaml -o flight.mcap
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import suppress
from datetime import datetime, timezone
from typing import Any

from tirgeo_ros.tools.cli._verb import NUMBER, WORD, Option, UsageError, call, utc_time
from tirgeo_ros.tools.cli.dump import CAPTURE
from tirgeo_ros.tools.presentation.results import table


def offset_s(text: str) -> int:
    """Return seconds of an offset from UTC, as +02:00; a type of option."""
    from tirgeo_ros.io.logs.log_contents import zone_offset_s  # noqa: PLC0415 --help stays quick

    try:
        return zone_offset_s(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: not an offset as +02:00 or -03:30") from None


_FILES = "logs of one flight, or one bag or serial capture"
_OUTPUT = "the new bag; with --example the template (default: stdout)"
_TIME = "UTC of the first message or record, as 2024-06-11T07:44:39; default: the receivers' date"
_NAMESPACE = "namespace of the aircraft's topics in a ROS 1 bag, and in the new bag; default: none"
_MAP = "topic of a bag, and the topic of tirgeo that it becomes; may be repeated"
_RPY = "with --map-topic: rotation of the IMU's axes relative to base_link, deg"
_TOPIC = WORD | {"default": ""}
_BASELINE = (
    "between the two antennas: headings with another length are refused; default: from "
    "aircraft.rtk_antenna_m to aircraft.second_antenna_m. Without those it lies along the nose"
)
_GEOID = "height of sea level above the ellipsoid; default: geoid_undulation_m of --params"
_ROVER = "the first antenna is the rover's, the second the moving base's; default: the reverse"
_DATUM = "what heights are above where the log does not tell it: %(choices)s"
_HEADING = "of the nose 7 s after all topics have begun, from true north, clockwise"
LOGS: tuple[Option, ...] = (
    ("--columns", "YAML", "what a CSV's columns mean; one, or one for each", {"action": "append"}),
    ("--example", None, "write a template of --columns"),
    ("--geoid-undulation", "M", _GEOID, NUMBER),
    ("--takeoff-height", "M", "ellipsoidal height of the take-off, for heights above it", NUMBER),
    ("--height", "DATUM", _DATUM, {"choices": ("ellipsoidal", "msl", "takeoff"), "default": ""}),
    ("--utc-offset", "+HH:MM", "of local times without a zone, east positive", {"type": offset_s}),
    (
        "--time-scale",
        "SCALE",
        "of times where a .pos does not tell it: %(choices)s",
        {"choices": ("gpst", "utc"), "default": ""},
    ),
    ("--baseline", "M", _BASELINE, NUMBER),
    ("--rover-first", None, _ROVER),
    ("--set-heading", "DEG", _HEADING, NUMBER),
)
OPTIONS = (
    ("flight", "IN", _FILES, {"nargs": "*"}),
    ("-o --output", "OUT.mcap", _OUTPUT),
    ("--params", "YAML", "parameters of dji_node"),
    ("--namespace", "NS", _NAMESPACE, _TOPIC),
    ("--image-topic", "TOPIC", "topic that becomes thermal/image_raw[/compressed]", _TOPIC),
    ("--camera-info-topic", "TOPIC", "topic that becomes thermal/camera_info", _TOPIC),
    ("--map-topic", "FROM=TO", _MAP, WORD | {"action": "append", "default": []}),
    ("--imu-rpy", ("R", "P", "Y"), _RPY, NUMBER | {"nargs": 3}),
    *CAPTURE,
    ("--start-time", "TIME", _TIME, WORD),
    *LOGS,
)


def run(args: argparse.Namespace) -> dict[str, object] | int:
    """Import the flight; return what was read and written."""
    if args.example:
        return _write_example(args)
    if not args.flight or args.output is None:
        raise UsageError("IN and -o OUT.mcap are needed")
    from tirgeo_ros.tools.convert.import_capture import CaptureOptions  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_flight import import_flight  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_ros1 import Pictures  # noqa: PLC0415 heavy

    args.mapped = _mapped_topics(args)
    start_ns = None if args.start_time is None else _utc_ns(args.start_time)
    args.pictures = Pictures(args.image_topic, args.camera_info_topic)
    args.capture = CaptureOptions(str(args.packages or ""), args.key, start_ns)
    args.logs, args.columns = _log_options(args, start_ns), args.columns or ()
    names = "params namespace pictures capture mapped logs columns"
    return call(import_flight, args, "importing", "flight output", names)


def _mapped_topics(args: argparse.Namespace) -> Any:
    """Return what --map-topic and the options beside it say. Raise UsageError."""
    from tirgeo_ros.tools.convert.import_mapped import MappedTopics  # noqa: PLC0415 heavy

    if args.map_topic and (args.image_topic or args.camera_info_topic):
        raise UsageError(
            "--image-topic is for DJI's bags: use --map-topic TOPIC=thermal/image_raw, "
            "thermal/image_raw/compressed or thermal/camera_info"
        )
    of_logs = [name for name, given in _of_logs(args) if given]
    if args.map_topic and of_logs:
        raise UsageError(f"{of_logs[0]} is for logs, not for --map-topic")
    if args.imu_rpy and not args.map_topic:
        raise UsageError("--imu-rpy is for --map-topic; else set aircraft.imu_rpy_deg for process")
    pairs = tuple(map(_pair, args.map_topic))
    return MappedTopics(pairs, tuple(args.imu_rpy or (0.0, 0.0, 0.0)), args.geoid_undulation)


def _of_logs(args: argparse.Namespace) -> Iterator[tuple[str, object]]:
    """Yield the options that bags have no use for, and what is given."""
    for option, *_ in LOGS:
        given = getattr(args, option.removeprefix("--").replace("-", "_"))
        if option != "--geoid-undulation":
            yield option, given if isinstance(given, bool | str | list) else given is not None


def _pair(text: str) -> tuple[str, str]:
    """Return a topic and the topic of the contract that it becomes. Raise UsageError."""
    from tirgeo_ros.tools.replay.flight_topics import INPUTS  # noqa: PLC0415 heavy

    topic, _, contract = text.partition("=")
    contract = contract.strip("/")
    if not topic.strip("/") or contract not in INPUTS:
        raise UsageError(f"--map-topic {text}: not FROM=TO, TO one of {', '.join(INPUTS)}")
    return topic, contract


def _log_options(args: argparse.Namespace, start_ns: int | None) -> Any:
    from tirgeo_ros.io.logs.log_contents import LogOptions  # noqa: PLC0415 heavy

    return LogOptions(
        geoid_undulation_m=args.geoid_undulation,
        baseline_m=args.baseline,
        rover_first=args.rover_first,
        takeoff_height_m=args.takeoff_height,
        height=args.height,
        time_scale=args.time_scale,
        utc_offset_s=args.utc_offset,
        start_ns=start_ns,
        set_heading_rad=None if args.set_heading is None else math.radians(args.set_heading),
    )


def _write_example(args: argparse.Namespace) -> int:
    """Write the template of a columns file, to a new file or stdout."""
    from tirgeo_ros.core.types.errors import LogError  # noqa: PLC0415 heavy
    from tirgeo_ros.io.files.whole_files import write_files  # noqa: PLC0415 heavy
    from tirgeo_ros.io.logs.csv_log import EXAMPLE  # noqa: PLC0415 heavy

    if args.output is None:
        print(EXAMPLE, end="")
        return 0
    if args.output.exists():
        raise LogError(f"{args.output}: is there already; give the template another name")
    write_files({args.output: EXAMPLE}, LogError)
    return 0


def _utc_ns(text: str) -> int:
    """Return an ISO time in ns of Unix time; without a zone it is UTC. Raise UsageError."""
    from tirgeo_ros.core.types.measurements import LAST_NS  # noqa: PLC0415 --help stays quick

    with suppress(ValueError, OverflowError):
        found_ns = round(utc_time(text).timestamp() * 1e6) * 1000
        if 0 <= found_ns < LAST_NS:
            return found_ns
    raise UsageError(f"--start-time {text}: no time from 1970 to 2038, as 2024-06-11T07:44:39")


def describe(result: dict[str, Any]) -> str:
    """Return the tables of inputs and outputs."""
    parts = [_came_in(result), _went_out(result["written"])]
    if result["counts"]:
        parts.append(_pairs(result["counts"]))
    parts += result.get("notes", [])
    pictures = [t for t, kind in result.get("not_read", {}).items() if "Image" in kind]
    if pictures:
        option = "--map-topic" if result["kind"] == "mapped" else "--image-topic"
        parts.append(f"pictures in the bag that {option} may name: {', '.join(pictures)}")
    return "\n\n".join(parts)


def _pairs(numbers: dict[str, Any]) -> str:
    return "\n".join(f"{name:<32}{number}" for name, number in numbers.items())


def _came_in(result: dict[str, Any]) -> str:
    if result["kind"] == "logs":
        return "\n\n".join(map(_log, result["files"]))
    if result["kind"] == "capture":
        frames = {f"frames {name}": number for name, number in result["frames"].items()}
        return _pairs(frames | result["telemetry"] | {"time": result["time"]})
    rows = [
        (row["topic"], str(row["messages"]), str(row["refused"]), ", ".join(row["to"]))
        for row in result["topics"]
    ]
    return table([("topic in", "messages", "refused", "to"), *rows])


def _log(log: dict[str, Any]) -> str:
    """Return a log's form, records and notes."""
    rows = [("record", "read"), *((name, str(number)) for name, number in log["read"].items())]
    notes = [f"note: {note}" for note in log["notes"]]
    return "\n".join([f"{log['file']}: {log['form']}", table(rows), *notes])


def _went_out(written: dict[str, Any]) -> str:
    rows = [("topic out", "messages", "from (UTC)", "seconds")]
    for topic, topic_part in written.items():
        begun = datetime.fromtimestamp(topic_part["first_ns"] // 10**9, timezone.utc)
        lasts_s = (topic_part["last_ns"] - topic_part["first_ns"]) * 1e-9
        rows.append(
            (topic, str(topic_part["messages"]), f"{begun:%Y-%m-%d %H:%M:%S}", f"{lasts_s:.1f}")
        )
    return table(rows)

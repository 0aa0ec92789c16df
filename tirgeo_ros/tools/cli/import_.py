# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Make a bag from another maker's logs, a bag with other topics or a serial capture.

Makes a bag with the topics of tirgeo (imu/data, gps, rtk, gimbal, thermal) from logs, from a
ROS 1 bag with the topics of DJI's wrapper (dji_sdk/ or dji_osdk_ros/), from any bag of ROS 1 or
ROS 2 whose topics --map-topic names, or from the bytes of an aircraft's serial port. Each file is
recognised by its content. Topics of the wrong type and implausible values are reported and left
out. A ROS 1 bag that was cut off or never closed is read up to the cut, with exit code 1. The same
input gives the same bytes. --namespace and the topics are for bags; --packages and --key for
captures.

Logs: CSV (with --columns, of which config/columns has a template), RTKLIB .pos, u-blox UBX
(NAV-PVT, NAV-RELPOSNED), NMEA, PX4 ULog, ArduPilot DataFlash; of DJI's cameras videos (MP4, MOV)
with their subtitles, subtitles alone (SRT) and marks of stills (MRK). Several of one flight are
merged by their time stamps; a topic that two of them have for the same time comes from the first.
An error names the option for a value that a log lacks. docs/import.md and
docs/import_autopilots.md describe the result for each kind of log.

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
  tirgeo import imu.csv rover.pos --columns imu.yaml -o flight.mcap
"""

from __future__ import annotations

import argparse
import math
from contextlib import suppress
from dataclasses import replace
from datetime import datetime, timezone
from typing import Any

from tirgeo_ros.tools.cli._verb import (
    IMPORT,
    NEEDED,
    NUMBER,
    WORD,
    UsageError,
    call,
    log_options,
    number,
    utc_time,
)
from tirgeo_ros.tools.cli.dump import CAPTURE
from tirgeo_ros.tools.presentation.results import table

_FILES = "logs of one flight, or one bag or serial capture"
_TIME = "UTC of the first message or record, as 2024-06-11T07:44:39; default: the receivers' date"
_NAMESPACE = "namespace of the aircraft's topics in a ROS 1 bag, and in the new bag; default: none"
_MAP = "a topic of the bag, and tirgeo's topic that it becomes; may be repeated"
_RPY = "with --map-topic: rotation of the IMU's axes relative to base_link, deg"
_TOPIC = WORD | {"default": ""}
_BASELINE = (
    "length between the two antennas: headings with another are refused; default: from "
    "aircraft.rtk_antenna_m to aircraft.second_antenna_m. Without those it lies along the nose"
)
_ROVER = "the first antenna is the rover's, the second the moving base's; default: the reverse"
_COLUMNS = "meaning of a CSV's columns: one file for all, or one for each"
_SCALE = "scale of the times if a .pos does not tell it: %(choices)s"
_HEADING = "heading of the nose 7 s after all topics have begun, from true north, clockwise"


def degrees(text: str) -> float:
    """Return an angle in radians; a type of option."""
    return math.radians(number(text))


OPTIONS = (
    ("flight", "IN", _FILES, {"nargs": "+"}),
    ("-o --output", "OUT.mcap", "the new bag", NEEDED),
    ("--params", "YAML", "parameters of dji_node"),
    ("--namespace", "NS", _NAMESPACE, _TOPIC),
    ("--image-topic", "TOPIC", "topic that becomes thermal/image_raw[/compressed]", _TOPIC),
    ("--camera-info-topic", "TOPIC", "topic that becomes thermal/camera_info", _TOPIC),
    ("--map-topic", "FROM=TO", _MAP, WORD | {"action": "append", "default": []}),
    ("--imu-rpy", ("R", "P", "Y"), _RPY, NUMBER | {"nargs": 3}),
    *CAPTURE,
    ("--start-time", "TIME", _TIME, WORD),
    *IMPORT,
    ("--columns", "YAML", _COLUMNS, {"action": "append", "dest": "tables", "default": []}),
    ("--time-scale", "SCALE", _SCALE, {"choices": ("gpst", "utc")}),
    ("--baseline", "M", _BASELINE, NUMBER | {"dest": "baseline_m"}),
    ("--rover-first", None, _ROVER),
    ("--set-heading", "DEG", _HEADING, {"type": degrees, "dest": "set_heading_rad"}),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Import the flight; return what was read and written."""
    from tirgeo_ros.tools.convert.import_capture import CaptureOptions  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_flight import import_flight  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_ros1 import Pictures  # noqa: PLC0415 heavy

    mapped = _mapped_topics(args)
    start_ns = None if args.start_time is None else _utc_ns(args.start_time)
    pictures = Pictures(args.image_topic, args.camera_info_topic)
    capture = CaptureOptions(str(args.packages or ""), args.key, start_ns)
    logs = replace(log_options(args), start_ns=start_ns)
    kinds = {"mapped": mapped, "pictures": pictures, "capture": capture, "logs": logs}
    files = {"source": args.flight, "columns": args.tables}
    return call(import_flight, args, "importing", **files, **kinds)


def _mapped_topics(args: argparse.Namespace) -> Any:
    """Return the topics and options of --map-topic. Raise UsageError."""
    from tirgeo_ros.tools.convert.direct_input import given  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.convert.import_mapped import MappedTopics  # noqa: PLC0415 heavy
    from tirgeo_ros.tools.replay.registration import INPUTS  # noqa: PLC0415 heavy

    if args.map_topic and (args.image_topic or args.camera_info_topic):
        raise UsageError(
            "--image-topic and --camera-info-topic are for DJI's bags: use --map-topic "
            "TOPIC=thermal/image_raw, thermal/image_raw/compressed or thermal/camera_info"
        )
    of_logs = [*given(log_options(args)), *(["--columns"] if args.tables else [])]
    of_logs = [option for option in of_logs if option != "--geoid-undulation"]
    if args.map_topic and of_logs:
        raise UsageError(f"{of_logs[0]} is for logs, not for --map-topic")
    if args.imu_rpy and not args.map_topic:
        raise UsageError("--imu-rpy is for --map-topic; else set aircraft.imu_rpy_deg for process")
    pairs = []
    for text in args.map_topic:
        topic, _, contract = text.partition("=")
        contract = contract.strip("/")
        if not topic.strip("/") or contract not in INPUTS:
            raise UsageError(f"--map-topic {text}: give FROM=TO, TO one of {', '.join(INPUTS)}")
        pairs.append((topic, contract))
    rpy_deg = tuple(args.imu_rpy or (0.0, 0.0, 0.0))
    return MappedTopics(tuple(pairs), rpy_deg, args.geoid_undulation_m)


def _utc_ns(text: str) -> int:
    """Return an ISO time in ns of Unix time; without a zone it is UTC. Raise UsageError."""
    from tirgeo_ros.core.types.measurements import LAST_NS  # noqa: PLC0415 --help stays quick

    with suppress(ValueError, OverflowError):
        time_ns = round(utc_time(text).timestamp() * 1e6) * 1000
        if 0 <= time_ns < LAST_NS:
            return time_ns
    raise UsageError(f"--start-time {text}: give a time from 1970 to 2038, as 2024-06-11T07:44:39")


def describe(result: dict[str, Any]) -> str:
    """Return tables of the inputs and outputs, counts and notes."""
    parts = _inputs(result)
    rows = [("topic out", "messages", "from (UTC)", "seconds")]
    for topic, written in result["written"].items():
        begun = datetime.fromtimestamp(written["first_ns"] // 10**9, timezone.utc)
        lasts_s = (written["last_ns"] - written["first_ns"]) * 1e-9
        number = str(written["messages"])
        rows.append((topic, number, f"{begun:%Y-%m-%d %H:%M:%S}", f"{lasts_s:.1f}"))
    parts.append(table(rows))
    if result["counts"]:
        parts.append(_pairs(result["counts"]))
    parts += result.get("notes", [])
    if file := result["parameter_file"]:
        parts.append(f"{file}: parameters that follow from it: use it with --params {file}")
    pictures = [t for t, kind in result.get("not_read", {}).items() if "Image" in kind]
    if pictures:
        option = "--map-topic" if result["kind"] == "mapped" else "--image-topic"
        parts.append(f"pictures in the bag that {option} may name: {', '.join(pictures)}")
    return "\n\n".join(parts)


def _inputs(result: dict[str, Any]) -> list[str]:
    """Return a table for each input."""
    if result["kind"] == "capture":
        frames = {f"frames {name}": number for name, number in result["frames"].items()}
        return [_pairs(frames | result["telemetry"] | {"time": result["time"]})]
    if result["kind"] == "logs":
        logs = []
        for log in result["files"]:
            rows = [("record", "read"), *((name, str(n)) for name, n in log["read"].items())]
            notes = [f"note: {note}" for note in log["notes"]]
            logs.append("\n".join([f"{log['file']}: {log['form']}", table(rows), *notes]))
        return logs
    topics = [
        (row["topic"], str(row["messages"]), str(row["refused"]), ", ".join(row["to"]))
        for row in result["topics"]
    ]
    return [table([("topic in", "messages", "refused", "to"), *topics])]


def _pairs(numbers: dict[str, Any]) -> str:
    return "\n".join(f"{name:<32}{number}" for name, number in numbers.items())

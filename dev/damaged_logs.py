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
"""Damage one byte of foreign logs at random places: no more may be lost without a word.

``python -m dev.damaged_logs ../shared/foreign_logs`` imports each damaged log, or reads the bag.
*Silent* is exit code 0 and nothing said that is not said of the whole log, where more rows of a
topic are missing, moved or changed than the byte was in; then the exit code is 1.
"""

from __future__ import annotations

import argparse
import random
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from functools import cache
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from shutil import copytree
from typing import NamedTuple

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.bags.ros1_bag import any_bag
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.presentation.results import table

_LIMIT_S, _LIMIT_BYTES = 60, 4 << 30
_MOST_TEXT = 100_000  # bytes of the begin of a longer text: its rows are alike
_BLOCK = 300  # messages of the sample in a block of zstd, which has no checksum here
_VALUES = 192  # bytes at the end of an IMU's message: all but the attitude, which is of others
_COLUMNS = Path(__file__).parents[1] / "config" / "columns"
_OPTIONS = LogOptions(-21.387, 1.2, 0.0, False, 100.0, "msl", "utc", 7200, 1_700_000_000 * 10**9)


class Kind(NamedTuple):
    """Hold logs of one kind, and how much of a topic one byte of them may cost."""

    logs: str  # patterns
    columns: str | None = None  # None: no text
    rows: int = 1
    step_ns: int = 0  # by which all may move: the times of an autopilot's receiver spread


KINDS = {
    "PX4 ULog": Kind("px4/fmu_v6c.ulg px4/cube*.ulg px4/made*.ulg", step_ns=60_000_000),
    "PX4 replay CSV": Kind("px4/*.csv", "px4_replay"),
    "ArduPilot DataFlash": Kind("ardupilot/*.BIN", step_ns=60_000_000),
    "DJI Airdata CSV": Kind("dji/*.csv", "airdata"),
    "DJI SRT": Kind("dji/srt/*", ""),
    "RTKLIB .pos": Kind("rtklib/*.pos rtklib/variants/*.pos", ""),
    "IMU CSV": Kind("rtklib/*gpst*.csv", "imu_gpst"),
    "IMU CSV from start": Kind("rtklib/*raw*.csv", "imu_since_start"),
    "VectorNav IMU CSV": Kind("ins/vn310_imu*", "vectornav_imu"),
    "VectorNav GNSS CSV": Kind("ins/vn310_gnss*", "vectornav_gnss"),
    "INS messages": Kind("ins/*.bin"),
    "u-blox UBX": Kind("ublox/*.ubx"),
    "NMEA": Kind("ublox/*.nmea", ""),
    "ROS 1": Kind("ros1/made*.bag ros1/made*.bag ros1/made*.bag ros1/*.bag"),
    "rosbag2 SQLite": Kind("rosbag2/made_db3 rosbag2/made_db3_split rosbag2/real_sqlite3_*"),
    "rosbag2 SQLite, messages packed": Kind("rosbag2/made_db3*zstd_message"),
    "rosbag2 SQLite, packed": Kind("rosbag2/made_db3*zstd_file", rows=_BLOCK),
    "rosbag2 MCAP": Kind("rosbag2/made_mcap rosbag2/made_mcap_split rosbag2/real_mcap_*"),
    "rosbag2 MCAP, messages packed": Kind("rosbag2/made_mcap_zstd_message"),
    "rosbag2 MCAP, packed": Kind("rosbag2/made_mcap_zstd_[fs]*", rows=_BLOCK),
}


class Found(NamedTuple):
    """Hold topic, log time and data of each message, what was said, and if the exit code is 1."""

    rows: list[tuple[str, int, bytes]]
    warning: str = ""
    refused: bool = False


def read(log: Path, kind: Kind) -> Found:
    """Import a log, or read a bag."""
    columns = [_COLUMNS / f"{kind.columns}.yaml"] if kind.columns else []
    bag, rows, warning, error = log, [], None, None
    try:
        if log.suffix != ".bag" and not log.is_dir():
            bag = log.parent / "imported.mcap"
            summary = import_flight(log, bag, logs=_OPTIONS, columns=columns)
            warning, error = summary["warning"], summary.get("error")
        reader = any_bag(bag)
        messages = reader.messages(reader.topics().keys())
        rows = [(message.topic, message.log_time_ns, message.data) for message in messages]
        error = error or reader.damage
    except TirgeoError as refusal:
        error = refusal
    return Found(rows, f"{warning}, {error}".replace(str(log.parent), ""), error is not None)


def verdict(whole: Found, damaged: Found, kind: Kind) -> str:
    """Return what became of a damaged log."""
    if damaged.warning != whole.warning:
        return "refused" if damaged.refused and not whole.refused else "told"
    at_ns = {(topic, data[12:]): at for topic, at, data in whole.rows}  # data less their stamp
    steps = Counter(at - at_ns.get((t, data[12:]), at) for t, at, data in damaged.rows)
    step = max(steps, key=steps.__getitem__, default=0)
    step *= abs(step) <= kind.step_ns
    before, after = (
        Counter((topic, at - by, data[12:][-_VALUES:]) for topic, at, data in rows)
        for rows, by in ((whole.rows, 0), (damaged.rows, step))
    )
    topics = (Counter(t for t, *_ in part.elements()) for part in (before - after, after - before))
    lost = max(max(counts.values(), default=0) for counts in topics)
    fine = "as damaged" if lost else "same"
    return fine if lost <= kind.rows else f"SILENT: {lost} rows"


@cache
def _whole(log: Path, kind: Kind) -> Found:
    with tempfile.TemporaryDirectory() as folder:
        return read(_copy(log, kind, Path(folder)), kind)


def _copy(log: Path, kind: Kind, folder: Path) -> Path:
    copy = folder / log.name
    if log.is_dir():
        return Path(copytree(log, copy))
    data = log.read_bytes()
    is_long = kind.columns is not None and len(data) > _MOST_TEXT
    copy.write_bytes(data[: data.rfind(b"\n", 0, _MOST_TEXT) + 1] if is_long else data)
    return copy


def place(root: Path, name: str, number: int, seed: int) -> tuple[str, str]:
    """Damage a byte, of a text every second time a digit; return where, and the verdict."""
    kind, rng = KINDS[name], random.Random(f"{seed} {name} {number}")  # noqa: S311  no secret
    log = rng.choice(sorted(log for pattern in kind.logs.split() for log in root.glob(pattern)))
    with tempfile.TemporaryDirectory() as folder:
        copy = _copy(log, kind, Path(folder))
        file = rng.choice(sorted(copy.iterdir())) if copy.is_dir() else copy
        data = bytearray(file.read_bytes())
        digits = [at for at, byte in enumerate(data) if 48 <= byte < 58]
        as_digit = bool(digits) and kind.columns is not None and rng.random() < 0.5
        at = rng.choice(digits) if as_digit else rng.randrange(len(data))
        values = set(b"0123456789" if as_digit else range(256)) - {data[at]}
        before, data[at] = data[at], rng.choice(sorted(values))
        file.write_bytes(data)
        try:
            outcome = verdict(_whole(log, kind), read(copy, kind), kind)
        except Exception as error:  # noqa: BLE001  told as what it is
            outcome = f"SILENT: {type(error).__name__}: {error}"
    return f"{number}: {log.name}/{file.name} byte {at}: {before:#x} to {data[at]:#x}", outcome


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table by kind and each silent place; return 1 if there is one."""
    parser = argparse.ArgumentParser(prog="python -m dev.damaged_logs")
    parser.add_argument("root", type=Path)
    parser.add_argument("--places", type=int, default=300, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    args = parser.parse_args(argv)
    counts: dict[str, Counter[str]] = {}
    limit = resource.RLIMIT_AS, (_LIMIT_BYTES, _LIMIT_BYTES)
    with get_context("spawn").Pool(1, resource.setrlimit, limit) as worker:
        for name, number in product(args.kind or KINDS, range(args.places)):
            job = worker.apply_async(place, (args.root, name, number, args.seed))
            where, outcome = job.get(_LIMIT_S)
            counts.setdefault(name, Counter())[outcome.partition(":")[0]] += 1
            if outcome.startswith("SILENT"):
                sys.stdout.write(f"{name} {where}: {outcome}\n")
    words = ("same", "as damaged", "told", "refused", "SILENT")
    rows = [(name, *(str(outcomes[word]) for word in words)) for name, outcomes in counts.items()]
    sys.stdout.write(f"{table([('kind', *words), *rows])}\n")
    return 1 if any(outcomes["SILENT"] for outcomes in counts.values()) else 0


if __name__ == "__main__":
    sys.exit(main())

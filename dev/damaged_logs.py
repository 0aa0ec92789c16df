"""Damage one byte of foreign logs at random places: is more lost than that, without a word?

``python -m dev.damaged_logs ../shared/foreign_logs`` imports each damaged log, or reads the bag, and
compares every topic with that of the whole log. *Silent* is an import with exit code 0 and nothing
on stderr that the whole log does not say too, where more rows are missing, moved or changed than
the byte was in. Such places are told with the seed that damages them again; the exit code is 1.
"""

from __future__ import annotations

import argparse
import random
import resource
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cache
from multiprocessing import TimeoutError as LateError
from multiprocessing import get_context
from pathlib import Path
from shutil import copytree
from typing import NamedTuple

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.tools.convert.any_bag import any_bag
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.presentation.results import table

_LIMIT_S, _LIMIT_BYTES = 60, 4 << 30
#: Of longer texts the beginning is taken: rows are alike.
_MOST_TEXT = 100_000
#: Messages of the sample in a block of zstd, 128 KiB: without a checksum a byte may cost them.
_BLOCK = 300
_COLUMNS = Path(__file__).parents[1] / "config" / "columns"
#: What the logs leave open.
_OPTIONS = LogOptions(-21.387, 1.2, 0.0, False, 100.0, "msl", "utc", 7200, 1_700_000_000 * 10**9)


class Kind(NamedTuple):
    """Hold logs of one kind, and how many rows of a topic one byte of them may cost."""

    logs: str  # patterns
    columns: str = ""
    rows: int = 1  # missing or moved
    changed: int = 1  # by value
    step_ns: int = 0  # all rows together may move by this
    is_text: bool = False


#: One attitude is that of all IMU samples up to its neighbours; the receiver's times spread by ms.
_AUTOPILOT = {"changed": 30, "step_ns": 60_000_000}
KINDS = {
    "PX4 ULog": Kind("px4/fmu_v6c.ulg px4/cube*.ulg px4/made*.ulg", **_AUTOPILOT),
    "PX4 replay CSV": Kind("px4/*.csv", "px4_replay", is_text=True),
    "ArduPilot DataFlash": Kind("ardupilot/*.BIN", **_AUTOPILOT),
    "DJI Airdata CSV": Kind("dji/*.csv", "airdata", is_text=True),
    "DJI SRT": Kind("dji/srt/*", is_text=True),
    "RTKLIB .pos": Kind("rtklib/*.pos rtklib/variants/*.pos", is_text=True),
    "IMU CSV": Kind("rtklib/*gpst*.csv", "imu_gpst", is_text=True),
    "IMU CSV from start": Kind("rtklib/*raw*.csv", "imu_since_start", is_text=True),
    "VectorNav IMU CSV": Kind("ins/vn310_imu*", "vectornav_imu", is_text=True),
    "VectorNav GNSS CSV": Kind("ins/vn310_gnss*", "vectornav_gnss", is_text=True),
    "INS messages": Kind("ins/*.bin"),
    "u-blox UBX": Kind("ublox/*.ubx"),
    "NMEA": Kind("ublox/*.nmea", is_text=True),
    "ROS 1": Kind("ros1/made*.bag ros1/made*.bag ros1/made*.bag ros1/*.bag"),
    "rosbag2 SQLite": Kind("rosbag2/made_db3 rosbag2/made_db3_split rosbag2/real_sqlite3_*"),
    "rosbag2 SQLite, messages packed": Kind("rosbag2/made_db3*zstd_message"),
    "rosbag2 SQLite, packed": Kind("rosbag2/made_db3*zstd_file", rows=_BLOCK),
    "rosbag2 MCAP": Kind("rosbag2/made_mcap rosbag2/made_mcap_split rosbag2/real_mcap_*"),
    "rosbag2 MCAP, messages packed": Kind("rosbag2/made_mcap_zstd_message"),
    "rosbag2 MCAP, packed": Kind("rosbag2/made_mcap_zstd_[fs]*", rows=_BLOCK),
}


class Found(NamedTuple):
    """Hold what reading gave: topic, log time, CDR of each message, and what was said of it."""

    rows: list[tuple[str, int, bytes]]
    said: str = ""
    refused: bool = False


def read(log: Path, kind: Kind) -> Found:
    """Import a log or read a bag."""
    columns = [_COLUMNS / f"{kind.columns}.yaml"] if kind.columns else []
    output = log.parent / "imported.mcap"
    try:
        if log.suffix != ".bag" and not log.is_dir():
            told = import_flight(log, output, logs=_OPTIONS, columns=columns)
            said, error = told["warning"], told.get("error")
        bag = any_bag(output if output.exists() else log)
        found = bag.messages(bag.topics().keys())
        rows = [(one.topic, one.log_time_ns, one.data) for one in found]
        if not output.exists():
            said, error = None, bag.damage
    except TirgeoError as refusal:
        rows, said, error = [], None, refusal
    return Found(rows, f"{said}, {error}".replace(str(log.parent), ""), refused=error is not None)


def damage(data: bytearray, rng: random.Random, *, is_text: bool) -> None:
    """Make another digit of a digit, or another byte of a byte; in texts every second time each."""
    digits = [at for at, byte in enumerate(data) if 48 <= byte < 58] if is_text else []
    if digits and rng.random() < 0.5:
        at = rng.choice(digits)
        data[at] = rng.choice([byte for byte in b"0123456789" if byte != data[at]])
    else:
        data[rng.randrange(len(data))] ^= rng.randrange(1, 256)


def verdict(whole: Found, found: Found, kind: Kind) -> str:
    """Return what became of a damaged log."""
    if found.refused and not whole.refused:
        return "refused"
    if found.said != whole.said:
        return "told"
    return "same" if found.rows == whole.rows else _of_rows(whole, found, kind)


def _of_rows(whole: Found, found: Found, kind: Kind) -> str:
    """Return whether no more rows differ than may, of any topic, by stamp or by value."""
    rows, shift_ns = found.rows, _shift_ns(whole, found)
    if abs(shift_ns) <= kind.step_ns:
        rows = [(topic, at_ns - shift_ns, data) for topic, at_ns, data in rows]
    stamps = [Counter((topic, at_ns) for topic, at_ns, _ in one) for one in (whole.rows, rows)]
    values = [Counter((t, at_ns, data[12:]) for t, at_ns, data in one) for one in (whole.rows, rows)]
    moved, changed = _most(*stamps), _most(*values)
    fine = moved <= kind.rows and changed <= max(kind.changed, kind.rows)
    return "as damaged" if fine else f"SILENT: {moved} moved or missing, {changed} changed"


def _shift_ns(whole: Found, found: Found) -> int:
    """Return by how much most rows of the same values are moved."""
    known = {(topic, data[12:]): at_ns for topic, at_ns, data in whole.rows}
    shifts = Counter(at_ns - known.get((t, data[12:]), at_ns) for t, at_ns, data in found.rows)
    return max(shifts, key=shifts.__getitem__, default=0)


def _most(one: Counter[tuple[str, ...]], other: Counter[tuple[str, ...]]) -> int:
    """Return how many rows of a topic at most are in one of both alone."""
    sides = [Counter(topic for topic, *_ in part.elements()) for part in (one - other, other - one)]
    return max((max(side.values(), default=0) for side in sides), default=0)


@cache
def _whole(log: Path, kind: Kind) -> Found:
    with tempfile.TemporaryDirectory() as folder:
        return read(_copy(log, kind, Path(folder)), kind)


def _copy(log: Path, kind: Kind, folder: Path) -> Path:
    copy = folder / log.name
    if log.is_dir():
        return Path(copytree(log, copy))
    data = log.read_bytes()
    if kind.is_text and len(data) > _MOST_TEXT:
        data = data[: data.rfind(b"\n", 0, _MOST_TEXT) + 1]
    copy.write_bytes(data)
    return copy


def place(root: Path, name: str, number: int, seed: int) -> tuple[str, str]:
    """Damage a log of a kind at one place; return which, and the verdict."""
    kind, rng = KINDS[name], random.Random(f"{seed} {name} {number}")  # noqa: S311  no secret
    logs = sorted(log for pattern in kind.logs.split() for log in root.glob(pattern))
    log = rng.choice(logs)
    with tempfile.TemporaryDirectory() as folder:
        copy = _copy(log, kind, Path(folder))
        file = rng.choice(sorted(copy.iterdir())) if copy.is_dir() else copy
        data = bytearray(file.read_bytes())
        whole = bytes(data)
        damage(data, rng, is_text=kind.is_text)
        file.write_bytes(data)
        found = verdict(_whole(log, kind), read(copy, kind), kind)
    at = next(at for at, byte in enumerate(data) if byte != whole[at])
    return f"{log.name}/{file.name} byte {at}: {whole[at]:#x} to {data[at]:#x}", found


def places(root: Path, names: Sequence[str], times: int, seed: int) -> Iterator[tuple[str, ...]]:
    """Yield kind, place and verdict of all, from one process with a limit of time and memory."""
    limits = (resource.RLIMIT_AS, (_LIMIT_BYTES, _LIMIT_BYTES))
    context = get_context("spawn")
    pool = context.Pool(1, resource.setrlimit, limits)
    for name, number in ((name, number) for name in names for number in range(times)):
        try:
            where, found = pool.apply_async(place, (root, name, number, seed)).get(_LIMIT_S)
        except (LateError, Exception) as error:  # noqa: BLE001  told as what it is
            where, found = "", f"SILENT: {type(error).__name__}: {error}"
            pool.terminate()
            pool = context.Pool(1, resource.setrlimit, limits)
        yield name, f"{number}: {where}", found
    pool.terminate()


def main(argv: Sequence[str] | None = None) -> int:
    """Print a table by kind and each silent place; return 1 if there is one."""
    parser = argparse.ArgumentParser(prog="python -m dev.damaged_logs")
    parser.add_argument("root", type=Path, metavar="FOREIGN_LOGS")
    parser.add_argument("--places", type=int, default=300, metavar="N", help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kind", action="append", choices=list(KINDS))
    args = parser.parse_args(argv)
    counts: dict[str, Counter[str]] = {}
    for name, where, found in places(args.root, args.kind or list(KINDS), args.places, args.seed):
        word = found.partition(":")[0]
        counts.setdefault(name, Counter())[word] += 1
        if word == "SILENT":
            sys.stdout.write(f"{name} {where}: {found}\n")
    words = ("same", "as damaged", "told", "refused", "SILENT")
    rows = [(name, *(str(found[word]) for word in words)) for name, found in counts.items()]
    sys.stdout.write(f"{table([('kind', *words), *rows])}\n")
    return 1 if any(found["SILENT"] for found in counts.values()) else 0


if __name__ == "__main__":
    sys.exit(main())

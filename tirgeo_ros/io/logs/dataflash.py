"""Read ArduPilot's logs (DataFlash, binary) through pymavlink: IMU, attitude, receiver, barometer.

Axes are body FRD with ``AHRS_ORIENTATION`` applied, angles in degrees, heights above mean sea
level. Older logs have the names IMU2 and GPS2 where newer ones number instances in a column ``I``.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from functools import cached_property
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.io.files.memory_bound import bounded_memory
from tirgeo_ros.io.logs.autopilot_tables import (
    LOG_BYTES,
    AttitudeTable,
    AutopilotClock,
    GnssTable,
    ImuTable,
    add_gnss,
    antenna_note,
    delay_note,
    imu_samples,
    pressure_samples,
)
from tirgeo_ros.io.logs.log_contents import MSL, LogContents, LogOptions
from tirgeo_ros.io.logs.log_times import utc_ns_of_week

#: The first message of a log: a format (FMT, 0x80) that describes a message, mostly itself.
_HEAD = b"\xa3\x95\x80"
#: The fields that are taken; a log that lacks one has NaN.
_FIELDS = {
    "IMU": ("TimeUS", "I", "AccX", "AccY", "AccZ", "GyrX", "GyrY", "GyrZ"),
    "ATT": ("TimeUS", "Roll", "Pitch", "Yaw"),
    "GPS": (
        *("TimeUS", "I", "Status", "GMS", "GWk", "Lat", "Lng", "Alt"),
        *("Spd", "GCrs", "VZ", "Yaw"),
    ),
    "GPA": ("TimeUS", "I", "HAcc", "VAcc", "SAcc", "YAcc", "VV", "Und"),
    "BARO": ("TimeUS", "I", "Press"),
    "MNT": ("TimeUS",),
}
_PARAMETER = "PARM"


def is_dataflash(head: bytes) -> bool:
    """Return whether a file that begins so is a binary DataFlash log."""
    return head.startswith(_HEAD)


class _Records:
    """Hold one message's records in the order of the log, by field."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._fields = {field: array("d") for field in _FIELDS[name]}

    def add(self, message: Any) -> None:
        """Append a message of pymavlink. Raise ValueError, TypeError if a field is no number."""
        row = [float(getattr(message, field, math.nan)) for field in self._fields]
        for values, value in zip(self._fields.values(), row, strict=True):
            values.append(value)

    @cached_property
    def first(self) -> BoolArray:
        """Return which records (N,) have a time and are of the first instance."""
        known = np.isfinite(self._fields["TimeUS"])
        instance = np.nan_to_num(np.array(self._fields.get("I", np.zeros(len(known)))))
        first: BoolArray = known & (instance == instance[known].min(initial=math.inf))
        return first

    @property
    def time_us(self) -> IntArray:
        """Return the times (n,) since boot."""
        return self.column("TimeUS").astype(np.int64)

    def column(self, name: str) -> Array:
        """Return a field (n,) of the first instance; NaN where it is absent."""
        return np.array(self._fields[name])[self.first]

    def columns(self, *names: str) -> Array:
        """Return fields beside each other, (n, number of names)."""
        return np.stack([self.column(name) for name in names], axis=-1)


@dataclass
class _Log:
    """Hold what is taken of a log: records by message, parameters, whether all could be read."""

    records: dict[str, _Records]
    parameters: dict[str, float]
    damaged: bool


@np.errstate(invalid="ignore", over="ignore")  # samples are judged afterwards
def read_dataflash(path: Path, options: LogOptions) -> LogContents:
    """Read a log, as far as it is whole.

    Several IMUs or receivers: the first is taken. Raise LogError if it is no such log, has no
    IMU, or has positions and the geoid's undulation is not given.
    """
    log = _logged(path)
    contents = LogContents()
    imu, attitude, receiver, accuracy, air, _ = log.records.values()
    if not imu.first.any():
        raise LogError(f"{path}: no IMU in this log: set it in the parameter LOG_BITMASK")
    for records in (imu, attitude, receiver, air):
        number, taken = len(records.first), int(records.first.sum())
        contents.read[records.name] += number
        if number > taken:
            contents.refused[records.name, "of another instance than the first"] += number - taken
    gnss = _gnss(path, receiver, accuracy, options) if receiver.first.any() else None
    clock = AutopilotClock.by_receiver(gnss, int(imu.time_us[0]), contents)
    contents.samples += imu_samples(clock, _imu(imu), _attitude(attitude))
    if gnss is not None:
        add_gnss(contents, clock, receiver.name, gnss)
    contents.samples += pressure_samples(clock, air.time_us, air.column("Press"))
    contents.notes += _notes(log)
    return contents


def _logged(path: Path) -> _Log:
    from pymavlink.DFReader import DFReader_binary  # noqa: PLC0415  an extra, for these logs

    class Reader(DFReader_binary):  # type: ignore[misc]  # pymavlink has no types
        def init_arrays_fast(self, progress_callback: Any = None) -> None:
            """Index in Python: the faster way prints past any redirection."""
            self.init_arrays(progress_callback)

    said = StringIO()  # it prints each place that it cannot read
    log = _Log({name: _Records(name) for name in _FIELDS}, {}, damaged=False)
    try:
        with (
            bounded_memory(LOG_BYTES),
            redirect_stdout(said),
            redirect_stderr(said),
            Reader(str(path)) as file,
        ):
            while message := file.recv_match(type={*_FIELDS, _PARAMETER}, strict=True):
                _take(log, message)
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from None
    except Exception as error:  # noqa: BLE001  pymavlink raises that very class
        why = str(error) or type(error).__name__
        raise LogError(f"{path}: damaged, or not a DataFlash log: {why}") from None
    log.damaged = log.damaged or bool(said.getvalue())
    return log


def _take(log: _Log, message: Any) -> None:
    try:
        if message.get_type() == _PARAMETER:
            log.parameters[str(message.Name)] = float(message.Value)
        else:
            log.records[message.get_type()].add(message)
    except (TypeError, ValueError, AttributeError):
        log.damaged = True


def _imu(records: _Records) -> ImuTable:
    force_b = records.columns("AccX", "AccY", "AccZ")
    return ImuTable(records.time_us, force_b, records.columns("GyrX", "GyrY", "GyrZ"))


def _attitude(records: _Records) -> AttitudeTable | None:
    if not records.first.any():
        return None
    roll, pitch, yaw = np.radians(records.columns("Roll", "Pitch", "Yaw")).T
    return AttitudeTable(records.time_us, quat_from_euler(roll, pitch, yaw))


def _gnss(path: Path, fixes: _Records, accuracy: _Records, options: LogOptions) -> GnssTable:
    """Return the receiver's table; accuracies are those logged at the same time."""
    try:
        undulation_m = options.to_ellipsoid_m(MSL, path)
    except LogError as error:
        raise LogError(f"{error}{_logged_undulation(accuracy)}") from None
    course_rad = np.radians(fixes.column("GCrs"))
    speed, down = fixes.column("Spd"), fixes.column("VZ")
    velocity_n = np.stack([speed * np.cos(course_rad), speed * np.sin(course_rad), down], axis=-1)
    horizontal, vertical, of_speed, yaw_deg, has_down = _at_fixes(fixes, accuracy).T
    velocity_n[has_down == 0] = math.nan
    heading_deg = fixes.column("Yaw")
    heading_deg[heading_deg == 0] = math.nan  # what a receiver without a heading has
    return GnssTable(
        fixes.time_us,
        _utc_us(fixes),
        np.nan_to_num(fixes.column("Status")).astype(np.int64),
        np.radians(fixes.column("Lat")),
        np.radians(fixes.column("Lng")),
        fixes.column("Alt") + undulation_m,
        np.stack([horizontal, vertical], axis=-1),
        velocity_n,
        of_speed,
        np.radians(heading_deg),
        np.radians(yaw_deg),
    )


def _logged_undulation(accuracy: _Records) -> str:
    """Return what the log says of the undulation, for a person: its sign differs by receiver."""
    logged_m = accuracy.column("Und")
    known = logged_m[np.isfinite(logged_m) & (logged_m != 0)]
    if not len(known):
        return ""
    return f" (GPA.Und is {np.median(known):.1f}, of either sign, as the receiver has it)"


def _at_fixes(fixes: _Records, accuracy: _Records) -> Array:
    """Return HAcc, VAcc (m), SAcc (m/s), YAcc (deg) and VV of each fix, (n, 5); NaN for none.

    VV is 0 where the receiver has no vertical velocity.
    """
    rows = accuracy.columns("HAcc", "VAcc", "SAcc", "YAcc", "VV")
    by_time = dict(zip(accuracy.time_us.tolist(), rows, strict=True))
    unknown = np.full(5, math.nan)
    return np.array([by_time.get(time_us, unknown) for time_us in fixes.time_us.tolist()])


def _utc_us(fixes: _Records) -> IntArray:
    """Return UTC (n,) in us of Unix time; 0 where the week is not known."""
    weeks, tows_ms = np.nan_to_num(fixes.columns("GWk", "GMS")).astype(np.int64).T.tolist()
    known = (
        utc_ns_of_week(week, tow_ms * 1_000_000) // 1000 if week > 0 else 0
        for week, tow_ms in zip(weeks, tows_ms, strict=True)
    )
    return np.array(list(known), np.int64)


def _notes(log: _Log) -> Iterator[str]:
    """Yield what the parameters say of the receiver, and what the log lacks."""
    for receiver in ("GPS1_POS", "GPS_POS1"):  # from 4.6 on, and before
        place = [log.parameters.get(f"{receiver}_{axis}", 0.0) for axis in "XYZ"]
        yield from antenna_note(receiver, place)
    for delay in ("GPS1_DELAY_MS", "GPS_DELAY_MS"):
        yield from delay_note(delay, log.parameters.get(delay, 0.0))
    if log.records["MNT"].first.any():
        yield "MNT (gimbal) is left out: what its angles refer to differs by mount and version"
    if log.damaged:
        yield "the file is damaged: what could be read is imported"

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
"""Define the tables of the library, a form for each topic, and read samples from them.

A table is a dict of arrays, a NumPy structured array or a data frame of any library. It gives its
columns by name (``table["stamp_ns"]``), all of one length. pandas is not needed: any object with
``columns`` is a data frame here. The axes are named in words: forward, right, down of the body;
north, east, down at the place. Each name ends in its unit. An angle may be given in degrees, a
variance as the standard deviation.
"""

from __future__ import annotations

import difflib
import itertools
import math
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import TableError, nearest
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    PressureSample,
    SetHeading,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.messages import SensedSample

#: A dict of 1-D arrays or lists, a structured array, or a data frame.
Table: TypeAlias = Any

STAMP, ARRIVAL, ORDER = "stamp_ns", "arrival_ns", "arrival_order"
_WHOLE = (
    "must be whole nanoseconds (int64 or datetime64), since a float resolves only 256 ns: use "
    "(seconds * 1e9).round().astype('int64')"
)
_BODY, _NED = ("forward", "right", "down"), ("north", "east", "down")
#: Pairs of axes in a row of a covariance, and their places in the matrix.
_PAIRS = (("north", "east"), ("north", "down"), ("east", "down"))
_PLACES = ((0, 1), (0, 2), (1, 2))
_STATES = ("north_m", "east_m", "down_m", "phi_north_rad", "phi_east_rad", "phi_down_rad")
_UPPER = np.triu_indices(6)


class Column(NamedTuple):
    """Describe a column of numbers; without a ``default`` a table must have it.

    ``others`` are columns that may replace it: name -> conversion of their values. Columns whose
    default is nan belong together: a table has all of them or none. Values beyond ``largest``
    cause a warning: they look like degrees.
    """

    name: str
    meaning: str  # with unit and axis
    default: float | None = None
    others: Mapping[str, Callable[[Any], Any]] = {}
    largest: float = math.inf

    @property
    def is_of_group(self) -> bool:
        """Return whether it belongs to a group, of which a table has all columns or none."""
        return self.default is not None and math.isnan(self.default)


_TIME = Column(STAMP, "time of measurement, ns, int64")


class Numbers(NamedTuple):
    """Hold the numbers of a table: stamps, times of arrival, and the other columns."""

    stamps_ns: IntArray  # (n,)
    arrivals_ns: IntArray  # (n,) the stamps, where the table has no arrival_ns
    order: IntArray  # (n,) of samples with the same time of arrival
    rows: Array  # (n, columns)


def numbers_of(name: str, table: Table, columns: Sequence[Column]) -> Numbers:
    """Return the numbers of a table's columns; ``name`` is what errors call the table.

    Raises TableError naming the column and what it must be.
    """
    present = _names(name, table)
    if STAMP not in present and is_frame(table):
        why = "the index is not read; frame.reset_index(names='stamp_ns') makes a column of it"
        raise TableError(f"{name}: no column {STAMP}: {_TIME.meaning} ({why})")
    _check_presence(name, present, columns)
    stamps_ns = _whole(name, table, STAMP)
    count = len(stamps_ns)
    arrivals_ns = _whole(name, table, ARRIVAL, count) if ARRIVAL in present else stamps_ns
    order = _whole(name, table, ORDER, count) if ORDER in present else np.zeros_like(stamps_ns)
    values = [_values(name, table, present, column, count) for column in columns]
    rows = np.stack(values, axis=1)
    lacking = np.isnan(rows) & ~np.array([column.is_of_group for column in columns])
    if lacking.any():
        number, first = int(lacking.any(axis=1).sum()), int(lacking.any(axis=0).argmax())
        text = f"{name}: {number} of {count} rows have a nan, as in {columns[first].name}"
        warnings.warn(f"{text}: the filter refuses them", stacklevel=2)
    return Numbers(stamps_ns, arrivals_ns, order, rows)


def is_frame(table: Table) -> bool:
    """Return whether a table is a data frame; its type makes a frame of a dict of arrays."""
    return hasattr(table, "columns") and not isinstance(table, Mapping)


def check_unmasked(name: str, values: Any) -> None:
    """Raise TableError for masked values: NumPy would use the numbers below the mask."""
    if np.ma.is_masked(values):
        number = int(np.ma.getmaskarray(values).sum())
        raise TableError(f"{name} has {number} masked values: leave out their rows")


def _names(name: str, table: Table) -> list[str]:
    fields = getattr(getattr(table, "dtype", None), "names", None)
    columns = fields or getattr(table, "columns", table if isinstance(table, Mapping) else None)
    if columns is None:
        raise TableError(
            f"{name}: {type(table).__name__} is not a table: give a dict of arrays, a structured "
            "array or a data frame"
        )
    return [str(column) for column in columns]


def _check_presence(name: str, present: list[str], columns: Sequence[Column]) -> None:
    """Raise TableError for a missing column; suggest a similar name that no other column has."""
    group = {column.name for column in columns if column.is_of_group}
    for column in (_TIME, *columns):
        needed = column.default is None or (column.name in group and not group.isdisjoint(present))
        if not needed or not {column.name, *column.others}.isdisjoint(present):
            continue
        taken = {text for each in columns for text in (each.name, *each.others)}
        near = difflib.get_close_matches(column.name, [p for p in present if p not in taken], 1)
        hint = f"did you mean {near[0]}?" if near else f"it has: {', '.join(present)}"
        choice = " or ".join([column.name, *column.others])
        raise TableError(f"{name}: no column {choice}: {column.meaning} ({hint})")


def _whole(name: str, table: Table, column: str, count: int | None = None) -> IntArray:
    """Return times (count,), ns, of whole numbers or of datetimes with or without a time zone."""
    where, times = f"{name}: column {column}", table[column]
    check_unmasked(where, times)
    zoned = getattr(getattr(times, "dtype", None), "tz", None) is not None  # pandas gives UTC
    values = np.asarray(times, "datetime64[ns]" if zoned else None)
    if values.dtype.kind == "M":
        if np.isnat(values).any():
            row = int(np.isnat(values).argmax())
            raise TableError(f"{where} has no time (NaT) in row {row}: leave it out")
        values = values.astype("datetime64[ns]").astype(np.int64)
    if values.dtype.kind not in "iu" or values.ndim != 1:
        raise TableError(f"{where} {_WHOLE}; it is {_kind(values)}")
    _check_length(where, values, count)
    return values.astype(np.int64)


def _values(name: str, table: Table, present: list[str], column: Column, count: int) -> Array:
    """Return the values (count,) of a column, or of the one that replaces it, or its default."""
    names = [text for text in (column.name, *column.others) if text in present]
    if len(names) > 1:
        raise TableError(f"{name}: columns {' and '.join(names)} say the same: leave one out")
    if not names:
        return np.full(count, column.default)
    where = f"{name}: column {names[0]}"
    check_unmasked(where, table[names[0]])
    try:
        values = np.asarray(table[names[0]], float)
    except (TypeError, ValueError):
        kind = _kind(np.asarray(table[names[0]]))
        raise TableError(f"{where} must be numbers; it is {kind}") from None
    if values.ndim != 1:
        raise TableError(f"{where} needs one number a row, has {_kind(values)}")
    _check_length(where, values, count)
    if names[0] in column.others:
        return np.asarray(column.others[names[0]](values))
    # By their median: a single value may be damaged.
    sizes = np.abs(values[np.isfinite(values)])
    if sizes.size and (median := np.median(sizes)) > column.largest:
        degrees = column.name.replace("_rad", "_deg")
        text = f"{where} has values like {median:.4g}: if they are degrees, name it {degrees}"
        warnings.warn(text, stacklevel=2)
    return values


def _check_length(where: str, values: Any, count: int | None) -> None:
    if count is not None and len(values) != count:
        raise TableError(f"{where} has {len(values)} rows, {STAMP} has {count}")


def _kind(values: Any) -> str:
    return f"{values.dtype} of shape {values.shape}"


class Form(NamedTuple):
    """Hold the columns of a topic's table, and the conversions of a row to a sample and back."""

    columns: tuple[Column, ...]
    sample: Callable[[int, Sequence[float]], SensedSample]
    fields: tuple[str, ...]  # of the sample, in the order of the columns

    def values(self, sample: Any) -> list[float]:
        """Return a sample's row."""
        return [value for name in self.fields for value in _flat(getattr(sample, name))]


def _flat(value: Any) -> list[float]:
    """Return numbers of a field; of a covariance (3, 3) the variances, then the covariances."""
    if value is None:  # an attitude that is absent
        return [math.nan] * 4
    if np.ndim(value) == 2:
        return [*value.diagonal().tolist(), *(float(value[place]) for place in _PLACES)]
    numbers: list[float] = np.atleast_1d(np.asarray(value, float)).tolist()
    return numbers


def _angle(name: str, meaning: str, largest: float = math.tau) -> Column:
    return Column(f"{name}_rad", f"{meaning}, rad", None, {f"{name}_deg": np.radians}, largest)


def _rate(axis: str) -> Column:
    name, degrees = f"rate_{axis}_rad_s", f"rate_{axis}_deg_s"
    return Column(name, f"angular rate about {axis}, rad/s", None, {degrees: np.radians})


def _quaternion(name: str, meaning: str, default: float | None = None) -> tuple[Column, ...]:
    return tuple(Column(f"{name}_q{part}", meaning, default) for part in "wxyz")


def _variance(name: str, unit: str, squared: str, meaning: str) -> Column:
    """Return the column of a variance; its root may replace it, for an angle also in degrees."""
    others: dict[str, Callable[[Any], Any]] = {f"sigma{name}_{unit}": np.square}
    if unit == "rad":
        others[f"sigma{name}_deg"] = lambda degrees: np.square(np.radians(degrees))
    return Column(f"variance{name}_{squared}", f"{meaning}, 0 = unknown", None, others)


def _covariance(unit: str, squared: str, what: str) -> tuple[Column, ...]:
    diagonal = [_variance(f"_{axis}", unit, squared, f"{what}'s variance {axis}") for axis in _NED]
    across = [
        Column(f"covariance_{a}_{b}_{squared}", f"covariance of {a} and {b}", 0.0)
        for a, b in _PAIRS
    ]
    return (*diagonal, *across)


def _matrix(row: Sequence[float]) -> Array:
    """Return the covariance (3, 3) of three variances and three covariances."""
    matrix = np.diag(np.array(row[:3]))
    for (i, j), value in zip(_PLACES, row[3:], strict=True):
        matrix[i, j] = matrix[j, i] = value
    return matrix


def _imu(stamp_ns: int, row: Sequence[float]) -> ImuSample:
    attitude = None if math.isnan(row[6]) else np.array(row[6:])
    return ImuSample(stamp_ns, np.array(row[:3]), np.array(row[3:6]), attitude)


def _position(source: Source, stamp_ns: int, row: Sequence[float]) -> PositionSample:
    is_status = row[0] in {status.value for status in FixStatus}
    status = FixStatus(int(row[0])) if is_status else FixStatus.NONE
    place = row[1], row[2], row[3]
    return PositionSample(stamp_ns, source, status, *place, _matrix(row[4:]))


def _velocity(source: Source, stamp_ns: int, row: Sequence[float]) -> VelocitySample:
    return VelocitySample(stamp_ns, source, np.array(row[:3]), _matrix(row[3:]))


def _fixes(source: Source) -> Form:
    columns = (
        Column("status", "2 RTK fixed, 1 float or differential, 0 single, -1 none"),
        _angle("latitude", "geodetic latitude of the antenna", math.pi / 2),
        _angle("longitude", "longitude of the antenna"),
        Column("height_m", "height of the antenna above the ellipsoid, m"),
        *_covariance("m", "m2", "the position"),
    )
    fields = ("status", "latitude_rad", "longitude_rad", "height_m", "covariance_n")
    return Form(columns, partial(_position, source), fields)


def _velocities(source: Source) -> Form:
    columns = (
        *(Column(f"velocity_{a}_m_s", f"velocity {a} of the antenna, m/s") for a in _NED),
        *_covariance("m_s", "m2_s2", "the velocity"),
    )
    return Form(columns, partial(_velocity, source), ("velocity_n", "covariance_n"))


def _headings(kind: Callable[..., SensedSample]) -> Form:
    columns = (
        _angle("heading", "heading, 0 = true north, clockwise"),
        _variance("", "rad", "rad2", "the heading's variance"),
    )
    fields = ("heading_rad", "variance_rad2")
    return Form(columns, lambda stamp_ns, row: kind(stamp_ns, *row), fields)


#: Topic of a sensor -> the form of its table.
SENSORS: Mapping[str, Form] = {
    "imu/data": Form(
        (
            *(Column(f"force_{a}_m_s2", f"specific force {a}, m/s2") for a in _BODY),
            *(_rate(a) for a in _BODY),
            *_quaternion("autopilot", "the autopilot's q_nb, FRD to NED; nan = absent", math.nan),
        ),
        _imu,
        ("specific_force_b", "angular_rate_b", "autopilot_q_nb"),
    ),
    "rtk/fix": _fixes(Source.RTK_POSITION),
    "rtk/vel": _velocities(Source.RTK_VELOCITY),
    "rtk/heading": _headings(HeadingSample),
    "gps/fix": _fixes(Source.GPS_POSITION),
    "gps/vel": _velocities(Source.GPS_VELOCITY),
    "baro/pressure": Form(
        (
            Column("pressure_pa", "air pressure, Pa"),
            _variance("", "pa", "pa2", "the pressure's variance"),
        ),
        lambda stamp_ns, row: PressureSample(stamp_ns, *row),
        ("pressure_pa", "variance_pa2"),
    ),
    "ekf_node/set_heading": _headings(SetHeading),
    "gimbal/joint_states": Form(
        (
            _angle("yaw", "gimbal yaw, clockwise from above"),
            _angle("roll", "gimbal roll, right side down"),
            _angle("pitch", "gimbal pitch, camera up"),
            Column("computed", "1: of reported attitudes, not of encoders", 0.0),
        ),
        lambda stamp_ns, row: JointSample(stamp_ns, row[0], row[1], row[2], computed=bool(row[3])),
        ("yaw_rad", "roll_rad", "pitch_rad", "computed"),
    ),
    "gimbal/attitude": Form(
        _quaternion("camera", "the camera body's q_ng, FRD to NED"),
        lambda stamp_ns, row: CameraAttitudeSample(stamp_ns, np.array(row)),
        ("q_ng",),
    ),
}


class Output(NamedTuple):
    """Hold the columns of an output's table, and the conversion of its messages to rows."""

    columns: tuple[str, ...]
    pose: Callable[[Any], BodyPose | CameraPose]

    def values(self, message: Any) -> tuple[int, list[float]]:
        """Return the stamp, ns, and the row of a message."""
        pose = self.pose(message)
        q = pose.q_nb if isinstance(pose, BodyPose) else pose.q_nc
        return pose.stamp_ns, [*pose.position_n, *q, *pose.covariance[_UPPER]]


def _pose_columns(frame: str) -> tuple[str, ...]:
    pairs = itertools.combinations_with_replacement(_STATES, 2)
    quaternion = [f"{frame}_q{part}" for part in "wxyz"]
    return (*_STATES[:3], *quaternion, *(f"covariance_{a}_{b}" for a, b in pairs))


#: Topic of an output -> the form of its table. The poses are in the plane of ``map``, NED.
OUTPUTS: Mapping[str, Output] = {
    "tirgeo/odometry": Output(_pose_columns("body"), convert.body_pose),
    "tirgeo/camera_pose": Output(_pose_columns("camera"), convert.camera_pose),
}


def arrived(
    tables: Mapping[str, Table], names: Mapping[str, str] | None = None
) -> Iterator[tuple[str, int, SensedSample]]:
    """Yield topic, time of arrival (ns) and sample of the rows of tables, in order of arrival.

    They are sorted by ``arrival_ns``, then ``arrival_order``, then the order of the tables.
    ``names`` are what errors call the tables, by default the topics. Raises TableError.
    """
    read: list[tuple[str, Form, Numbers]] = []
    for topic, table in tables.items():
        if topic not in SENSORS:
            raise TableError(f"{topic}: no topic of a sensor{nearest(topic, SENSORS)}")
        form = SENSORS[topic]
        numbers = numbers_of((names or {}).get(topic, topic), table, form.columns)
        read.append((topic, form, numbers))
    if not read:
        return
    lengths = [len(numbers.stamps_ns) for _, _, numbers in read]
    place = np.repeat(np.arange(len(read)), lengths)
    row = np.concatenate([np.arange(length) for length in lengths])
    arrivals_ns = np.concatenate([numbers.arrivals_ns for _, _, numbers in read])
    order = np.lexsort((np.concatenate([numbers.order for _, _, numbers in read]), arrivals_ns))
    for which, k in zip(place[order].tolist(), row[order].tolist(), strict=True):
        topic, form, numbers = read[which]
        sample = form.sample(int(numbers.stamps_ns[k]), numbers.rows[k].tolist())
        yield topic, int(numbers.arrivals_ns[k]), sample

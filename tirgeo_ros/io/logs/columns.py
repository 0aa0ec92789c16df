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
"""Convert rows of a table to samples, as the keys of a columns file say.

Keys are read one by one: a missing, unknown or wrong one is an error. Each quantity has a function
that reads its keys and returns a function that converts a row.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.frames.rotations import canonical, quat_from_euler, quat_turned_both
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import LogError, nearest
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    PressureSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.io.logs.log_contents import DATUMS, LogOptions, Refused
from tirgeo_ros.io.messages import SensedSample

#: A columns file with every key.
TEMPLATE = "config/columns/template.yaml"
Row = Sequence[str]
#: Function of a stamp (ns) and a row: it returns the sample, or raises Refused without a value.
Quantity = Callable[[int, Row], SensedSample]

#: Directions of the body in FRD; + 0.0 leaves no -0.
_NAMES = ("front", "right", "down", "back", "left", "up")
_DIRECTIONS = dict(zip(_NAMES, np.vstack([np.eye(3), -np.eye(3)]) + 0.0, strict=True))
_STATUS = {"fixed": FixStatus.FIXED, "float": FixStatus.FLOAT, "single": FixStatus.SINGLE}
_AXES = {"flu": ("front", "left", "up"), "frd": ("front", "right", "down")}
#: Dimension -> unit -> its factor to m/s2, rad/s, rad, m, m/s, Pa; for times, to ns.
UNITS: dict[str, dict[str, float]] = {
    "acceleration": {"m/s2": 1.0, "g": 9.80665, "mg": 9.80665e-3, "ft/s2": 0.3048},
    "rate": {
        "rad/s": 1.0,
        "deg/s": math.pi / 180,
        "mrad/s": 1e-3,
        "mdeg/s": math.pi / 180e3,
        "deg/h": math.pi / 648000,
    },
    "angle": {"deg": math.pi / 180, "rad": 1.0, "mrad": 1e-3, "1e-7deg": math.pi / 180e7},
    "length": {"m": 1.0, "ft": 0.3048, "km": 1e3, "cm": 1e-2, "mm": 1e-3},
    "speed": {
        "m/s": 1.0,
        "km/h": 1 / 3.6,
        "mph": 0.44704,
        "knots": 1852 / 3600,
        "ft/s": 0.3048,
        "cm/s": 1e-2,
        "mm/s": 1e-3,
    },
    "pressure": {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1e3},
    "time": {"s": 1e9, "ms": 1e6, "0.1ms": 1e5, "us": 1e3, "ns": 1.0},
}


class Cell:
    """Hold the column of a value, and the factor that converts it to the core's unit.

    ``column`` is a name, or a number from 1; the ``index`` of a name is set by ``Columns.bind``.
    """

    def __init__(self, label: str, column: str | int, factor: float) -> None:
        self.label, self.column, self.factor = label, column, factor
        self.index = column - 1 if isinstance(column, int) else -1

    def text(self, row: Sequence[str]) -> str:
        """Return the cell of a row without blanks around it; empty where the row is too short."""
        return row[self.index].strip() if self.index < len(row) else ""

    def of(self, row: Sequence[str]) -> float:
        """Return the value of a row in the core's unit; raise Refused if it is not a number."""
        try:
            value = float(row[self.index]) * self.factor
        except (ValueError, IndexError):
            value = math.nan
        if not math.isfinite(value):
            raise self.no_number(row)
        return value

    def no_number(self, row: Sequence[str]) -> Refused:
        """Return the refusal of a cell that is not a number."""
        text = self.text(row)
        comma = ": does it have a decimal comma? (table.decimal)" if "," in text else ""
        return Refused(f"{self.label} is {f'not a number{comma}' if text else 'empty'}")


class Keys:
    """Read the values of a mapping by key; ``cells`` collects the cells of the whole file."""

    def __init__(self, place: str, values: object, cells: list[Cell]) -> None:
        if not isinstance(values, dict) or not all(isinstance(key, str | int) for key in values):
            raise LogError(f"{place}: must be keys with values, as in {TEMPLATE}")
        self.place, self._cells = place, cells
        self._values = {str(key): value for key, value in values.items()}
        self._asked: dict[str, None] = {}

    def __contains__(self, key: str) -> bool:
        """Return whether a key is present; ``finish`` then accepts it."""
        self._asked[key] = None
        return key in self._values

    def names(self) -> list[str]:
        """Return all keys; ``finish`` then accepts each."""
        self._asked |= dict.fromkeys(self._values)
        return list(self._values)

    def value(self, key: str, kind: type | tuple[type, ...], what: str) -> Any:
        """Return a value; raise LogError if it is absent or of another type."""
        if key not in self:
            raise LogError(f"{self._path(key)} is missing: {what}")
        value = self._values[key]
        if not isinstance(value, kind) or isinstance(value, bool) is not (kind is bool):
            raise LogError(f"{self._path(key)}: {value!r} is not {what}")
        return value

    def values(self, key: str) -> list[object]:
        """Return a list of values, or one value as a list."""
        value = self.value(key, (str, int, float, list), "a value or a list of values")
        return value if isinstance(value, list) else [value]

    def inner(self, key: str) -> Keys:
        """Return the keys of a mapping."""
        if key not in self:
            raise LogError(f"{self._path(key)} is missing; see {TEMPLATE}")
        return Keys(self._path(key), self._values[key], self._cells)

    def choice(self, key: str, choices: Sequence[str], default: str = "") -> str:
        """Return a value that must be one of the choices."""
        if default and key not in self:
            return default
        what = f"one of {', '.join(choices)}"
        text: str = self.value(key, str, what)
        if text not in choices:
            raise LogError(f"{self._path(key)}: {text!r} is not {what}")
        return text

    def unit(self, dimension: str) -> float:
        """Return the factor of the unit under ``unit``."""
        return UNITS[dimension][self.choice("unit", list(UNITS[dimension]))]

    def cell(self, key: str, factor: float = 1.0) -> Cell:
        """Return the cell of the column under ``key``."""
        what = "a column's name, or its number from 1 (names like y, no or 1 in quotes)"
        column = self.value(key, (str, int), what)
        if isinstance(column, int) and column < 1:
            raise LogError(f"{self._path(key)}: {column} is not {what}")
        return self.added(key, column, factor)

    def listed(self, key: str, number: int, factor: float = 1.0) -> list[Cell]:
        """Return the cells of a list of columns of this length."""
        columns = self.values(key)
        if len(columns) != number:
            raise LogError(f"{self._path(key)}: must be a list of {number} columns")
        inner = Keys(self._path(key), dict(enumerate(columns, 1)), self._cells)
        return [inner.cell(name, factor) for name in inner.names()]

    def added(self, key: str, column: str | int, factor: float = 1.0) -> Cell:
        """Return a new cell of a column."""
        label = self._path(key).partition(": ")[2]
        self._cells.append(Cell(label, column, factor))
        return self._cells[-1]

    def cells(self, keys: str, dimension: str) -> list[Cell]:
        """Return the cells under keys (separated by blanks) that share one unit."""
        factor = self.unit(dimension)
        return [self.cell(key, factor) for key in keys.split()]

    def finish(self) -> None:
        """Raise LogError for a key that was not asked for."""
        for key in self._values:
            if key not in self._asked:
                raise LogError(f"{self._path(key)}: unknown key{nearest(key, self._asked)}")

    def _path(self, key: str) -> str:
        return f"{self.place}{'.' if ': ' in self.place else ': '}{key}"


class Log(NamedTuple):
    """Hold a table's file, and the options that say what the table does not."""

    path: Path
    options: LogOptions


def _imu(keys: Keys, _log: Log) -> Quantity:
    """Convert specific force, angular rate, and the attitude where the row has one."""
    force, rate = (_vector(keys, *what) for what in (("accel", "acceleration"), ("gyro", "rate")))
    turn_bi = _rotation_bi(keys)
    attitude = _attitude(keys.inner("attitude")) if "attitude" in keys else None

    def sample(stamp_ns: int, row: Row) -> ImuSample:
        force_b = turn_bi @ [cell.of(row) for cell in force]
        rate_b = turn_bi @ [cell.of(row) for cell in rate]
        q_nb = None
        if attitude is not None:
            with suppress(Refused):
                q_nb = attitude(row)
        return ImuSample(stamp_ns, force_b, rate_b, q_nb)

    return sample


def _position(source: Source, keys: Keys, log: Log) -> Quantity:
    """Convert latitude, longitude (also 0 to 360 deg) and height of an antenna."""
    place = keys.cells("latitude longitude", "angle")
    inner = keys.inner("height")
    height = inner.cell("column", inner.unit("length"))
    datum = inner.choice("above", DATUMS)
    inner.finish()
    status = _status(keys)
    sigma = _sigmas(keys, "length", must=source is Source.RTK_POSITION)
    offset_m = log.options.to_ellipsoid_m(datum, log.path)

    def sample(stamp_ns: int, row: Row) -> PositionSample:
        latitude_rad, longitude_rad = (cell.of(row) for cell in place)
        if math.pi < longitude_rad <= math.tau:
            longitude_rad -= math.tau
        geodetic = latitude_rad, longitude_rad, height.of(row) + offset_m
        covariance_n = _covariance(sigma, row)
        return PositionSample(stamp_ns, source, status(row), *geodetic, covariance_n)

    return sample


def _velocity(source: Source, keys: Keys, _log: Log) -> Quantity:
    """Convert a velocity north, east and down or up."""
    third = "up" if "up" in keys else "down"
    signs = np.array([1.0, 1.0, -1.0 if third == "up" else 1.0])
    cells = keys.cells(f"north east {third}", "speed")
    sigma = _sigmas(keys, "speed", must=source is Source.RTK_VELOCITY)

    def sample(stamp_ns: int, row: Row) -> VelocitySample:
        velocity_n = signs * [cell.of(row) for cell in cells]
        return VelocitySample(stamp_ns, source, velocity_n, _covariance(sigma, row))

    return sample


def _heading(keys: Keys, log: Log) -> Quantity:
    """Convert the azimuth of the nose, or of the line between two antennas."""
    of_baseline = keys.choice("of", ("nose", "baseline")) == "baseline"
    cell = keys.cell("column", keys.unit("angle"))
    sigma = _sigmas(keys, "angle")
    if of_baseline and log.options.baseline_m is None:
        raise LogError(
            f"{log.path}: headings of a baseline: set aircraft.rtk_antenna_m and "
            "aircraft.second_antenna_m in --params"
        )
    offset_rad = log.options.baseline_rad if of_baseline else 0.0

    def sample(stamp_ns: int, row: Row) -> HeadingSample:
        heading_rad = (cell.of(row) - offset_rad) % math.tau
        return HeadingSample(stamp_ns, heading_rad, float(_covariance(sigma, row)[0, 0]))

    return sample


def _pressure(keys: Keys, _log: Log) -> Quantity:
    """Convert a barometer's pressure; without a sigma its variance is unknown."""
    cell = keys.cell("column", keys.unit("pressure"))
    sigma = _sigmas(keys, "pressure", must=False)

    def sample(stamp_ns: int, row: Row) -> PressureSample:
        variance = float(_covariance(sigma, row)[0, 0])
        return PressureSample(stamp_ns, cell.of(row), variance)

    return sample


def _gimbal_joints(keys: Keys, _log: Log) -> Quantity:
    """Convert encoder angles: yaw, then roll, then pitch, in FLU or FRD axes."""
    sign = -1.0 if keys.choice("axes", ("flu", "frd")) == "flu" else 1.0
    cells = keys.cells("yaw roll pitch", "angle")

    def sample(stamp_ns: int, row: Row) -> JointSample:
        yaw_rad, roll_rad, pitch_rad = (cell.of(row) for cell in cells)
        return JointSample(stamp_ns, sign * yaw_rad, roll_rad, sign * pitch_rad)

    return sample


def _gimbal_attitude(keys: Keys, _log: Log) -> Quantity:
    """Convert the camera's attitude."""
    attitude = _attitude(keys.inner("attitude"))
    return lambda stamp_ns, row: CameraAttitudeSample(stamp_ns, attitude(row))


#: Key of a columns file -> the function that returns its Quantity.
QUANTITIES: dict[str, Callable[[Keys, Log], Quantity]] = {
    "imu": _imu,
    "rtk_position": partial(_position, Source.RTK_POSITION),
    "rtk_velocity": partial(_velocity, Source.RTK_VELOCITY),
    "rtk_heading": _heading,
    "gps_position": partial(_position, Source.GPS_POSITION),
    "gps_velocity": partial(_velocity, Source.GPS_VELOCITY),
    "pressure": _pressure,
    "gimbal_joints": _gimbal_joints,
    "gimbal_attitude": _gimbal_attitude,
}


def matching(cell: Cell, values: Sequence[object]) -> Callable[[Row], bool]:
    """Return a function: does a row's cell equal one of the values? Numbers compare as numbers."""
    wanted = {_normal(str(value)) for value in values}
    return lambda row: _normal(cell.text(row)) in wanted


def _normal(text: str) -> float | str:
    with suppress(ValueError):
        return float(text)
    return text


def _attitude(keys: Keys) -> Callable[[Row], Array]:
    """Return a function: row to unit quaternion (4,) wxyz, FRD to NED. It raises Refused.

    The file has roll, pitch and yaw, or a quaternion; of FRD in NED, or of FLU in ENU.
    """
    is_enu = keys.choice("frame", ("ned", "enu")) == "enu"
    is_quaternion = "wxyz" in keys
    cells = keys.listed("wxyz", 4) if is_quaternion else keys.cells("roll pitch yaw", "angle")
    keys.finish()

    def of(row: Row) -> Array:
        values = np.array([cell.of(row) for cell in cells])
        if not is_quaternion:
            values = quat_from_euler(*values)
        if not math.isclose(float(values @ values), 1.0, abs_tol=0.02):
            raise Refused("the quaternion's norm is not 1")
        return canonical(np.array(quat_turned_both(*values)) if is_enu else values)

    return of


def _status(keys: Keys) -> Callable[[Row], FixStatus]:
    """Return a function: row to the quality of its fix. It raises Refused.

    The quality is the same for all rows, or depends on a column's value.
    """
    inner = keys.inner("status")
    if "always" in inner:
        always = _STATUS[inner.choice("always", list(_STATUS))]
        inner.finish()
        return lambda _: always
    cell = inner.cell("column")
    by_value = [
        (matching(cell, inner.values(name)), status)
        for name, status in _STATUS.items()
        if name in inner
    ]
    inner.finish()

    def of(row: Row) -> FixStatus:
        for fits, status in by_value:
            if fits(row):
                return status
        raise Refused("status is not one of the values for a fix")

    return of


def _vector(keys: Keys, key: str, dimension: str) -> list[Cell]:
    """Return the cells of x, y and z: a mapping with their columns and their unit."""
    inner = keys.inner(key)
    cells = inner.listed("columns", 3, inner.unit(dimension))
    inner.finish()
    return cells


def _rotation_bi(keys: Keys) -> Array:
    """Return the rotation (3, 3) from the file's axes to FRD."""
    what = f"{', '.join(_AXES)}, or a list of three of {', '.join(_DIRECTIONS)}"
    axes = keys.value("axes", (str, list), what)
    names = _AXES.get(axes, ()) if isinstance(axes, str) else axes
    if not isinstance(names, tuple | list) or [n for n in names if n not in _DIRECTIONS]:
        names = ()
    rotation = np.array([_DIRECTIONS[name] for name in names]).T
    if rotation.shape != (3, 3) or not math.isclose(np.linalg.det(rotation), 1.0):
        raise LogError(f"{keys.place}.axes: {axes!r} are not right-handed axes: give {what}")
    return rotation


def _sigmas(keys: Keys, dimension: str, *, must: bool = True) -> list[Cell | float]:
    """Return the standard deviations north, east, up: cells or values; a single one is for all.

    Zeros, which mean unknown, if the file has none and ``must`` is false.
    """
    if not must and "sigma" not in keys:
        return [0.0] * 3
    inner = keys.inner("sigma")
    factor = inner.unit(dimension)
    sigmas: list[Cell | float]
    if "value" in inner:
        value = inner.value("value", (int, float), "a number")
        if not 0 < value < math.inf:
            raise LogError(f"{inner.place}.value: {value!r} is not above zero")
        sigmas = [value * factor] * 3
    elif "column" in inner:
        sigmas = [inner.cell("column", factor)] * 3
    elif "horizontal" in inner:
        horizontal = inner.cell("horizontal", factor)
        sigmas = [horizontal, horizontal, inner.cell("vertical", factor)]
    else:
        sigmas = [inner.cell(key, factor) for key in ("north", "east", "up")]
    inner.finish()
    return sigmas


def _covariance(sigmas: list[Cell | float], row: Row) -> Array:
    """Return the covariance (3, 3) in NED; zeros mean unknown."""
    values = [sigma if isinstance(sigma, float) else sigma.of(row) for sigma in sigmas]
    return np.diag(np.square(values))

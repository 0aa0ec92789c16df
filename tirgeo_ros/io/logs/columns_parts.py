"""Read the parts that quantities of a columns file have in common."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress

import numpy as np

from tirgeo_ros.core.frames.axes import quat_turned_both
from tirgeo_ros.core.frames.rotations import canonical, quat_from_euler
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.io.logs.columns_keys import Cell, Keys
from tirgeo_ros.io.logs.log_contents import Refused

Row = Sequence[str]
#: Directions of the body in FRD.
_DIRECTIONS = {
    "front": (1.0, 0.0, 0.0),
    "right": (0.0, 1.0, 0.0),
    "down": (0.0, 0.0, 1.0),
    "back": (-1.0, 0.0, 0.0),
    "left": (0.0, -1.0, 0.0),
    "up": (0.0, 0.0, -1.0),
}
_STATUS = {"fixed": FixStatus.FIXED, "float": FixStatus.FLOAT, "single": FixStatus.SINGLE}
_AXES = {"flu": ("front", "left", "up"), "frd": ("front", "right", "down")}


class Matching:
    """Compare a cell with values: as numbers where both are, else as text."""

    def __init__(self, cell: Cell, values: Sequence[object]) -> None:
        self.cell, self._values = cell, {_normal(str(value)) for value in values}

    def fits(self, row: Row) -> bool:
        """Return whether the row's cell is one of the values."""
        return _normal(self.cell.text(row)) in self._values


def _normal(text: str) -> float | str:
    with suppress(ValueError):
        return float(text)
    return text


class Attitude:
    """Convert roll, pitch and yaw, or a quaternion, to FRD in NED.

    In the file it is FRD in NED, or FLU in ENU.
    """

    def __init__(self, keys: Keys) -> None:
        self._is_enu = keys.choice("frame", ("ned", "enu")) == "enu"
        self._is_quaternion = "wxyz" in keys
        if self._is_quaternion:
            self._cells = keys.listed("wxyz", 4)
        else:
            self._cells = keys.cells("roll pitch yaw", "angle")
        keys.finish()

    def of(self, row: Row) -> Array:
        """Return the unit quaternion (4,) wxyz; raise Refused if there is none."""
        values = np.array([cell.of(row) for cell in self._cells])
        if not self._is_quaternion:
            values = quat_from_euler(*values)
        if not math.isclose(float(values @ values), 1.0, abs_tol=0.02):
            raise Refused("the quaternion's norm is not 1")
        return canonical(np.array(quat_turned_both(*values)) if self._is_enu else values)


class Status:
    """Tell the quality of a fix: the same for all rows, or by a column's values."""

    def __init__(self, keys: Keys) -> None:
        inner = keys.inner("status")
        self._always: FixStatus | None = None
        self._by_value: list[tuple[Matching, FixStatus]] = []
        if "always" in inner:
            self._always = _STATUS[inner.choice("always", list(_STATUS))]
        else:
            cell = inner.cell("column")
            for name, status in _STATUS.items():
                if name in inner:
                    self._by_value.append((Matching(cell, inner.values(name)), status))
        inner.finish()

    def of(self, row: Row) -> FixStatus:
        """Return the status of a row; raise Refused for a value that is no fix."""
        if self._always is not None:
            return self._always
        for matching, status in self._by_value:
            if matching.fits(row):
                return status
        raise Refused("status is none of those that are a fix")


def vector(keys: Keys, key: str, dimension: str) -> list[Cell]:
    """Return the cells of x, y and z: a mapping with their columns and their unit."""
    inner = keys.inner(key)
    cells = inner.listed("columns", 3, inner.unit(dimension))
    inner.finish()
    return cells


def rotation_bi(keys: Keys) -> Array:
    """Return the rotation (3, 3) from the file's axes to FRD."""
    what = f"{', '.join(_AXES)}, or a list of three of {', '.join(_DIRECTIONS)}"
    given = keys.value("axes", (str, list), what)
    names = _AXES.get(given, ()) if isinstance(given, str) else given
    if not isinstance(names, tuple | list) or [n for n in names if n not in _DIRECTIONS]:
        names = ()
    rotation = np.array([_DIRECTIONS[name] for name in names]).T
    if rotation.shape != (3, 3) or not math.isclose(np.linalg.det(rotation), 1.0):
        raise LogError(f"{keys.place}.axes: {given!r} are not right-handed axes: {what}")
    return rotation


def sigmas(keys: Keys, dimension: str) -> list[Cell | float]:
    """Return standard deviations north, east and up: cells, or values; one is for all three."""
    inner = keys.inner("sigma")
    factor = inner.unit(dimension)
    found: list[Cell | float]
    if "value" in inner:
        value = inner.value("value", (int, float), "a number")
        if not 0 < value < math.inf:
            raise LogError(f"{inner.place}.value: {value!r} is not above zero")
        found = [value * factor] * 3
    elif "column" in inner:
        found = [inner.cell("column", factor)] * 3
    elif "horizontal" in inner:
        horizontal = inner.cell("horizontal", factor)
        found = [horizontal, horizontal, inner.cell("vertical", factor)]
    else:
        found = [inner.cell(key, factor) for key in ("north", "east", "up")]
    inner.finish()
    return found


def sigmas_if_known(keys: Keys, dimension: str) -> list[Cell | float]:
    """Return ``sigmas``, or zeros, which are unknown, where the file has none."""
    return sigmas(keys, dimension) if "sigma" in keys else [0.0] * 3


def covariance(found: list[Cell | float], row: Row) -> Array:
    """Return the covariance (3, 3) in NED; zeros: unknown."""
    values = [sigma if isinstance(sigma, float) else sigma.of(row) for sigma in found]
    return np.diag(np.square(values))

"""Read the keys of a columns file one by one: what is missing, unknown or wrong is an error."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from tirgeo_ros.core.types.errors import LogError, nearest
from tirgeo_ros.io.logs.log_contents import Refused

#: What a unit is multiplied by to give m/s2, rad/s, rad, m, m/s, Pa; for times, ns.
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
        "kn": 1852 / 3600,
        "knots": 1852 / 3600,
        "ft/s": 0.3048,
        "cm/s": 1e-2,
        "mm/s": 1e-3,
    },
    "pressure": {"Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "kPa": 1e3},
    "time": {"s": 1e9, "ms": 1e6, "0.1ms": 1e5, "us": 1e3, "ns": 1.0},
}


class Cell:
    """Hold where a value stands in each row, and what it is multiplied by.

    ``column`` is a name, or a number from 1; ``index`` is known when the table is open.
    """

    def __init__(self, label: str, column: str | int, factor: float) -> None:
        self.label, self.column, self.factor = label, column, factor
        self.index = column - 1 if isinstance(column, int) else -1

    def text(self, row: Sequence[str]) -> str:
        """Return the cell of a row without blanks around it; empty where the row is too short."""
        return row[self.index].strip() if self.index < len(row) else ""

    def of(self, row: Sequence[str]) -> float:
        """Return the value of a row in the core's unit; raise Refused if it is no number."""
        try:
            value = float(row[self.index]) * self.factor
        except (ValueError, IndexError):
            value = math.nan
        if not math.isfinite(value):
            raise self.no_number(row)
        return value

    def no_number(self, row: Sequence[str]) -> Refused:
        """Return why a cell is no number."""
        text = self.text(row)
        comma = ": has it a decimal comma? (table.decimal)" if "," in text else ""
        return Refused(f"{self.label} is {f'not a number{comma}' if text else 'empty'}")


class Keys:
    """Hand out the values of a mapping by key; ``cells`` collects the cells of the whole file."""

    def __init__(self, place: str, values: object, cells: list[Cell]) -> None:
        if not isinstance(values, dict) or not all(isinstance(key, str | int) for key in values):
            raise LogError(f"{place}: must be keys with values; --example shows them")
        self.place, self._cells = place, cells
        self._values = {str(key): value for key, value in values.items()}
        self._asked: dict[str, None] = {}

    def __contains__(self, key: str) -> bool:
        """Return whether a key is there; it is a known one then."""
        self._asked[key] = None
        return key in self._values

    def names(self) -> list[str]:
        """Return all keys, each of which is a known one then."""
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
            raise LogError(f"{self._path(key)} is missing; --example shows it")
        return Keys(self._path(key), self._values[key], self._cells)

    def choice(self, key: str, choices: Sequence[str], default: str = "") -> str:
        """Return one of the choices."""
        if default and key not in self:
            return default
        what = f"one of {', '.join(choices)}"
        text: str = self.value(key, str, what)
        if text not in choices:
            raise LogError(f"{self._path(key)}: {text!r} is not {what}")
        return text

    def unit(self, dimension: str, key: str = "unit") -> float:
        """Return what a value in the unit under ``key`` is multiplied by."""
        return UNITS[dimension][self.choice(key, list(UNITS[dimension]))]

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
        """Return the cells under keys separated by blanks, which have one unit."""
        factor = self.unit(dimension)
        return [self.cell(key, factor) for key in keys.split()]

    def finish(self) -> None:
        """Raise LogError for a key that nobody asked for."""
        for key in self._values:
            if key not in self._asked:
                raise LogError(f"{self._path(key)}: unknown key{nearest(key, self._asked)}")

    def _path(self, key: str) -> str:
        return f"{self.place}{'.' if ': ' in self.place else ': '}{key}"

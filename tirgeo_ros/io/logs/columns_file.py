"""Read a columns file: the YAML that says what the columns of a table mean."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.io.logs.columns_keys import Cell, Keys
from tirgeo_ros.io.logs.columns_parts import Matching
from tirgeo_ros.io.logs.columns_quantities import QUANTITIES, Quantity
from tirgeo_ros.io.logs.columns_time import TimeColumns
from tirgeo_ros.io.parameters.parameter_file import load_yaml

_SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " "}


@dataclass(frozen=True)
class Layout:
    """Hold how a table is written."""

    header: bool = True  # else columns are numbers
    separator: str = ","
    skip: int = 0  # lines before the header
    comment: str = ""  # what begins lines that are passed over; empty: none
    ragged: bool = False  # rows may be shorter than most
    decimal_comma: bool = False  # 9,81 is a number


@dataclass(frozen=True)
class NamedQuantity:
    """Hold a quantity with its key, its time, and the rows that it is in."""

    name: str
    quantity: Quantity
    time: TimeColumns
    where: tuple[Matching, ...]

    def is_in(self, row: Sequence[str]) -> bool:
        """Return whether a row has this quantity."""
        return all(matching.fits(row) for matching in self.where)


class Columns:
    """Hold what a columns file says. Raise LogError or ConfigError naming file and key."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.cells: list[Cell] = []
        keys = Keys(str(path), load_yaml(path), self.cells)
        self.layout = _layout(keys.inner("table")) if "table" in keys else Layout()
        self._time = TimeColumns(keys.inner("time")) if "time" in keys else None
        self.quantities = [self._quantity(name, keys) for name in QUANTITIES if name in keys]
        keys.finish()
        if not self.quantities:
            raise LogError(f"{path}: none of {', '.join(QUANTITIES)}; --example shows them")
        for cell in self.cells:
            if isinstance(cell.column, int) is self.layout.header:
                raise LogError(
                    f"{path}: {cell.label}: {cell.column!r}: a number is for tables without a "
                    "header (table: {header: false}), a name for those with one"
                )

    def _quantity(self, name: str, keys: Keys) -> NamedQuantity:
        inner = keys.inner(name)
        kind, source = QUANTITIES[name]
        time = TimeColumns(inner.inner("time")) if "time" in inner else self._time
        if time is None:
            raise LogError(f"{self.path}: time is missing: for all, or {name}.time")
        where = _where(inner.inner("where")) if "where" in inner else ()
        made = NamedQuantity(name, kind(inner, source), time, where)
        inner.finish()
        return made

    def bind(self, titles: Sequence[str], path: Path) -> None:
        """Find the columns by their titles. Raise LogError for one that is absent or twice."""
        names = [title.strip() for title in titles]
        for cell in self.cells:
            number = names.count(str(cell.column))
            if number != 1:
                raise LogError(
                    f"{path}: {number or 'no'} column{'s' * (number > 1)} {cell.column!r} "
                    f"({self.path}: {cell.label}); it has {', '.join(names)}"
                )
            cell.index = names.index(str(cell.column))


def _layout(keys: Keys) -> Layout:
    kinds = {
        **dict.fromkeys(("header", "ragged"), (bool, "true or false")),
        "skip": (int, "a number of lines"),
        "comment": (str, "a text"),
    }
    given = {name: keys.value(name, *kinds[name]) for name in kinds if name in keys}
    if given.get("skip", 0) < 0:
        raise LogError(f"{keys.place}.skip: {given['skip']} is not a number of lines")
    separator = _SEPARATORS[keys.choice("separator", list(_SEPARATORS), "comma")]
    decimal_comma = keys.choice("decimal", ("point", "comma"), "point") == "comma"
    keys.finish()
    return Layout(separator=separator, decimal_comma=decimal_comma, **given)


def _where(keys: Keys) -> tuple[Matching, ...]:
    """Return the conditions of a mapping of columns to values; a number names a column too."""
    found = []
    for name in keys.names():
        column: str | int = int(name) if name.isdecimal() else name
        found.append(Matching(keys.added(name, column), keys.values(name)))
    return tuple(found)

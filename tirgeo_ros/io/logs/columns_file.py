"""Read a columns file: the YAML that says what the columns of a table mean."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.logs.columns_keys import Cell, Keys
from tirgeo_ros.io.logs.columns_parts import Matching
from tirgeo_ros.io.logs.columns_quantities import QUANTITIES, Quantity
from tirgeo_ros.io.logs.log_contents import (
    GPS_EPOCH_NS,
    SECOND_NS,
    LogOptions,
    Refused,
    agreed,
    first_count,
    utc_ns,
    utc_ns_of_week,
    written_time,
)
from tirgeo_ros.io.parameters.parameter_file import load_yaml

#: What a column of times counts: since 1970 in UTC or in GPS time, since 1980-01-06 in GPS time,
#: since the GPS week's or the log's begin; or a written date, in UTC, GPS time or local time.
_NUMBERS = ("utc", "gpst", "gps", "week", "start")
_WRITTEN = ("written_utc", "written_gpst", "written_local")
#: A full week since 1999; receivers that count to 1023 began anew then, and in 2019.
_LEAST_WEEK = 1024
_FORM = "2024-06-11 17:44:39.25"


class TimeColumns:
    """Convert the cells of a row to ns of Unix time (UTC), exactly."""

    def __init__(self, keys: Keys) -> None:
        self._counts = keys.choice("counts", (*_NUMBERS, *_WRITTEN))
        self._cell = keys.cell("column", 1.0 if self._is_written else keys.unit("time"))
        self._week = keys.cell("week") if self._counts == "week" else None
        has_date = (self._counts == "start" or self._is_written) and "date" in keys
        self._date = keys.cell("date") if has_date else None
        self._begun_ns = 0
        self._agreed = (0, 0)  # bounds of the begins by the dates of most rows
        keys.finish()

    @property
    def _is_written(self) -> bool:
        return self._counts in _WRITTEN

    def prepare(self, rows: Iterable[Sequence[str]], path: Path, options: LogOptions) -> None:
        """Find when a count since the log's start began. Raise LogError if nothing tells it.

        Dates have whole seconds: each bounds the begin to a second, and all of them together to
        less; the middle of that is taken. What contradicts most of the rows does not count.
        """
        self._path, self._options = path, options
        if self._counts != "start":
            return
        if self._date is None:
            self._begun_ns = self._begun_by_option(rows)
            return
        begins = [ns for row in rows if (ns := self._begun_by_date(row)) is not None]
        if not begins:
            raise LogError(f"{path}: no date in column {self._date.column}: {self._date.label}")
        self._agreed = agreed(begins)
        self._begun_ns = (sum(self._agreed) + SECOND_NS) // 2

    def stamp_ns(self, row: Sequence[str]) -> int:
        """Return the time of a row; raise Refused if it has none."""
        if self._is_written:
            return self._written_ns(row)
        number = self._number(row)
        if self._week is not None:
            week = int(self._week.of(row))
            if week < _LEAST_WEEK:
                raise Refused(f"{self._week.label} is below 1024: name the column of full weeks")
            return utc_ns_of_week(week, number)
        if self._counts == "start":
            begun_ns = self._begun_by_date(row)
            if begun_ns is not None and not self._agreed[0] <= begun_ns <= self._agreed[1]:
                raise Refused("its date and count contradict those of most rows")
            return self._begun_ns + number
        epoch_ns = GPS_EPOCH_NS if self._counts == "gps" else 0
        return number if self._counts == "utc" else utc_ns(epoch_ns + number)

    def _number(self, row: Sequence[str]) -> int:
        """Return the count of a row in ns, by decimal arithmetic."""
        with suppress(ArithmeticError):
            number = Decimal(self._cell.text(row)) * int(self._cell.factor)
            if number.is_finite() and abs(number) < LAST_NS:
                return round(number)
        raise self._cell.no_number(row)

    def _written_ns(self, row: Sequence[str]) -> int:
        text = self._cell.text(row)
        if self._date is not None:
            text = f"{self._date.text(row).partition(' ')[0]} {text}"
        written = written_time(text)
        if written is None:
            raise Refused(f"{self._cell.label} is not a date with time of day, as {_FORM}")
        if self._counts == "written_gpst":
            return utc_ns(written.local_ns)
        if self._counts == "written_utc" and written.offset_s is None:
            return written.local_ns
        return self._options.utc_ns(written, self._path)

    def _begun_by_option(self, rows: Iterable[Sequence[str]]) -> int:
        if self._options.start_ns is None:
            raise LogError(
                f"{self._path}: its times count from its start: give the UTC of the first row as "
                "--start-time"
            )
        return self._options.start_ns - first_count(self._numbers(rows))

    def _numbers(self, rows: Iterable[Sequence[str]]) -> Iterator[int]:
        for row in rows:
            with suppress(Refused):  # counted when it is read again
                yield self._number(row)

    def _begun_by_date(self, row: Sequence[str]) -> int | None:
        written = self._date and written_time(self._date.text(row))
        with suppress(Refused):
            return written.local_ns - self._number(row) if written else None
        return None


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

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
"""Read a table (CSV) by a columns file: the YAML that says what its columns mean."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from decimal import Decimal
from itertools import islice
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import LAST_NS
from tirgeo_ros.io.files.whole_files import WINDOWS, encoding_of, first_bytes, reading
from tirgeo_ros.io.logs.columns import (
    QUANTITIES,
    TEMPLATE,
    Cell,
    Keys,
    Log,
    Quantity,
    Row,
    matching,
)
from tirgeo_ros.io.logs.log_contents import (
    GPS_EPOCH_NS,
    SECOND_NS,
    LogContents,
    LogOptions,
    Refused,
    first_count,
    largest_group,
    utc_ns,
    utc_ns_of_week,
    written_time,
)
from tirgeo_ros.io.messages import SensedSample
from tirgeo_ros.io.parameters.parameter_file import load_yaml

_ROW = "row"
_FIRST_ROWS = 200  # by which the usual number of columns is found
#: What a column of times has: counts since 1970 in UTC or in GPS time, since 1980-01-06 in GPS
#: time, since the GPS week or the log began; or written dates in UTC, GPS time or local time.
_NUMBERS = ("utc", "gpst", "gps", "week", "start")
_WRITTEN = ("written_utc", "written_gpst", "written_local")
_FORM = "2024-06-11 17:44:39.25"
_SEPARATORS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " "}


def read_csv(path: Path, options: LogOptions) -> LogContents:
    """Read a table as ``options.columns`` says. Raise LogError or ConfigError."""
    if options.columns is None:
        raise LogError(f"{path}: say what its columns mean with --columns")
    columns = Columns(options.columns, Log(path, options))
    layout = columns.layout
    if layout.header:
        columns.bind(next(_rows(path, layout), []), path)
    usual = Counter(map(len, islice(_values(path, layout), _FIRST_ROWS)))
    width = 0 if layout.ragged else max(usual, key=usual.__getitem__, default=0)
    for time in dict.fromkeys(quantity.time for quantity in columns.quantities):
        numbered = enumerate(_values(path, layout))
        time.prepare((number, row) for number, row in numbered if len(row) >= width)
    table = _Table(columns, width)
    for number, row in enumerate(_values(path, layout)):
        table.take(number, row)
    table.finish()
    return table.contents


class _Table:
    """Convert rows to samples; count the rows read, and those refused by reason."""

    def __init__(self, columns: Columns, width: int) -> None:
        self.contents = LogContents()
        self._columns, self._width = columns, width
        self._fitting: Counter[str] = Counter()
        self._newest_ns: dict[str, int] = {}

    def take(self, number: int, row: Row) -> None:
        """Take a row."""
        self.contents.read[_ROW] += 1
        if len(row) < self._width:
            self.contents.refused[_ROW, "it has fewer columns than the others"] += 1
            return
        for named in self._columns.quantities:
            if all(fits(row) for fits in named.where):
                self._fitting[named.name] += 1
                try:
                    self.contents.samples.append(self._sample(named, number, row))
                except Refused as why:
                    self.contents.refused[named.name, str(why)] += 1

    def _sample(self, named: NamedQuantity, number: int, row: Row) -> SensedSample:
        """Return the sample of a row; raise Refused for one that repeats the row before."""
        stamp_ns = named.time.stamp_ns(number, row)
        if stamp_ns == self._newest_ns.get(named.name):
            raise Refused("it has the time of the row before")
        sample = named.quantity(stamp_ns, row)
        self._newest_ns[named.name] = stamp_ns
        return sample

    def finish(self) -> None:
        """Note how many rows each ``where`` chose: a damaged row may fit none."""
        rows = self.contents.read[_ROW]
        for named in self._columns.quantities:
            fitting = self._fitting[named.name]
            if named.where and not fitting:
                self.contents.refused[named.name, f"no row fits {named.name}.where"] = rows
            elif named.where:
                self.contents.notes.append(f"{named.name}: {fitting} of {rows} rows fit its where")


def _rows(path: Path, layout: Layout) -> Iterator[list[str]]:
    """Yield the rows, the header first, without empty lines and comments.

    A title in quotes may have several lines. A row is one line, so that a quote left open in a
    damaged line costs no other row.
    """
    encoding = encoding_of(first_bytes(path, 2, LogError))
    with reading(path, LogError), path.open(encoding=encoding, errors=WINDOWS, newline="") as file:
        # csv of Python 3.10 stops at a zero byte; leaving it out would join the digits around it
        lines = (line.replace("\0", "?") for line in islice(file, layout.skip, None))
        lines = (line for line in lines if line.strip())
        if layout.comment:
            lines = (line for line in lines if not line.startswith(layout.comment))
        if layout.separator == " ":
            yield from (line.split() for line in lines)
            return
        try:
            if layout.header:
                yield next(csv.reader(lines, delimiter=layout.separator), [])
            for line in lines:
                yield next(csv.reader([line], delimiter=layout.separator))
        except csv.Error as error:
            raise LogError(f"{path}: not a table: {error}") from None


def _values(path: Path, layout: Layout) -> Iterator[list[str]]:
    """Yield the rows without the header, with decimal points."""
    rows = islice(_rows(path, layout), int(layout.header), None)
    if layout.decimal_comma:
        return ([cell.replace(",", ".") for cell in row] for row in rows)
    return rows


class TimeColumns:
    """Convert the cells of a row to ns of Unix time (UTC), exactly."""

    def __init__(self, keys: Keys, log: Log) -> None:
        self._log = log
        self._counts = keys.choice("counts", (*_NUMBERS, *_WRITTEN))
        self._is_written = self._counts in _WRITTEN
        self._cell = keys.cell("column", 1.0 if self._is_written else keys.unit("time"))
        self._week = keys.cell("week") if self._counts == "week" else None
        has_date = (self._counts == "start" or self._is_written) and "date" in keys
        self._date = keys.cell("date") if has_date else None
        self._start_ns = 0  # UTC at which counts since the log's start are zero
        self._contradicting = set[int]()  # rows whose date and count contradict most others
        keys.finish()

    def prepare(self, rows: Iterable[tuple[int, Row]]) -> None:
        """Find the UTC of the log's start, if times count from it. Raise LogError without a date.

        Dates have whole seconds: each bounds the start to a second, and all of them together to
        less; the middle of that is taken. Rows that contradict most others do not count.
        """
        if self._counts != "start":
            return
        if self._date is None:
            if self._log.options.start_ns is None:
                raise LogError(
                    f"{self._log.path}: its times count from the log's start: give the UTC of the "
                    "first row as --start-time"
                )
            counts = (count_ns for _, _, count_ns in self._numbered_counts(rows))
            self._start_ns = self._log.options.start_ns - first_count(counts)
            return
        begins = {
            number: written.local_ns - count_ns
            for number, row, count_ns in self._numbered_counts(rows)
            if (written := written_time(self._date.text(row)))
        }
        if not begins:
            column = f"{self._date.column}: {self._date.label}"
            raise LogError(f"{self._log.path}: no date in column {column}")
        first_ns, last_ns = largest_group(begins.values())
        self._start_ns = (first_ns + last_ns + SECOND_NS) // 2
        self._contradicting = {n for n, ns in begins.items() if not first_ns <= ns <= last_ns}

    def stamp_ns(self, number: int, row: Row) -> int:
        """Return the time of a row with its number; raise Refused if it has none."""
        if self._is_written:
            return self._written_ns(row)
        count_ns = self._count_ns(row)
        if self._week is not None:
            week = int(self._week.of(row))
            if week < 1024:
                raise Refused(f"{self._week.label} is below 1024: name the column of full weeks")
            return utc_ns_of_week(week, count_ns)
        if self._counts == "start":
            if number in self._contradicting:
                raise Refused("its date and count contradict those of most rows")
            return self._start_ns + count_ns
        epoch_ns = GPS_EPOCH_NS if self._counts == "gps" else 0
        return count_ns if self._counts == "utc" else utc_ns(epoch_ns + count_ns)

    def _count_ns(self, row: Row) -> int:
        """Return the count of a row, by decimal arithmetic."""
        with suppress(ArithmeticError):
            number = Decimal(self._cell.text(row)) * int(self._cell.factor)
            if number.is_finite() and abs(number) < LAST_NS:
                return round(number)
        raise self._cell.no_number(row)

    def _written_ns(self, row: Row) -> int:
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
        return self._log.options.utc_ns(written, self._log.path)

    def _numbered_counts(self, rows: Iterable[tuple[int, Row]]) -> Iterator[tuple[int, Row, int]]:
        """Yield the rows that have a count; the others are refused when they are read again."""
        for number, row in rows:
            with suppress(Refused):
                yield number, row, self._count_ns(row)


@dataclass(frozen=True)
class Layout:
    """Hold how a table is written."""

    header: bool = True  # else columns are numbers
    separator: str = ","
    skip: int = 0  # lines before the header
    comment: str = ""  # first characters of lines that are skipped; empty: none
    ragged: bool = False  # rows may be shorter than most
    decimal_comma: bool = False  # 9,81 is a number


class NamedQuantity(NamedTuple):
    """Hold a quantity with its key, its times, and the conditions that its rows fulfil."""

    name: str
    quantity: Quantity
    time: TimeColumns
    where: tuple[Callable[[Row], bool], ...]


class Columns:
    """Hold the contents of a columns file. Raise LogError or ConfigError naming file and key."""

    def __init__(self, path: Path, log: Log) -> None:
        self.path, self._log = path, log
        self.cells: list[Cell] = []
        keys = Keys(str(path), load_yaml(path), self.cells)
        self.layout = _layout(keys.inner("table")) if "table" in keys else Layout()
        self._time = TimeColumns(keys.inner("time"), log) if "time" in keys else None
        self.quantities = [self._quantity(name, keys) for name in QUANTITIES if name in keys]
        keys.finish()
        if not self.quantities:
            raise LogError(f"{path}: none of {', '.join(QUANTITIES)} is in it; see {TEMPLATE}")
        for cell in self.cells:
            if isinstance(cell.column, int) is self.layout.header:
                raise LogError(
                    f"{path}: {cell.label}: {cell.column!r}: a number is for tables without a "
                    "header (table: {header: false}), a name for those with one"
                )

    def _quantity(self, name: str, keys: Keys) -> NamedQuantity:
        inner = keys.inner(name)
        time = TimeColumns(inner.inner("time"), self._log) if "time" in inner else self._time
        if time is None:
            raise LogError(f"{self.path}: time is missing: give time for all, or {name}.time")
        where = _where(inner.inner("where")) if "where" in inner else ()
        quantity = NamedQuantity(name, QUANTITIES[name](inner, self._log), time, where)
        inner.finish()
        return quantity

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
    values = {name: keys.value(name, *kinds[name]) for name in kinds if name in keys}
    if values.get("skip", 0) < 0:
        raise LogError(f"{keys.place}.skip: {values['skip']} is not a number of lines")
    separator = _SEPARATORS[keys.choice("separator", list(_SEPARATORS), "comma")]
    decimal_comma = keys.choice("decimal", ("point", "comma"), "point") == "comma"
    keys.finish()
    return Layout(separator=separator, decimal_comma=decimal_comma, **values)


def _where(keys: Keys) -> tuple[Callable[[Row], bool], ...]:
    """Return the conditions of a mapping from columns (names or numbers) to values."""
    columns = {name: int(name) if name.isdecimal() else name for name in keys.names()}
    return tuple(matching(keys.added(name, at), keys.values(name)) for name, at in columns.items())

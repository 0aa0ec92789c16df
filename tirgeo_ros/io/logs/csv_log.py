"""Read a table (CSV) whose columns a columns file explains."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.files.whole_files import WINDOWS, encoding_of
from tirgeo_ros.io.logs.columns_file import Columns, Layout, NamedQuantity
from tirgeo_ros.io.logs.columns_quantities import prepare
from tirgeo_ros.io.logs.log_contents import LogContents, LogOptions, Refused
from tirgeo_ros.io.messages import SensedSample

_ROW = "row"
_LOOKED_AT = 200  # rows by which the usual number of columns is known
#: More repeats of an IMU's six values than these are no chance.
_REPEATS = 0.02


def read_csv(path: Path, options: LogOptions) -> LogContents:
    """Read a table as ``options.columns`` says. Raise LogError or ConfigError."""
    if options.columns is None:
        raise LogError(f"{path}: say what its columns mean with --columns")
    columns = Columns(options.columns)
    if columns.layout.header:
        columns.bind(next(_rows(path, columns.layout), []), path)
    width = 0 if columns.layout.ragged else _usual_width(path, columns.layout)
    for time in dict.fromkeys(one.time for one in columns.quantities):
        whole = (row for row in _values(path, columns.layout) if len(row) >= width)
        time.prepare(whole, path, options)
    for one in columns.quantities:
        prepare(one.quantity, path, options)
    table = _Table(columns, width)
    for row in _values(path, columns.layout):
        table.take(row)
    table.finish()
    return table.contents


class _Table:
    """Convert rows to samples, and count what they are."""

    def __init__(self, columns: Columns, width: int) -> None:
        self.contents = LogContents()
        self._columns, self._width = columns, width
        self._fitting: Counter[str] = Counter()
        self._newest_ns: dict[str, int] = {}
        self._imu_before = b""
        self._imu_rows = self._imu_repeats = 0

    def take(self, row: list[str]) -> None:
        """Take a row."""
        self.contents.read[_ROW] += 1
        if len(row) < self._width:
            self.contents.refused[_ROW, "it has fewer columns than the others"] += 1
            return
        for one in self._columns.quantities:
            if one.is_in(row):
                self._fitting[one.name] += 1
                self._convert(one, row)

    def _convert(self, one: NamedQuantity, row: list[str]) -> None:
        try:
            sample = self._sample(one, row)
        except Refused as why:
            self.contents.refused[one.name, str(why)] += 1
            return
        self.contents.samples.append(sample)
        if isinstance(sample, ImuSample):
            values = sample.specific_force_b.tobytes() + sample.angular_rate_b.tobytes()
            self._imu_rows += 1
            self._imu_repeats += values == self._imu_before
            self._imu_before = values

    def _sample(self, one: NamedQuantity, row: list[str]) -> SensedSample:
        """Return the sample of a row; raise Refused for one that is held from the row before."""
        stamp_ns = one.time.stamp_ns(row)
        if stamp_ns == self._newest_ns.get(one.name):
            raise Refused("it has the time of the row before")
        sample = one.quantity.sample(stamp_ns, row)
        self._newest_ns[one.name] = stamp_ns
        return sample

    def finish(self) -> None:
        """Say which quantities ``where`` left empty, and whether the IMU was polled too fast."""
        rows = self.contents.read[_ROW]
        for one in self._columns.quantities:
            fitting = self._fitting[one.name]
            if one.where and not fitting:
                self.contents.refused[one.name, f"no row fits {one.name}.where"] = rows
            elif one.where:
                self.contents.notes.append(f"{one.name}: {fitting} of {rows} rows fit its where")
        if self._imu_repeats > _REPEATS * self._imu_rows:
            self.contents.notes.append(
                f"{self._imu_repeats} of {self._imu_rows} IMU rows repeat the one before, as "
                "when it is read faster than it measures"
            )


def _rows(path: Path, layout: Layout) -> Iterator[list[str]]:
    """Yield the rows, the header first, without empty lines and comments.

    A title in quotes may have several lines. A row has one: a quote that a damaged line does not
    close costs no other.
    """
    try:
        with path.open("rb") as binary:
            encoding = encoding_of(binary.read(2))
        with path.open(encoding=encoding, errors=WINDOWS, newline="") as file:
            # csv of Python 3.10 stops at a zero byte; it must not join the digits around it either
            lines = (line.replace("\0", "?") for line in islice(file, layout.skip, None))
            lines = (line for line in lines if line.strip())
            if layout.comment:
                lines = (line for line in lines if not line.startswith(layout.comment))
            if layout.separator == " ":
                yield from (line.split() for line in lines)
                return
            if layout.header:
                yield next(csv.reader(lines, delimiter=layout.separator), [])
            for line in lines:
                yield next(csv.reader([line], delimiter=layout.separator))
    except OSError as error:
        raise LogError(f"{path}: cannot be read: {error.strerror or error}") from None
    except csv.Error as error:
        raise LogError(f"{path}: not a table: {error}") from None


def _values(path: Path, layout: Layout) -> Iterator[list[str]]:
    """Yield the rows without the header, with decimal points."""
    rows = islice(_rows(path, layout), int(layout.header), None)
    if layout.decimal_comma:
        return ([cell.replace(",", ".") for cell in row] for row in rows)
    return rows


def _usual_width(path: Path, layout: Layout) -> int:
    """Return the number of columns that most of the first rows have."""
    counts = Counter(map(len, islice(_values(path, layout), _LOOKED_AT)))
    return max(counts, key=counts.__getitem__, default=0)

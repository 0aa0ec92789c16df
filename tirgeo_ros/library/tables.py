"""Read columns of tables: dicts of arrays, NumPy structured arrays, data frames of any library.

A table gives its columns by name (``table["stamp_ns"]``), all of one length. pandas is not needed:
whatever has ``columns`` or can be iterated over its names is taken.
"""

from __future__ import annotations

import difflib
import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import TableError

#: A dict of 1-D arrays or lists, a structured array, or a data frame.
Table: TypeAlias = Any

STAMP, ARRIVAL, ORDER = "stamp_ns", "arrival_ns", "arrival_order"
_WHOLE = (
    "must be whole nanoseconds (int64 or datetime64), for a float resolves 256 ns today: "
    "(seconds * 1e9).round().astype('int64')"
)


class Column(NamedTuple):
    """Describe a column of numbers; without a ``default`` a table must have it.

    ``others`` are columns that may stand in its place: name -> conversion of its values. Columns
    whose default is nan belong together: a table has all of them or none. Values beyond
    ``largest`` are warned of: they look like degrees.
    """

    name: str
    meaning: str  # with unit and axis
    default: float | None = None
    others: Mapping[str, Callable[[Any], Any]] = {}
    largest: float = math.inf

    @property
    def is_of_group(self) -> bool:
        """Return whether a table has it with others or not at all."""
        return self.default is not None and math.isnan(self.default)


_TIME = Column(STAMP, "time of measurement, ns, int64")


class Numbers(NamedTuple):
    """Hold what was read of a table: stamps, times of arrival, and the other columns."""

    stamps_ns: IntArray  # (n,)
    arrivals_ns: IntArray  # (n,) the stamps, where the table has no arrival_ns
    order: IntArray  # (n,) among samples that arrived at one time
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
        warnings.warn(f"{text}: a filter refuses them", stacklevel=2)
    return Numbers(stamps_ns, arrivals_ns, order, rows)


def is_frame(table: Table) -> bool:
    """Return whether a table is a data frame, which a dict of arrays can be made into."""
    return hasattr(table, "columns") and not isinstance(table, Mapping)


def check_unmasked(name: str, values: Any) -> None:
    """Raise TableError for masked values, which NumPy would take as they are below the mask."""
    if np.ma.is_masked(values):
        number = int(np.ma.getmaskarray(values).sum())
        raise TableError(f"{name} has {number} masked values: leave out their rows")


def _names(name: str, table: Table) -> list[str]:
    fields = getattr(getattr(table, "dtype", None), "names", None)
    columns = fields or getattr(table, "columns", table if isinstance(table, Mapping) else None)
    if columns is None:
        raise TableError(
            f"{name}: {type(table).__name__} is no table: give a dict of arrays, a structured "
            "array or a data frame"
        )
    return [str(column) for column in columns]


def _check_presence(name: str, present: list[str], columns: Sequence[Column]) -> None:
    """Raise TableError for a column that is missing; the hint is at one that is no other's."""
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
    where, given = f"{name}: column {column}", table[column]
    check_unmasked(where, given)
    zoned = getattr(getattr(given, "dtype", None), "tz", None) is not None  # pandas; in UTC then
    values = np.asarray(given, "datetime64[ns]" if zoned else None)
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
    """Return the values (count,) of a column, of one in its place, or its default."""
    given = [text for text in (column.name, *column.others) if text in present]
    if len(given) > 1:
        raise TableError(f"{name}: columns {' and '.join(given)} say the same: leave one out")
    if not given:
        return np.full(count, column.default)
    where = f"{name}: column {given[0]}"
    check_unmasked(where, table[given[0]])
    try:
        values = np.asarray(table[given[0]], float)
    except (TypeError, ValueError):
        kind = _kind(np.asarray(table[given[0]]))
        raise TableError(f"{where} must be numbers; it is {kind}") from None
    if values.ndim != 1:
        raise TableError(f"{where} needs one number a row, has {_kind(values)}")
    _check_length(where, values, count)
    if given[0] in column.others:
        return np.asarray(column.others[given[0]](values))
    # By their middle: a single one may be damaged.
    sizes = np.abs(values[np.isfinite(values)])
    if sizes.size and (middle := np.median(sizes)) > column.largest:
        degrees = column.name.replace("_rad", "_deg")
        text = f"{where} has values like {middle:.4g}: if they are degrees, name it {degrees}"
        warnings.warn(text, stacklevel=2)
    return values


def _check_length(where: str, values: Any, count: int | None) -> None:
    if count is not None and len(values) != count:
        raise TableError(f"{where} has {len(values)} rows, {STAMP} has {count}")


def _kind(values: Any) -> str:
    return f"{values.dtype} of shape {values.shape}"

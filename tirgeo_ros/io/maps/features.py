"""Convert a table to features on the Earth: checked, in WGS84, labelled."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from tirgeo_ros.core.map.layers import GeoFeature
from tirgeo_ros.core.types.arrays import BoolArray, IntArray
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.io.coordinates.crs import ASSUMED, in_range, once_around, range_fault, to_wgs84
from tirgeo_ros.io.maps.gdal_tables import NAMES, Shapes, Table
from tirgeo_ros.io.maps.property_rules import Wanted, shown_value, table_names

_LONGEST_NAME = 40  # characters of a bad feature's name in a message
_MOST_NAMED = 3


@dataclass(frozen=True, slots=True)
class MapFeatures:
    """Hold the features of a table that are drawn, and notes on the others."""

    features: list[GeoFeature]
    notes: tuple[str, ...]  # a line each
    refusal: str | None  # why nothing of the table can be drawn ("": it is empty); None if it can


def laid(table: Table, wanted: Wanted, crs: str = "") -> MapFeatures:
    """Convert the features of a table to WGS84.

    ``crs`` takes precedence over the table's own system. A feature with a vertex that is not
    finite or not on the Earth is left out. Raises MapError for a system that is unknown,
    ConfigError for a label of an unknown field.
    """
    columns = wanted.label.columns(table.fields, table.where)
    given = set(table.shapes.feature.tolist()) | table.faults.keys()
    shapes, remarks = _on_earth(table, crs)
    shapes = _without_repeats(shapes, table.faults)
    texts = {
        i: wanted.label.text(columns, table.rows[i])
        for i in dict.fromkeys(shapes.feature.tolist())
    }
    features = [
        GeoFeature(texts[owner], closed, shapes.points[a:b], owner)
        for owner, closed, (a, b) in zip(
            shapes.feature.tolist(),
            shapes.closed.tolist(),
            itertools.pairwise(shapes.starts.tolist()),
            strict=True,
        )
    ]
    chosen, unmet = _chosen(features, table, wanted)
    bare = len(table.rows) - len(given)
    notes = [
        *table.notes,
        *_faults(table, texts),
        *([f"{table.where}: {bare} features without a geometry left out"] if bare else []),
        *remarks,
        *unmet,
    ]
    refusal = None if texts else _refusal(table)
    return MapFeatures(chosen, tuple(map(shown, notes)), refusal)


def _on_earth(table: Table, crs: str) -> tuple[Shapes, tuple[str, ...]]:
    """Return the shapes as latitude, longitude (rad), height (m), and remarks.

    Features off the Earth are left out. If most are, all are: the system is probably wrong.
    """
    shapes, faults = table.shapes, table.faults
    odd = ~np.isfinite(shapes.points[:, :2]).all(axis=1) | np.isinf(shapes.points[:, 2])
    x_y_z = "({:.6g}, {:.6g}, {:.6g}) is not finite"
    shapes = _without(shapes, odd, faults, lambda i: x_y_z.format(*table.shapes.points[i]))
    points = shapes.points
    remarks: tuple[str, ...] = ()
    system = crs or table.crs
    if system is not None:
        points, remarks = to_wgs84(points, system, table.where)
    elif len(points):
        remarks = (f"{table.where}: names no known system: {ASSUMED}",)
    bad = ~in_range(points)
    most = 2 * len(np.unique(_owner(shapes)[bad])) > len(np.unique(shapes.feature))

    def why(i: int) -> str:
        place = points[i] if np.isfinite(points[i, :2]).all() else shapes.points[i]
        return range_fault(place[0], place[1], all_are=most)

    left = _without(replace(shapes, points=points), bad, faults, why)
    if most:
        doubt = "its place is uncertain, since most others are not on the Earth"
        left = _without(left, np.ones(len(left.points), bool), faults, lambda _: doubt)
    x, y, z = left.points.T
    around = once_around(x)
    if (np.abs(around - x) > 1).any():
        remarks += (f"{table.where}: 360 is subtracted from longitudes beyond 180",)
    return replace(left, points=np.column_stack([np.radians(y), np.radians(around), z])), remarks


def _owner(shapes: Shapes) -> IntArray:
    """Return the feature of each point."""
    return np.repeat(shapes.feature, np.diff(shapes.starts))


def _without(
    shapes: Shapes, bad: BoolArray, faults: dict[int, str], why: Callable[[int], str]
) -> Shapes:
    """Return the shapes without features that have a bad point, which become faults."""
    if not bad.any():
        return shapes
    numbers, first = np.unique(_owner(shapes)[bad], return_index=True)
    for number, point in zip(numbers.tolist(), np.flatnonzero(bad)[first].tolist(), strict=True):
        faults.setdefault(number, why(point))
    return _selected(shapes, ~np.isin(shapes.feature, numbers))


def _selected(shapes: Shapes, keep: BoolArray) -> Shapes:
    """Return the parts selected by ``keep``."""
    sizes = np.diff(shapes.starts)
    starts = np.concatenate([[0], np.cumsum(sizes[keep])])
    points = shapes.points[np.repeat(keep, sizes)]
    return Shapes(points, starts, shapes.feature[keep], shapes.closed[keep])


def _without_repeats(shapes: Shapes, faults: dict[int, str]) -> Shapes:
    """Remove repeated vertices in a row; lines and rings of a single place become faults."""
    points = shapes.points
    part = np.repeat(np.arange(len(shapes.feature)), np.diff(shapes.starts))
    same = (points[1:] == points[:-1]) | (np.isnan(points[1:]) & np.isnan(points[:-1]))
    keep = np.ones(len(points), bool)
    keep[1:] = ~same.all(axis=1) | (part[1:] != part[:-1])
    before, after = np.diff(shapes.starts), np.bincount(part[keep], minlength=len(shapes.feature))
    flat = (after == 1) & (before > 1)
    for number in shapes.feature[flat].tolist():
        faults.setdefault(number, "a line without length")
    starts = np.concatenate([[0], np.cumsum(after)])
    return _selected(replace(shapes, points=points[keep], starts=starts), ~flat)


def _faults(table: Table, drawn: Collection[int]) -> Iterator[str]:
    """Yield a line for each of the first features at fault, and one for the rest."""
    first = sorted(table.faults)[:_MOST_NAMED]
    for number in first:
        part = "part of " if number in drawn else ""
        yield f"{table.where}: {part}{_fault(table, number)}; left out"
    more = len(table.faults) - len(first)
    if more:
        yield f"{table.where}: {more} more features left out, wholly or in part"


def _refusal(table: Table) -> str:
    """Return why nothing of a table can be drawn; "" if no feature is at fault."""
    count = len(table.faults)
    if not count:
        return ""
    rest = f" (none of {count} features can be drawn)" if count > 1 else ""
    return f"{table.where}: {_fault(table, min(table.faults))}{rest}"


def _fault(table: Table, number: int) -> str:
    """Return a feature's number, name or id, and fault."""
    names = filter(None, table_names(NAMES, table.fields))
    texts = (shown_value(table.rows[number].get(name)) for name in names)
    name = next(filter(None, texts), "")[:_LONGEST_NAME]
    return f"feature {number + 1}{f' ({name})' if name else ''}: {table.faults[number]}"


def _chosen(
    features: list[GeoFeature], table: Table, wanted: Wanted
) -> tuple[list[GeoFeature], tuple[str, ...]]:
    """Return the features that meet the condition, and notes.

    There are notes if no feature meets it, or if it names an unknown property.
    """
    condition = wanted.condition
    if condition is None or not features:
        return features, ()
    columns = condition.columns(table.fields)
    chosen = [f for f in features if condition.holds(columns, table.rows[f.group])]
    told = tuple(condition.unknown(table.fields, table.where))
    if not chosen and not told:
        told = (condition.unmet(table.fields, table.rows, table.where),)
    return chosen, told

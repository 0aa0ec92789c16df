"""Convert a table to features on the Earth: checked, in WGS84, labelled."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tirgeo_ros.core.map.layers import GeoFeature
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.io.coordinates.crs import ASSUMED, in_range, once_around, range_fault, to_wgs84
from tirgeo_ros.io.maps.feature_faults import Faults
from tirgeo_ros.io.maps.label_rule import LabelRule
from tirgeo_ros.io.maps.style_condition import Condition, Wanted
from tirgeo_ros.io.maps.table import Shapes, Table

_LONGEST_NAME = 40  # characters of a bad feature's name in a message


@dataclass(frozen=True, slots=True)
class MapFeatures:
    """Hold the features of a table that are drawn, and notes on the others."""

    features: list[GeoFeature]
    notes: tuple[str, ...]  # a line each
    refusal: str | None  # why nothing of the table can be drawn; None if something can


def laid(table: Table, wanted: Wanted, crs: str = "") -> MapFeatures:
    """Convert the features of a table to WGS84.

    ``crs`` takes precedence over the table's own system. A feature with a vertex that is not
    finite or not on the Earth is left out. Raises MapError for a system that is unknown,
    ConfigError for a label of an unknown field.
    """
    columns = wanted.label.columns(table.fields, table.where)
    shapes, remarks = _on_earth(table, crs)
    shapes = _without_repeats(shapes, table.faults)
    texts = {
        i: wanted.label.text(columns, table.properties[i])
        for i in dict.fromkeys(shapes.feature.tolist())
    }

    def name(number: int) -> str:
        """Return a feature's name for messages: its label, or else its name or id."""
        row = table.properties[number]
        label = wanted.label.text(columns, row)
        for rule in map(LabelRule.of_field, ("name", "id")):
            label = label or rule.text(rule.columns(row, ""), row)
        return label[:_LONGEST_NAME]

    bad = table.faults.notes(table.where, name, texts)
    features, unmet = _chosen(_features(shapes, texts), table, wanted.condition)
    notes = (*table.left_out, *bad, *_bare(table), *remarks, *unmet)
    refusal = table.faults.refusal(table.where, name) or table.empty
    return MapFeatures(features, tuple(map(shown, notes)), None if texts else refusal)


def _bare(table: Table) -> tuple[str, ...]:
    """Return a note on features without a geometry, which most formats allow."""
    told = table.faults.numbers.union(table.shapes.feature.tolist())
    bare = len(table.properties) - len(told) - table.set_aside
    return (f"{table.where}: {bare} features without a geometry left out",) if bare else ()


def _on_earth(table: Table, crs: str) -> tuple[Shapes, tuple[str, ...]]:
    """Return the shapes in WGS84, without those of bad features; and remarks.

    The points become latitude, longitude (rad), height (m).
    """
    shapes = _finite(table)
    points = shapes.points
    remarks: tuple[str, ...] = ()
    system = crs or table.crs
    if system is not None:
        points, remarks = to_wgs84(points, system, table.where)
    elif table.no_crs and len(points):
        remarks = (f"{table.where}: {table.no_crs}: {ASSUMED}",)
    shapes = _in_range(shapes, points, table.faults)
    x, y, z = shapes.points.T
    around = once_around(x)
    if (np.abs(around - x) > 1).any():
        remarks += (f"{table.where}: longitudes beyond 180 are taken as those less 360",)
    place = np.column_stack([np.radians(y), np.radians(around), z])
    return replace(shapes, points=place), remarks


def _finite(table: Table) -> Shapes:
    # z is nan where there is none: readers refuse a nan that a file has as z.
    points = table.shapes.points
    bad = ~np.isfinite(points[:, :2]).all(axis=1) | np.isinf(points[:, 2])
    numbers = "({:.6g}, {:.6g}, {:.6g}) is not finite"
    return _without(table.shapes, bad, table.faults, lambda i: numbers.format(*points[i]))


def _in_range(shapes: Shapes, points: Array, faults: Faults) -> Shapes:
    """Return the shapes at other points (deg), without features that are off the Earth.

    If most are off it, all are left out: the coordinate system is probably wrong.
    """
    bad = ~in_range(points)
    most = 2 * len(np.unique(_owner(shapes)[bad])) > len(np.unique(shapes.feature))

    def why(point: int) -> str:
        place = points[point] if np.isfinite(points[point, :2]).all() else shapes.points[point]
        return range_fault(place[0], place[1], all_are=most)

    left = _without(replace(shapes, points=points), bad, faults, why)
    if not most:
        return left
    doubt = "its place is in doubt, as most others are off the Earth"
    return _without(left, np.ones(len(left.points), bool), faults, lambda _: doubt)


def _owner(shapes: Shapes) -> IntArray:
    """Return the feature of each point."""
    return np.repeat(shapes.feature, np.diff(shapes.starts))


def _without(shapes: Shapes, bad: BoolArray, faults: Faults, why: Callable[[int], str]) -> Shapes:
    """Return the shapes without features that have a bad point, which become faults."""
    if not bad.any():
        return shapes
    numbers, first = np.unique(_owner(shapes)[bad], return_index=True)
    for number, point in zip(numbers.tolist(), np.flatnonzero(bad)[first].tolist(), strict=True):
        faults.add(number, why(point))
    return _selected(shapes, ~np.isin(shapes.feature, numbers))


def _selected(shapes: Shapes, keep: BoolArray) -> Shapes:
    """Return the parts selected by ``keep``."""
    sizes = np.diff(shapes.starts)
    starts = np.concatenate([[0], np.cumsum(sizes[keep])])
    points = shapes.points[np.repeat(keep, sizes)]
    return Shapes(points, starts, shapes.feature[keep], shapes.closed[keep])


def _without_repeats(shapes: Shapes, faults: Faults) -> Shapes:
    """Remove repeated vertices in a row; lines and rings of a single place become faults."""
    points = shapes.points
    if not len(points):
        return shapes
    part = np.repeat(np.arange(len(shapes.feature)), np.diff(shapes.starts))
    same = (points[1:] == points[:-1]) | (np.isnan(points[1:]) & np.isnan(points[:-1]))
    keep = np.concatenate([[True], ~same.all(axis=1) | (part[1:] != part[:-1])])
    before, after = np.diff(shapes.starts), np.bincount(part[keep], minlength=len(shapes.feature))
    flat = (after == 1) & (before > 1)
    for number in shapes.feature[flat].tolist():
        faults.add(number, "a line of no length")
    starts = np.concatenate([[0], np.cumsum(after)])
    return _selected(replace(shapes, points=points[keep], starts=starts), ~flat)


def _features(shapes: Shapes, texts: Mapping[int, str]) -> list[GeoFeature]:
    owners = shapes.feature.tolist()
    ends = itertools.pairwise(shapes.starts.tolist())
    return [
        GeoFeature(texts[owner], closed, shapes.points[a:b], owner)
        for owner, closed, (a, b) in zip(owners, shapes.closed.tolist(), ends, strict=True)
    ]


def _chosen(
    features: list[GeoFeature], table: Table, condition: Condition | None
) -> tuple[list[GeoFeature], tuple[str, ...]]:
    """Return the features that meet a condition, and notes.

    There are notes if no feature meets it, or if it names an unknown property.
    """
    if condition is None or not features:
        return features, ()
    columns = condition.columns(table.fields)
    rows = table.properties
    chosen = [f for f in features if condition.holds(columns, rows[f.group])]
    told = tuple(condition.unknown(table.fields, table.where))
    if not chosen and not told:
        told = (condition.unmet(table.fields, rows, table.where),)
    return chosen, told

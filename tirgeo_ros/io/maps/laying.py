"""From a table to features on the Earth: checked, in WGS84, labelled."""

from __future__ import annotations

import itertools

import numpy as np

from tirgeo_ros.core.errors import MapError
from tirgeo_ros.core.map_layers import GeoFeature
from tirgeo_ros.core.polylines import BoolArray, IntArray
from tirgeo_ros.core.samples import Array
from tirgeo_ros.io.crs import in_range, range_error, to_wgs84
from tirgeo_ros.io.label_rule import LabelRule
from tirgeo_ros.io.maps.table import Shapes, Table


def laid(table: Table, rule: LabelRule, crs: str = "") -> tuple[list[GeoFeature], tuple[str, ...]]:
    """The features of a table, and remarks on what of it they are not.

    ``crs`` stands above what the table says of its system. Raises MapError, naming the feature,
    for a vertex that is not finite or not on the Earth; ConfigError for a label of an unknown
    field.
    """
    shapes = table.shapes
    _check_finite(shapes, table.where)
    points = shapes.points
    remarks: tuple[str, ...] = ()
    system = crs or table.crs
    if system is None and table.no_crs:
        remarks = (f"{table.where}: {table.no_crs}: taken for WGS84",)
    elif system is not None:
        points, remarks = to_wgs84(points, system, table.where)
    _check_range(shapes, points, table.where)
    shapes, dropped = _without_repeats(Shapes(_radians(points), *_parts(shapes)))
    told = (f"{table.where}: {dropped} lines of no length left out",) if dropped else ()
    return _features(shapes, table, rule), (*table.left_out, *_bare(table), *remarks, *told)


def _bare(table: Table) -> tuple[str, ...]:
    """What to tell of features without a geometry, which most formats allow."""
    bare = len(table.properties) - len(np.unique(table.shapes.feature)) - table.set_aside
    return (f"{table.where}: {bare} features without a geometry left out",) if bare else ()


def _parts(shapes: Shapes) -> tuple[IntArray, IntArray, BoolArray]:
    return shapes.starts, shapes.feature, shapes.closed


def _check_finite(shapes: Shapes, where: str) -> None:
    # z is nan where there is none: readers refuse a nan that stands in a file's z.
    bad = ~np.isfinite(shapes.points[:, :2]).all(axis=1) | np.isinf(shapes.points[:, 2])
    if bad.any():
        first = int(np.argmax(bad))
        x, y, z = shapes.points[first]
        at = f"{where}: feature {_feature_of(shapes, first) + 1}"
        raise MapError(f"{at}: ({x:.6g}, {y:.6g}, {z:.6g}) is not finite")


def _check_range(shapes: Shapes, points: Array, where: str) -> None:
    right = in_range(points)
    if not right.all():
        first = int(np.argmin(right))
        x, y = (
            points[first, :2] if np.isfinite(points[first, :2]).all() else shapes.points[first, :2]
        )
        raise range_error(f"{where}: feature {_feature_of(shapes, first) + 1}", x, y)


def _feature_of(shapes: Shapes, point: int) -> int:
    return int(shapes.feature[np.searchsorted(shapes.starts, point, "right") - 1])


def _radians(points: Array) -> Array:
    """Longitude, latitude (deg), height as latitude, longitude (rad), height."""
    return np.column_stack([np.radians(points[:, 1]), np.radians(points[:, 0]), points[:, 2]])


def _without_repeats(shapes: Shapes) -> tuple[Shapes, int]:
    """No vertex twice running; lines and rings of one place are dropped, and counted."""
    points = shapes.points
    if not len(points):
        return shapes, 0
    part = np.repeat(np.arange(len(shapes.feature)), np.diff(shapes.starts))
    same = (points[1:] == points[:-1]) | (np.isnan(points[1:]) & np.isnan(points[:-1]))
    keep = np.concatenate([[True], ~same.all(axis=1) | (part[1:] != part[:-1])])
    before, after = np.diff(shapes.starts), np.bincount(part[keep], minlength=len(shapes.feature))
    flat = (after == 1) & (before > 1)
    keep &= ~flat[part]
    starts = np.concatenate([[0], np.cumsum(after[~flat])])
    left = Shapes(points[keep], starts, shapes.feature[~flat], shapes.closed[~flat])
    return left, int(np.count_nonzero(flat))


def _features(shapes: Shapes, table: Table, rule: LabelRule) -> list[GeoFeature]:
    columns = rule.columns(table.fields, table.where)
    owners = shapes.feature.tolist()
    texts = {i: rule.text(columns, table.properties[i]) for i in dict.fromkeys(owners)}
    ends = itertools.pairwise(shapes.starts.tolist())
    return [
        GeoFeature(texts[owner], closed, shapes.points[a:b], owner)
        for owner, closed, (a, b) in zip(owners, shapes.closed.tolist(), ends, strict=True)
    ]

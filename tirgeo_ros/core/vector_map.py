"""A map of lines, outlines and points, laid once into the map's tangent plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from tirgeo_ros.core.errors import ConfigError
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_layers import GeoFeature
from tirgeo_ros.core.polylines import BoolArray, IntArray, Polylines
from tirgeo_ros.core.samples import Array


def grounded(features: Sequence[GeoFeature], ground_height_m: float) -> list[GeoFeature]:
    """The features at ``ground_height_m``, or at their own heights where that is nan.

    Raises ConfigError if neither is known.
    """
    if math.isfinite(ground_height_m):
        return [_at_height(feature, ground_height_m) for feature in features]
    unknown = sum(not np.isfinite(feature.points[:, 2]).all() for feature in features)
    if unknown:
        raise ConfigError(
            f"map: {unknown} of {len(features)} features have no height; set ground_height_m "
            "(--ground-height) to the ellipsoidal height of the ground"
        )
    return list(features)


def _at_height(feature: GeoFeature, height_m: float) -> GeoFeature:
    points = np.array(feature.points, float)
    points[:, 2] = height_m
    return replace(feature, points=points)


@dataclass(frozen=True)
class VectorMap:
    """A map in the tangent plane: north, east, down from its origin, metres.

    ``lines`` and ``marks`` (3, V) are owned by indices of ``labels``, one for each feature of the
    map, and ``labelled`` says which are not empty; outlines are lines that end where they begin.
    ``centres`` and ``halves`` (3, lines) are the lines' bounding boxes.
    """

    labels: tuple[str, ...]
    labelled: BoolArray
    lines: Polylines
    marks: Polylines
    centres: Array
    halves: Array

    @classmethod
    def from_geodetic(
        cls,
        features: Sequence[GeoFeature],
        plane: TangentPlane,
        ground_height_m: float = math.nan,
    ) -> VectorMap:
        """Lay features into a plane; raises ConfigError where heights are unknown."""
        features = [f for f in grounded(features, ground_height_m) if len(f.points)]
        labels, owner = _owners(features)
        parts = [_closed(feature) for feature in features]
        lines = [i for i, part in enumerate(parts) if len(part) > 1]
        marks = [i for i, part in enumerate(parts) if len(part) == 1]
        laid = _laid([parts[i] for i in lines], owner[lines], plane)
        low, high = _bounds(laid)
        return cls(
            labels,
            np.array([bool(label) for label in labels], bool),
            laid,
            _laid([parts[i] for i in marks], owner[marks], plane),
            (low + high) / 2,
            (high - low) / 2,
        )


def _owners(features: Sequence[GeoFeature]) -> tuple[tuple[str, ...], IntArray]:
    """The labels, and for each feature the index of its own; a group has one together."""
    keys = [(f.group, -1) if f.group >= 0 else (-1, i) for i, f in enumerate(features)]
    index = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    labels = [""] * len(index)
    for key, feature in zip(keys, features, strict=True):
        labels[index[key]] = labels[index[key]] or feature.label
    return tuple(labels), np.array([index[key] for key in keys], np.int64)


def _closed(feature: GeoFeature) -> Array:
    points = feature.points
    if not feature.closed or len(points) < 2 or np.array_equal(points[0], points[-1]):
        return points
    return np.concatenate([points, points[:1]])


def _laid(parts: Sequence[Array], owner: IntArray, plane: TangentPlane) -> Polylines:
    starts = np.cumsum([0, *map(len, parts)], dtype=np.int64)
    geodetic = np.concatenate([np.empty((0, 3)), *parts])
    points_n = plane.ned_from_geodetic(*geodetic.T)
    return Polylines(np.ascontiguousarray(points_n.T), starts, owner)


def _bounds(lines: Polylines) -> tuple[Array, Array]:
    if not len(lines):
        return np.empty((3, 0)), np.empty((3, 0))
    begin = lines.starts[:-1]
    low = np.minimum.reduceat(lines.points, begin, axis=1)
    return low, np.maximum.reduceat(lines.points, begin, axis=1)

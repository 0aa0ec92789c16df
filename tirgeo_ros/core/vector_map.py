"""A map of lines, outlines and points, laid once into the map's tangent plane."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np

from tirgeo_ros.core.errors import ConfigError
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_layers import GeoFeature, MapLayer
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
    ``layers`` are in the order of drawing, without their features; ``layer`` (features,) is the
    one to which a feature belongs, and never falls from one feature to the next.
    ``centres`` and ``halves`` (3, lines) are the lines' bounding boxes.
    """

    labels: tuple[str, ...]
    labelled: BoolArray
    layers: tuple[MapLayer, ...]
    layer: IntArray
    lines: Polylines
    marks: Polylines
    centres: Array
    halves: Array

    @classmethod
    def from_layers(
        cls, layers: Sequence[MapLayer], plane: TangentPlane, ground_height_m: float = math.nan
    ) -> VectorMap:
        """Lay layers into a plane; raises ConfigError where heights are unknown."""
        of_layers = [
            [f for f in grounded(layer.features, ground_height_m) if len(f.points)]
            for layer in layers
        ]
        labels, layer, owner = _owners(of_layers)
        parts = [_closed(feature) for features in of_layers for feature in features]
        lines = [i for i, part in enumerate(parts) if len(part) > 1]
        marks = [i for i, part in enumerate(parts) if len(part) == 1]
        laid = _laid([parts[i] for i in lines], owner[lines], plane)
        low, high = _bounds(laid)
        return cls(
            labels,
            np.array([bool(label) for label in labels], bool),
            tuple(replace(layer, features=()) for layer in layers),
            layer,
            laid,
            _laid([parts[i] for i in marks], owner[marks], plane),
            (low + high) / 2,
            (high - low) / 2,
        )

    @classmethod
    def from_geodetic(
        cls,
        features: Sequence[GeoFeature],
        plane: TangentPlane,
        ground_height_m: float = math.nan,
    ) -> VectorMap:
        """Lay the features of one layer into a plane."""
        return cls.from_layers([MapLayer("", features)], plane, ground_height_m)


def _owners(
    of_layers: Sequence[Sequence[GeoFeature]],
) -> tuple[tuple[str, ...], IntArray, IntArray]:
    """The labels and layers of features, and for each part the index of its own.

    Parts of a layer's group are one feature.
    """
    keys = [
        (layer, f.group, -1) if f.group >= 0 else (layer, -1, i)
        for layer, features in enumerate(of_layers)
        for i, f in enumerate(features)
    ]
    index = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    labels = [""] * len(index)
    for key, feature in zip(keys, chain.from_iterable(of_layers), strict=True):
        labels[index[key]] = labels[index[key]] or feature.label
    layer = np.array([key[0] for key in index], np.int64)
    return tuple(labels), layer, np.array([index[key] for key in keys], np.int64)


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

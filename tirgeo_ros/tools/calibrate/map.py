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
"""Make a vector map from features digitised on an orthophoto: ``tirgeo calibrate map``."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.calibration.polynomial_transform import (
    PolynomialTransform,
    Residuals,
    fit_polynomial,
)
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import CalibrationError, MapError
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.files.bounded_reading import bounded_memory
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, reading, write_files
from tirgeo_ros.io.surveys.survey import ControlPoints, downward, load_control_points
from tirgeo_ros.tools.presentation.results import listed

#: Errors of reading coordinates from a value that is not a position.
_NO_POSITIONS = (KeyError, TypeError, ArithmeticError, ValueError, IndexError, RecursionError)
_LEFT_OUT = ("crs", "bbox")  # members of a feature that refer to its pixels
_GROSS = 4.0  # times the median residual: pure noise puts one point in 60000 this far out
_LEAST_GROSS_PX = 0.1  # a smaller residual is no mistake: nobody clicks more precisely
_NAMED = 5  # most points in a warning


def calibrate_map(
    vectors: PathLike,
    points: PathLike,
    output: PathLike,
    *,
    survey: PathLike | None = None,
    order: int = 3,
    crs: str | None = None,
) -> dict[str, object]:
    """Georeference features in pixels (GeoJSON) by control points; write GeoJSON in WGS84.

    ``points`` is a file ``id,column,row``, to be used with ``survey``, or a ``.points`` file of
    QGIS. Return a summary. Raise SurveyError, MapError, CalibrationError.
    """
    check_outputs((vectors, points, survey), (output,), MapError)
    marks = load_control_points(points, survey)
    plane = Plane(crs, marks.degrees)
    try:
        transform, residuals = fit_polynomial(marks.pixels, plane.metres(marks.degrees), order)
    except CalibrationError as error:
        raise CalibrationError(f"{points}: {error}") from None
    features = _features(vectors, transform)
    degrees = plane.degrees(transform(features.pixels))
    outside = ~transform.inside(features.pixels)
    write_files({output: features.geojson(degrees)}, MapError)
    jacobian = transform.jacobian(marks.pixels.mean(axis=0)[None])[0]
    warnings = _warnings(marks, transform, residuals, features, outside)
    return {
        "output": [os.fspath(output)],
        "order": order,
        "crs": plane.name,
        "points": len(marks.names),
        "mean_residual_px": float(residuals.lengths_px.mean()),
        "rms_residual_px": float(rms(residuals.lengths_px)),
        "mean_residual_m": float(residuals.lengths_m.mean()),
        "rms_residual_m": float(rms(residuals.lengths_m)),
        "rms_left_out_m": float(rms(residuals.left_out_m)),
        "sigma_m": residuals.sigma_m,
        "pixel_m": math.sqrt(abs(float(np.linalg.det(jacobian)))),  # at the points' mean
        "features": features.count,
        "features_outside": features.features_with(outside),
        "residuals": _rows(marks, residuals),
        "warning": "; ".join(warnings) or None,
    }


def _features(path: PathLike, transform: PolynomialTransform) -> PixelFeatures:
    """Return the features of a file; raise CalibrationError if the polynomial folds over."""
    features = PixelFeatures(path)
    folded = transform.folded(features.pixels)
    if folded.any():
        raise CalibrationError(
            f"{path}: the polynomial folds over at {features.features_with(folded)} of "
            f"{features.count} features, far from the control points; measure points there, "
            "leave these features out or lower --order"
        )
    return features


def _warnings(
    marks: ControlPoints,
    transform: PolynomialTransform,
    residuals: Residuals,
    features: PixelFeatures,
    outside: BoolArray,
) -> Iterator[str]:
    if outside.any():
        times = math.sqrt(float(transform.leverage(features.pixels[outside]).max()))
        sigma = f": up to {residuals.sigma_m * times:.2g} m (one sigma) by the points' own errors"
        worst = "" if math.isnan(residuals.sigma_m) else f"{sigma} alone"
        yield (
            f"{features.features_with(outside)} of {features.count} features reach outside "
            f"the hull of the control points, where the polynomial diverges{worst}"
        )
    if math.isnan(residuals.sigma_m):
        yield (
            f"{len(marks.names)} points leave no redundancy at order {transform.order}: "
            "their residuals are zero whatever their errors; measure more points"
        )
    else:
        # Residuals comparable between points: near the hull, a point pulls the fit to itself.
        scaled = np.sqrt(residuals.lengths_m * residuals.left_out_m)
        far = (scaled > _GROSS * np.median(scaled)) & (residuals.lengths_px > _LEAST_GROSS_PX)
        gross = [
            f"{marks.names[k]} ({residuals.left_out_m[k]:.2g} m)"
            for k in np.argsort(-scaled).tolist()
            if far[k]
        ]
        if gross:
            named = ", ".join(gross[:_NAMED])
            yield f"points that do not fit the others: {named}; check their ids and pixels"
    if marks.unused:
        yield f"points in only one of the two files, not used: {listed(marks.unused, _NAMED)}"


def _rows(marks: ControlPoints, residuals: Residuals) -> list[dict[str, Any]]:
    """Return the residuals of each point by column."""
    names = ("column", "row", "x_m", "y_m", "column_px", "row_px", "length_m", "length_px")
    lengths = residuals.lengths_m, residuals.lengths_px, residuals.left_out_m
    table = np.column_stack([marks.pixels, residuals.metres, residuals.pixels, *lengths])
    return [
        {"id": point} | dict(zip((*names, "left_out_m"), row, strict=True))
        for point, row in zip(marks.names, table.tolist(), strict=True)
    ]


class PixelFeatures:
    """Hold a FeatureCollection in pixels. Raise MapError naming file and feature."""

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._path = Path(path)
        try:
            with bounded_memory():
                self._features = self._read()
                self.pixels, self._owners = self._positions()
        except MemoryError:
            raise MapError(f"{path}: does not fit into memory; split the file") from None

    def _read(self) -> list[dict[str, Any]]:
        try:
            with reading(self._path, MapError):
                root = json.loads(self._path.read_text(encoding="utf-8-sig"))
        except (ValueError, RecursionError) as error:
            raise MapError(f"{self._path}: not GeoJSON: {error}") from None
        features = root.get("features") if isinstance(root, dict) else None
        if not isinstance(features, list) or not all(isinstance(f, dict) for f in features):
            raise MapError(f"{self._path}: not a GeoJSON FeatureCollection; export one in pixels")
        return features

    def _positions(self) -> tuple[Array, Array]:
        """Return the vertices (n, 2) of all features, and the numbers (n,) of their features."""
        pairs: list[tuple[float, float]] = []
        owners: list[int] = []
        for number, feature in enumerate(self._features, 1):
            try:
                _mapped(feature.get("geometry"), lambda place: pairs.append(_position(place)))
            except _NO_POSITIONS:
                raise MapError(
                    f"{self._path}: feature {number} has coordinates that are not column and row"
                ) from None
            owners += [number] * (len(pairs) - len(owners))
        return downward(np.array(pairs, float).reshape(-1, 2)), np.array(owners, int)

    @property
    def count(self) -> int:
        """Return the number of features."""
        return len(self._features)

    def features_with(self, vertices: BoolArray) -> int:
        """Return how many features have one of these vertices (n, bool)."""
        return len(np.unique(self._owners[vertices]))

    def geojson(self, degrees: Array) -> str:
        """Return the collection with the pixels replaced by longitude, latitude (n, 2), deg."""
        rest = iter(np.round(degrees, 9).tolist())
        features = [
            {
                **{key: value for key, value in feature.items() if key not in _LEFT_OUT},
                "geometry": _mapped(feature.get("geometry"), lambda _: next(rest)),
            }
            for feature in self._features
        ]
        root = {"type": "FeatureCollection", "features": features}
        return json.dumps(root, ensure_ascii=False) + "\n"


def _position(coordinates: Any) -> tuple[float, float]:
    column, row = float(coordinates[0]), float(coordinates[1])
    if not (math.isfinite(column) and math.isfinite(row)):
        raise ValueError
    return column, row


def _mapped(geometry: Any, change: Callable[[Any], Any]) -> Any:
    """Return a geometry with each position replaced by what ``change`` returns for it."""

    def each(coordinates: Any) -> Any:
        if coordinates and not isinstance(coordinates[0], list):
            return change(coordinates)
        return [each(part) for part in coordinates]

    if geometry is None:
        return None
    if geometry["type"] == "GeometryCollection":
        parts = [_mapped(part, change) for part in geometry["geometries"]]
        return {"type": "GeometryCollection", "geometries": parts}
    return {"type": geometry["type"], "coordinates": each(geometry["coordinates"])}

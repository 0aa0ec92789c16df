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
"""Set up the experiment: surveyed points, their observations, the plane of errors, the methods."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
import pyproj

from tirgeo_ros.core.config import METHODS
from tirgeo_ros.core.ground.backprojection import Ground, Terrain
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint, load_observations, load_survey
from tirgeo_ros.tools.presentation.results import listed
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs

#: Name of the paper's own method, ``ekf_heading``, with a boresight calibration.
CALIBRATED = "calibrated"
#: Above this latitude the zones are too narrow to be useful.
_MOST_LATITUDE_DEG = 84.0


@dataclass(frozen=True)
class Projection:
    """Project to a Gauss-Krueger plane: a transverse Mercator zone of 3 degrees, scale 1."""

    meridian_deg: float

    @property
    def name(self) -> str:
        """Return the name of the plane, for a person."""
        side = "W" if self.meridian_deg < 0 else "E"
        return f"Gauss-Krueger, 3-degree zone of {abs(self.meridian_deg):g} deg {side}, WGS84"

    @cached_property
    def _proj(self) -> Any:
        return pyproj.Proj(
            f"+proj=tmerc +lon_0={self.meridian_deg:g} +k=1 +x_0=500000 +ellps=WGS84 +units=m"
        )

    def project(self, latitude_rad: npt.ArrayLike, longitude_rad: npt.ArrayLike) -> Array:
        """Return east and north (..., 2), m, of positions (...)."""
        east, north = self._proj(np.degrees(longitude_rad), np.degrees(latitude_rad))
        return np.stack([np.asarray(east, float), np.asarray(north, float)], axis=-1)

    def local_axes(self, latitude_rad: float, longitude_rad: float) -> Array:
        """Return the matrix (2, 2) that converts north, east (m) at a point to the plane's axes.

        The plane's axes are east, north. The matrix is a rotation by the meridian convergence
        times the scale at the point.
        """
        factors = self._proj.get_factors(math.degrees(longitude_rad), math.degrees(latitude_rad))
        turn, scale = math.radians(factors.meridian_convergence), factors.meridional_scale
        sine, cosine = scale * math.sin(turn), scale * math.cos(turn)
        return np.array([[-sine, cosine], [cosine, sine]])


def projection_of(latitude_rad: Array, longitude_rad: Array) -> Projection:
    """Return the projection whose zone contains the middle of points (N,), N at least 1.

    Raise SurveyError if the points are too near a pole.
    """
    latitude_deg = math.degrees(float(np.mean(latitude_rad)))
    if abs(latitude_deg) > _MOST_LATITUDE_DEG:
        raise SurveyError(
            f"the survey lies at latitude {latitude_deg:.1f}: no transverse Mercator zone there"
        )
    # A mean of directions is right for points on both sides of 180 degrees too.
    middle = np.arctan2(np.sin(longitude_rad).mean(), np.cos(longitude_rad).mean())
    return Projection(3.0 * math.floor(math.degrees(float(middle)) / 3 + 0.5))


@dataclass(frozen=True)
class Experiment:
    """Hold the surveyed points by id, and all observations, also of points without a survey."""

    projection: Projection
    survey: Mapping[str, SurveyPoint]
    observations: Sequence[Observation]

    @property
    def heights_m(self) -> list[float]:
        """Return the ellipsoidal heights of the observed surveyed points, one for each point."""
        observed = {click.id for click in self.observations}
        return [point.height_m for name, point in self.survey.items() if name in observed]


def experiment_of(points: Sequence[SurveyPoint], clicks: Sequence[Observation]) -> Experiment:
    """Return the experiment in the projected plane of its survey. Raise SurveyError."""
    latitude, longitude = np.array([(p.latitude_rad, p.longitude_rad) for p in points]).T
    plane = projection_of(latitude, longitude)
    return Experiment(plane, {point.id: point for point in points}, clicks)


def load_experiment(
    survey: PathLike, observations: PathLike, stills: Mapping[str, int] = MappingProxyType({})
) -> Experiment:
    """Load survey and observations from files; these may name ``stills`` by their stamps (ns).

    Raise SurveyError, also if no surveyed point was observed.
    """
    experiment = experiment_of(load_survey(survey), load_observations(observations, stills))
    where, total = os.fspath(observations), len(experiment.observations)
    if not total:
        raise SurveyError(f"{where}: has no observations")
    if not experiment.heights_m:
        raise SurveyError(
            f"{where}: none of its {total} observations is of a point in {os.fspath(survey)}: "
            "use the same ids in both files"
        )
    return experiment


def input_notes(experiment: Experiment, image_stamps_ns: Sequence[int]) -> list[str]:
    """Return notes on mismatches of observations, survey and picture stamps (M,), if any."""
    clicks = experiment.observations
    names, total = Counter(click.id for click in clicks), len(clicks)
    unknown = [name for name in names if name not in experiment.survey]
    unobserved = [name for name in experiment.survey if name not in names]
    notes = []
    if unknown:
        notes.append(
            f"{sum(names[name] for name in unknown)} of {total} observations are left out: "
            f"their points are not in the survey: {listed(unknown)}"
        )
    if unobserved:
        notes.append(
            f"{len(unobserved)} surveyed points were never observed: {listed(unobserved)}"
        )
    images = np.array(sorted(image_stamps_ns), np.int64)
    apart_ns = [int(np.abs(images - click.stamp_ns).min()) for click in clicks if len(images)]
    if any(apart_ns):
        notes.append(
            f"{np.count_nonzero(apart_ns)} of {total} observations have the stamp of no "
            f"picture: they are up to {max(apart_ns) * 1e-9:.3g} s from the nearest one"
        )
    return notes


@dataclass(frozen=True)
class MethodSetup:
    """Hold a method with its parameters and the ground, which is the same for all methods."""

    method: str
    configs: NodeConfigs
    ground: Ground
    ground_words: str


def method_setups(
    params: Files,
    boresight: PathLike | None,
    namespace: str,
    survey_heights_m: Sequence[float],
    places: Mapping[str, Any],
) -> list[MethodSetup]:
    """Return the four methods of the paper and, with a boresight file, ``calibrated``.

    ``boresight`` overrides ``params``; ``places``, options of ``node_configs``, override both. If
    none of them gives a ground, it is level at the median of the survey's heights. Raise
    ConfigError, ElevationError.
    """
    methods = [(name, name, paths_of(params)) for name in METHODS]
    if boresight is not None:
        methods.append((CALIBRATED, "ekf_heading", [*paths_of(params), boresight]))
    configs = [node_configs(files, namespace, method=m, **places) for _, m, files in methods]
    overlay, median_m = configs[-1].overlay, float(median(survey_heights_m))
    ground = ground_of(overlay)
    if isinstance(ground, Terrain):
        words = f"elevation model {os.fspath(overlay.dem)}"
    elif ground is None:
        ground, words = median_m, f"level at {median_m:.3f} m, the survey's median"
        configs = [c._replace(overlay=replace(c.overlay, ground_height_m=ground)) for c in configs]
    else:
        words = f"level at {ground:.3f} m"
    pairs = zip(methods, configs, strict=True)
    return [MethodSetup(name, own, ground, words) for (name, *_), own in pairs]


def setup_notes(setups: Sequence[MethodSetup], survey_heights_m: Sequence[float]) -> list[str]:
    """Return notes on the ground and the methods."""
    notes: list[str] = []
    ground = setups[-1].ground
    if isinstance(ground, Terrain):
        notes += ground.notes
    elif math.isfinite(ground):
        off = [height - ground for height in survey_heights_m]
        notes.append(
            f"ground {setups[-1].ground_words}; the observed points are "
            f"{min(off):+.2f} to {max(off):+.2f} m above it"
        )
    if setups[-1].method == CALIBRATED:
        notes.append(
            f"{CALIBRATED}: the accuracy is meaningful only at points that were not used for the "
            "boresight calibration"
        )
    return notes

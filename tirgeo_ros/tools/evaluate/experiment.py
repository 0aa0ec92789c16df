"""Set up the experiment: surveyed points, their observations, the plane of errors, the methods."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from statistics import median
from typing import Any

import numpy as np
import numpy.typing as npt
import pyproj

from tirgeo_ros.core.config import METHODS
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import SurveyError
from tirgeo_ros.io.coordinates.crs import utm_zone
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint, load_observations, load_survey
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs

#: Name of the paper's own method, ``ekf_heading``, with a boresight calibration.
CALIBRATED = "calibrated"
#: Above this latitude zones are too narrow to be useful.
_MOST_LATITUDE_DEG = 84.0
_NAMED = 5  # most ids in a note


@dataclass(frozen=True)
class Projection:
    """Project to a transverse Mercator plane."""

    name: str
    definition: str  # for PROJ

    @cached_property
    def _proj(self) -> Any:
        return pyproj.Proj(self.definition)

    def project(self, latitude_rad: npt.ArrayLike, longitude_rad: npt.ArrayLike) -> Array:
        """Return east and north (..., 2), m, of positions (...)."""
        east, north = self._proj(np.degrees(longitude_rad), np.degrees(latitude_rad))
        return np.stack([np.asarray(east, float), np.asarray(north, float)], axis=-1)

    def local_axes(self, latitude_rad: float, longitude_rad: float) -> Array:
        """Return the matrix (2, 2) from metres north, east at a point to east, north in the plane.

        It is the scale at that point, rotated by the meridian convergence.
        """
        factors = self._proj.get_factors(math.degrees(longitude_rad), math.degrees(latitude_rad))
        turn, scale = math.radians(factors.meridian_convergence), factors.meridional_scale
        sine, cosine = scale * math.sin(turn), scale * math.cos(turn)
        return np.array([[-sine, cosine], [cosine, sine]])


def projection_of(kind: str, latitude_rad: Array, longitude_rad: Array) -> Projection:
    """Return ``gauss-krueger`` (3-degree zones, scale 1) or ``utm`` for points (N,), N at least 1.

    The zone is that of the points' middle. Raise SurveyError too near a pole.
    """
    latitude_deg = math.degrees(float(np.mean(latitude_rad)))
    # The mean of directions, so that it is right for points on both sides of 180 degrees.
    middle = np.arctan2(np.sin(longitude_rad).mean(), np.cos(longitude_rad).mean())
    longitude_deg = math.degrees(float(middle))
    if abs(latitude_deg) > _MOST_LATITUDE_DEG:
        raise SurveyError(
            f"the survey lies at latitude {latitude_deg:.1f}: no transverse Mercator zone there"
        )
    if kind == "utm":
        zone, code = utm_zone(latitude_deg, longitude_deg)
        half = "S" if latitude_deg < 0 else "N"
        return Projection(f"UTM zone {zone}{half}, WGS84 (EPSG:{code})", f"EPSG:{code}")
    meridian = 3.0 * math.floor(longitude_deg / 3 + 0.5)
    side = "W" if meridian < 0 else "E"
    return Projection(
        f"Gauss-Krueger, 3-degree zone of {abs(meridian):g} deg {side}, WGS84",
        f"+proj=tmerc +lon_0={meridian:g} +k=1 +x_0=500000 +ellps=WGS84 +units=m",
    )


@dataclass(frozen=True)
class Experiment:
    """Hold the surveyed points and their observations."""

    projection: Projection
    control: Mapping[str, SurveyPoint]  # every surveyed point by its id
    observations: Sequence[Observation]  # also of points that were not surveyed

    @property
    def heights_m(self) -> list[float]:
        """Return the ellipsoidal heights of the observed surveyed points, one for each point."""
        seen = {one.id for one in self.observations}
        return [point.height_m for name, point in self.control.items() if name in seen]


def load_experiment(survey: PathLike, observations: PathLike, projection: str) -> Experiment:
    """Load survey and observations from files, in a projected plane (``projection_of``).

    Raise SurveyError, also if no surveyed point was observed.
    """
    points, seen = load_survey(survey), load_observations(observations)
    if not seen:
        raise SurveyError(f"{os.fspath(observations)}: has no observations")
    if not {point.id for point in points} & {one.id for one in seen}:
        raise SurveyError(
            f"{os.fspath(observations)}: none of its {len(seen)} observations is of a point in "
            f"{os.fspath(survey)}: the ids must be the same"
        )
    return experiment_of(points, seen, projection)


def experiment_of(
    points: Sequence[SurveyPoint], seen: Sequence[Observation], projection: str
) -> Experiment:
    """Return the experiment with the surveyed points in a plane (``projection_of``)."""
    latitude, longitude = np.array([(one.latitude_rad, one.longitude_rad) for one in points]).T
    plane = projection_of(projection, latitude, longitude)
    return Experiment(plane, {one.id: one for one in points}, seen)


def input_notes(given: Experiment, image_stamps_ns: Sequence[int]) -> list[str]:
    """Compare observations, survey and pictures, whose stamps (M,) may be empty."""
    names, total = Counter(one.id for one in given.observations), len(given.observations)
    unknown = [name for name in names if name not in given.control]
    unobserved = [name for name in given.control if name not in names]
    notes = []
    if unknown:
        notes.append(
            f"{sum(names[name] for name in unknown)} of {total} observations are of points that "
            f"are not in the survey, and left out: {_some(unknown)}"
        )
    if unobserved:
        notes.append(f"{len(unobserved)} surveyed points were never observed: {_some(unobserved)}")
    images = np.array(sorted(image_stamps_ns), np.int64)
    apart_ns = [
        int(np.abs(images - one.stamp_ns).min()) for one in given.observations if len(images)
    ]
    if any(apart_ns):
        notes.append(
            f"{np.count_nonzero(apart_ns)} of {total} observations have no picture's "
            f"stamp: they are up to {max(apart_ns) * 1e-9:.3g} s from the nearest one"
        )
    return notes


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more


@dataclass(frozen=True)
class MethodSetup:
    """Hold a method with its parameters."""

    method: str
    configs: NodeConfigs
    ground: Ground
    ground_words: str

    def exposure_ns(self, stamp_ns: int) -> int:
        """Return when the picture with a stamp was exposed (ns)."""
        return exposure_ns(stamp_ns, self.configs.overlay.video_latency_s)


def method_setups(
    params: Files,
    boresight: PathLike | None,
    dem: PathLike | None,
    ground_height: float | None,
    namespace: str,
    survey_heights_m: Sequence[float],
    camera: PathLike | None = None,
) -> list[MethodSetup]:
    """Return the four methods of the paper, and ``calibrated`` with a boresight file.

    ``boresight`` overrides ``params``; ``dem`` or ``ground_height``, and ``camera``, override
    both. Without any ground it is level at the median of the survey's heights. Raise ConfigError,
    ElevationError.
    """
    asked = [(name, name, paths_of(params)) for name in METHODS]
    if boresight is not None:
        asked.append((CALIBRATED, "ekf_heading", [*paths_of(params), boresight]))
    grounds: dict[str, Ground | None] = {}
    setups = []
    for name, method, files in asked:
        configs = node_configs(
            files, namespace, method=method, dem=dem, ground_height=ground_height, camera=camera
        )
        key = repr(configs.overlay)
        if key not in grounds:  # an elevation model is large, so each is read once
            grounds[key] = ground_of(configs.overlay)
        ground, words = grounds[key], "level at {:.3f} m"
        if ground is None:
            ground, words = float(median(survey_heights_m)), f"{words}, the survey's median"
            configs = configs._replace(overlay=replace(configs.overlay, ground_height_m=ground))
        if isinstance(ground, Terrain):
            words = f"elevation model {os.fspath(configs.overlay.dem)}"
        else:
            words = words.format(ground)
        setups.append(MethodSetup(name, configs, ground, words))
    return setups


def setup_notes(setups: Sequence[MethodSetup], survey_heights_m: Sequence[float]) -> list[str]:
    """Return notes on grounds and methods, such as the survey's heights above level ground."""
    notes: list[str] = []
    for setup in setups:
        if isinstance(setup.ground, Terrain):
            notes += setup.ground.notes
        elif math.isfinite(setup.ground):
            off = [height - setup.ground for height in survey_heights_m]
            notes.append(
                f"ground {setup.ground_words}; the observed points' heights are "
                f"{min(off):+.2f} to {max(off):+.2f} m from it"
            )
    if setups[-1].method == CALIBRATED:
        notes.append(
            f"{CALIBRATED}: the accuracy is meaningful only on points that were not used for its "
            "boresight"
        )
    return list(dict.fromkeys(notes))

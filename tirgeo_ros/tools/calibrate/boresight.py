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
"""Estimate boresight, latency and more from a recorded flight: ``tirgeo calibrate boresight``."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.boresight_fit import (
    UNASKED_SHARE,
    Ambiguity,
    BoresightFit,
    check_numbers,
    doubt,
    fit,
    foreseen,
    ground_errors,
    rmse_m,
)
from tirgeo_ros.core.calibration.boresight_model import (
    CLICK_SIGMA_PX,
    PARAMETERS,
    PointSighting,
    SightedFlight,
    corrected_pose,
)
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.parameters.parameter_file import Files, Value
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint, load_observations, load_survey
from tirgeo_ros.tools.calibrate.result import Result, estimate, estimates_table, written
from tirgeo_ros.tools.convert.direct_input import NO_OPTIONS
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, open_flight
from tirgeo_ros.tools.replay.registration import has_rates
from tirgeo_ros.tools.replay.stepped_flight import SteppedFlight

#: Parameters estimated by default, and the one estimated only if the flight can determine it.
USUAL = ("roll", "pitch", "yaw", "latency")
IF_DETERMINED = "gimbal_north"
#: Residuals larger than expected by this factor cause a note.
_MUCH = 2.0
_UNITS = {"latency": "ms", "ground_height": "m"}  # all others: deg
_FOLLOWED = (
    "gimbal_node estimates gimbal_north during this flight (parameters north.*), so there is "
    "nothing left to estimate; leave it out"
)


def calibrate_boresight(
    bag: PathLike,
    survey: PathLike,
    observations: PathLike,
    output: PathLike,
    *,
    params: Files = None,
    estimate: Sequence[str] | None = None,
    hold: Collection[str] = (),
    namespace: str = "",
    click_sigma_px: float = CLICK_SIGMA_PX,
    camera: PathLike | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    smooth: bool = False,
    logs: LogOptions = NO_OPTIONS,
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate parameters from a flight over surveyed points and write them; return a summary.

    ``estimate`` lists names of ``core.calibration.boresight_model.PARAMETERS``; None: USUAL, and
    IF_DETERMINED if the flight can determine it. Parameters in ``hold`` keep their values in
    ``params``; ``camera``, ``dem`` and ``ground_height`` (ellipsoidal m) override these.
    ``smooth``: camera poses from all measurements, also later ones. Raise CalibrationError if the
    flight does not determine a parameter, BagError, ConfigError, SurveyError.
    """
    options = {"camera": camera, "dem": dem, "ground_height": ground_height}
    inputs = survey, observations
    opened = open_flight(
        bag,
        (output,),
        params,
        namespace,
        options,
        inputs=inputs,
        error=CalibrationError,
        logs=logs,
        progress=progress,
    )
    reader, configs = opened.reader, opened.configs
    clicks = load_observations(observations, reader.stills())
    observed = (clicks, load_survey(survey), click_sigma_px, progress)
    if estimate is None and not has_rates(reader, namespace):
        hold = {*hold, "latency"}  # one file has the still and its pose
    wanted = _wanted(estimate, hold, configs)
    read = _read(reader, namespace, configs, wanted, *observed, smooth=smooth)
    try:
        fitted, notes = _fit(read, wanted, strict=estimate is not None)
    except CalibrationError as error:
        raise CalibrationError(f"{reader.path}: {error}") from None
    result = _result(read, configs, fitted, opened.notes + read.clicks.notes + notes)
    lines = boresight_lines(result.numbers)
    files = [(output, lambda: result.yaml("boresight", bag, lines))]
    unknown, lost = read.clicks.unknown, read.clicks.lost
    numbers = {"unknown_ids": unknown, "without_pose": lost, "notes": result.notes}
    first = {"input": os.fspath(bag), "smoothed": smooth}
    return first | written(files, result.numbers | numbers, reader)


class Clicks(NamedTuple):
    """Hold the observations of surveyed points in pictures with a pose, and count the others."""

    sightings: Sequence[PointSighting]
    unknown: int  # observations of points that the survey lacks
    lost: int  # observations of pictures without a pose

    @property
    def notes(self) -> list[str]:
        """Return notes on the observations that cannot be used."""
        faults = {
            "points that the survey does not have": self.unknown,
            "pictures without a pose": self.lost,
        }
        return [f"{number} observations of {what}" for what, number in faults.items() if number]

    def outliers(self, residuals: Array, used: BoolArray) -> list[dict[str, Any]]:
        """Return the sightings (N,) that a fit left out, with their residuals (N, 2), px."""
        off_px = np.hypot(*residuals.T).tolist()
        return [
            {"id": sighting.id, "stamp_ns": sighting.stamp_ns, "off_px": length}
            for sighting, length, is_used in zip(self.sightings, off_px, used, strict=True)
            if not is_used
        ]


def clicks_of(
    observed: Sequence[Observation],
    survey: Sequence[SurveyPoint],
    plane: TangentPlane,
    has_pose: Callable[[int], bool],
) -> Clicks:
    """Return the observations of surveyed points; ``has_pose`` is asked for each stamp."""
    points_n = {
        point.id: plane.ned_from_geodetic(point.latitude_rad, point.longitude_rad, point.height_m)
        for point in survey
    }
    surveyed = [observation for observation in observed if observation.id in points_n]
    posed = [
        PointSighting(click.id, click.stamp_ns, np.array([click.u, click.v]), points_n[click.id])
        for click in surveyed
        if has_pose(click.stamp_ns)
    ]
    return Clicks(posed, len(observed) - len(surveyed), len(surveyed) - len(posed))


@dataclass(frozen=True)
class _ReadFlight:
    """Hold a flight with its computed poses, and the observations of its points."""

    flight: SightedFlight
    plane: TangentPlane
    clicks: Clicks
    ground_m: float  # median height of the points seen, ellipsoidal; nan without any
    by_encoders: bool
    follows_north: bool  # the composer estimated the gimbal's north during the flight


def _read(
    reader: BagReader,
    namespace: str,
    configs: NodeConfigs,
    wanted: Sequence[str],
    observed: Sequence[Observation],
    survey: Sequence[SurveyPoint],
    click_sigma_px: float,
    progress: Report,
    *,
    smooth: bool = False,
) -> _ReadFlight:
    """Read a bag once. Raise BagError, or CalibrationError if the filter gives no pose."""
    stamps_ns = [observation.stamp_ns for observation in observed]
    stepped = SteppedFlight(
        reader,
        namespace,
        configs,
        stamps_ns,
        progress,
        north=IF_DETERMINED in wanted,
        smooth=smooth,
    )
    flight, plane = stepped.sighted(click_sigma_px), stepped.plane
    present = np.zeros(len(PARAMETERS))
    clicks = clicks_of(
        observed, survey, plane, lambda at: corrected_pose(flight, at, present) is not None
    )
    seen = {sighting.id for sighting in clicks.sightings}
    heights = [point.height_m for point in survey if point.id in seen]
    return _ReadFlight(
        flight=flight,
        plane=plane,
        clicks=clicks,
        ground_m=float(np.median(heights)) if heights else math.nan,
        by_encoders=stepped.by_encoders,
        follows_north=stepped.follows_north,
    )


def _wanted(
    estimate: Sequence[str] | None, hold: Collection[str], configs: NodeConfigs
) -> list[str]:
    """Return the parameters to estimate. Raise CalibrationError if one cannot be estimated."""
    asked = (*USUAL, IF_DETERMINED) if estimate is None else estimate
    wanted = [name for name in asked if name not in hold]
    if "ground_height" in wanted and configs.overlay.dem:
        raise CalibrationError(
            "ground_height: overlay_node takes the ground from its dem; remove dem from the "
            "parameters, or ground_height from the list"
        )
    return wanted


def _fit(read: _ReadFlight, wanted: list[str], *, strict: bool) -> tuple[BoresightFit, list[str]]:
    """Return the fit, and notes on parameters that it left out; ``strict``: leave out none.

    Raise CalibrationError if a parameter is not determined well enough.
    """

    def foreseen_doubt(names: Sequence[str], share: float = 1.0) -> Ambiguity | None:
        return doubt(names, foreseen(read.flight, read.clicks.sightings, names), share)

    check_numbers(read.clicks.sightings)
    notes = []
    if IF_DETERMINED in wanted:
        why = ""
        others = [name for name in wanted if name != IF_DETERMINED]
        if read.follows_north:
            why = _FOLLOWED
            if strict:
                raise CalibrationError(why)
        elif not strict:
            # An estimated north could only increase the uncertainty of the others.
            _refuse(foreseen_doubt(others))
            ambiguity = foreseen_doubt(wanted, UNASKED_SHARE)
            if ambiguity is not None:
                why = "with it, this flight would leave the other parameters too uncertain"
                if IF_DETERMINED in ambiguity.names:
                    why = f"{ambiguity.reason}; the boresight includes the error of north, and is "
                    why += "right at this tilt only"
        if why:
            wanted = others
            key = key_of(IF_DETERMINED, read.by_encoders)
            notes.append(f"{IF_DETERMINED} ({key}) held at its present value: {why}")
    _refuse(foreseen_doubt(wanted))
    fitted = fit(read.flight, read.clicks.sightings, wanted)
    ambiguity = doubt(wanted, fitted.covariance)
    if ambiguity is not None and fitted.noise_factor > 1:
        raise CalibrationError(
            f"{', '.join(ambiguity.names)}: too uncertain, because residuals are "
            f"{fitted.noise_factor:.1f} times as large as the sigmas of clicks and poses predict: "
            "check lens, survey, lever arms and the held parameters"
        )
    _refuse(ambiguity)
    return fitted, notes


def _refuse(ambiguity: Ambiguity | None) -> None:
    if ambiguity is not None:
        raise CalibrationError(str(ambiguity))


def key_of(name: str, by_encoders: bool) -> str:
    """Return node and name of the parameter for one of PARAMETERS."""
    return {
        "latency": "overlay_node video_latency_s",
        "gimbal_north": f"gimbal_node {'yaw_zero_deg' if by_encoders else 'north.bias_deg'}",
        "ground_height": "overlay_node ground_height_m",
    }.get(name, "gimbal_node boresight_rpy_deg")


def _result(
    read: _ReadFlight, configs: NodeConfigs, fitted: BoresightFit, notes: list[str]
) -> Result:
    """Return the result of a fit. Raise ConfigError if a parameter would be out of its range.

    Residuals are in px, lengths on the ground in m.
    """
    used = [s for s, is_used in zip(read.clicks.sightings, fitted.used, strict=True) if is_used]
    present = _present(read, configs)
    estimates = {}
    for name, sigma in fitted.sigma.items():
        before, change = (v[PARAMETERS.index(name)] for v in (present, fitted.correction))
        key, unit = key_of(name, read.by_encoders), _UNITS.get(name, "deg")
        estimates[name] = estimate(key, unit, before, before + change, sigma)
    sigmas = np.sqrt(np.diag(fitted.covariance))
    corrections = {
        "before": dict.fromkeys(fitted.by_point, np.zeros(len(PARAMETERS))),
        "after": dict.fromkeys(fitted.by_point, fitted.correction),
        "leave_one_point_out": fitted.by_point,
    }
    numbers = {
        "composition": "encoders" if read.by_encoders else "paper",
        "parameters": estimates,
        "correlation": fitted.covariance / np.outer(sigmas, sigmas),
        "points": len({sighting.id for sighting in used}),
        "pictures": len({sighting.stamp_ns for sighting in used}),
        "observations": len(used),
        "outliers": read.clicks.outliers(fitted.after, fitted.used),
        "noise_factor": fitted.noise_factor,
        "residual_rms_px": {
            when: float(np.sqrt(np.nanmean((residuals[fitted.used] ** 2).sum(1))))
            for when, residuals in (("before", fitted.before), ("after", fitted.after))
        },
        "ground_rmse_m": {
            name: rmse_m(ground_errors(read.flight, read.plane, used, way))
            for name, way in corrections.items()
        },
    }
    nodes = _nodes(present, fitted, configs, {row["key"] for row in estimates.values()})
    return Result(numbers, nodes, notes + _notes(numbers, nodes))


def left_out(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a note on each of the outliers."""
    return [
        f"left out {row['id']} at {row['stamp_ns']}: "
        + ("not in view" if math.isnan(row["off_px"]) else f"{row['off_px']:.0f} px off")
        for row in rows
    ]


def _present(read: _ReadFlight, configs: NodeConfigs) -> Array:
    """Return the values (6,) of PARAMETERS in this flight, rad, s, m; nan if not configured."""
    gimbal = configs.gimbal
    north_deg = gimbal.yaw_zero_deg if read.by_encoders else gimbal.north.bias_deg
    # The ground's correction is relative to the survey's heights.
    angles = *read.flight.boresight_rpy_rad, read.flight.latency_s
    return np.array([*angles, math.radians(north_deg), read.ground_m])


def _nodes(
    present: Array, fitted: BoresightFit, configs: NodeConfigs, keys: set[str]
) -> dict[str, dict[str, Value]]:
    """Return the parameters in ``keys`` by node. Raise ConfigError for one out of range."""
    roll, pitch, yaw, latency_s, north, height_m = (present + fitted.correction).tolist()
    values: dict[str, Value] = {
        "gimbal_node boresight_rpy_deg": np.degrees([roll, pitch, yaw]).tolist(),
        "overlay_node video_latency_s": latency_s,
        "gimbal_node yaw_zero_deg": math.degrees(north),
        "gimbal_node north.bias_deg": math.degrees(north),
        "overlay_node ground_height_m": height_m,
    }
    nodes: dict[str, dict[str, Value]] = {}
    for key in [key for key in values if key in keys]:
        node, _, name = key.rpartition(" ")
        nodes.setdefault(node, {})[name] = values[key]
    for node, own in nodes.items():
        config = configs.gimbal if node == "gimbal_node" else configs.overlay
        config_from(type(config), {**values_of(config), **own}, "the estimates")
    return nodes


def _notes(numbers: Mapping[str, Any], nodes: Mapping[str, Mapping[str, Value]]) -> list[str]:
    notes = left_out(numbers["outliers"])
    if numbers["noise_factor"] > _MUCH:
        notes.append(
            f"residuals are {numbers['noise_factor']:.1f} times as large as the sigmas of clicks "
            "and poses predict, so all sigmas are multiplied by this: check lens, survey, lever "
            "arms"
        )
    if "north.bias_deg" in nodes.get("gimbal_node", {}):
        notes.append(
            "set gimbal_node north.sigma_deg to the change of the bias that you expect until the "
            "next flight"
        )
    return notes


def boresight_lines(result: Mapping[str, Any]) -> list[str]:
    """Return the estimates as a table, and how well they fit."""
    pixels, ground = result["residual_rms_px"], result["ground_rmse_m"]
    return [
        *estimates_table(result["parameters"]),
        f"residuals: {pixels['before']:.2f} px before, {pixels['after']:.2f} px after (rms)",
        (
            f"on the ground: {ground['before']:.3f} m before, {ground['after']:.3f} m after, "
            f"{ground['leave_one_point_out']:.3f} m for each point by the others alone (rmse)"
        ),
        (
            f"{result['observations']} observations of {result['points']} points in "
            f"{result['pictures']} pictures, composition {result['composition']}"
        ),
    ]

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
"""Calibrate the set-up by a flight's own pictures: ``tirgeo calibrate boresight --ties``.

Clicks on surveyed points may be in the same fit. Every fifth pair of pictures is left out of the
fit, and judges it.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Collection, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.adjustment.adjustment import known_downs, places
from tirgeo_ros.core.adjustment.tie_fit import PRIOR_SIGMA, TieFit
from tirgeo_ros.core.adjustment.tied_views import PARAMETERS, corrected_camera
from tirgeo_ros.core.calibration.boresight_fit import check_numbers, rmse_m
from tirgeo_ros.core.ties.tracks import TiedPair
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.parameters.parameter_file import Files, Value
from tirgeo_ros.io.pictures.camera_file import camera_yaml
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint, load_observations, load_survey
from tirgeo_ros.tools.calibrate.boresight import Clicks, clicks_of, left_out
from tirgeo_ros.tools.calibrate.result import Result, estimate, estimates_table, written
from tirgeo_ros.tools.convert.direct_input import NO_OPTIONS
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight_ties import FlightTies, flight_ties, median
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, open_flight
from tirgeo_ros.tools.replay.registration import has_rates

_UNITS = {"latency": "ms", "ground_height": "m", "focal": "px", "k1": "1"}  # all others: deg
_LENS = ("focal", "k1")
_SCALE_M = 0.3  # sigma of positions from which on they are no scale
_WORSE = 1.1  # share of the disagreement before from which on a result is refused


class _Judged(NamedTuple):
    """Hold pairs that were left out of the fit, and how far their ties are apart, m."""

    pairs: int
    before: Array  # (K,)
    after: Array  # (K,) with the set-up corrected
    at_own_heights: Array  # (K,) the same, at the ties' own heights where the fit knows them

    def numbers(self) -> dict[str, object]:
        """Return medians and 95 % bounds."""
        each = {name: getattr(self, name) for name in ("before", "after", "at_own_heights")}
        quantiles = {name: np.nanquantile(apart, (0.5, 0.95)) for name, apart in each.items()}
        return {"pairs": self.pairs, "ties": len(self.before)} | {
            name: {"median": float(middle), "p95": float(p95)}
            for name, (middle, p95) in quantiles.items()
        }


def calibrate_by_ties(
    bag: PathLike,
    output: PathLike,
    *,
    survey: PathLike | None = None,
    observations: PathLike | None = None,
    params: Files = None,
    hold: Collection[str] = (),
    namespace: str = "",
    camera: PathLike | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    smooth: bool = False,
    logs: LogOptions = NO_OPTIONS,
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate PARAMETERS from what a flight's pictures show twice; return a summary.

    Clicks on surveyed points enter the same fit if ``survey`` and ``observations`` are given.
    Write PARAMETERS to ``output``; beside it the camera's calibration, if the fit found one, and a
    plot of what was left out. What the flight cannot tell keeps its value, with a note, and so
    does what is in ``hold``. Raise CalibrationError if there are too few ties or points, BagError,
    CameraError, ConfigError, ElevationError, SurveyError.
    """
    needed("matplotlib", f"drawing a plot beside {output}", CalibrationError)
    beside = Path(output).with_suffix(".png"), Path(f"{Path(output).with_suffix('')}_camera.yaml")
    options = {"camera": camera, "dem": dem, "ground_height": ground_height}
    outputs = output, *beside
    opened = open_flight(
        bag,
        outputs,
        params,
        namespace,
        options,
        inputs=[path for path in (survey, observations) if path],
        error=CalibrationError,
        logs=logs,
        progress=progress,
    )
    reader, configs = opened.reader, opened.configs
    observed: tuple[list[Observation], list[SurveyPoint]] = [], []
    if survey and observations:
        observed = load_observations(observations, reader.stills()), load_survey(survey)
    ties = flight_ties(reader, namespace, configs, progress, smooth=smooth)
    clicks = clicks_of(*observed, ties.stepped.plane, ties.views.__contains__)
    held, loose = {*hold}, [] if survey else _without_scale(ties)
    held |= {"focal"} if loose else set()
    held |= {"ground_height"} if configs.overlay.dem else set()  # the model has it
    held |= set() if has_rates(reader, namespace) else {"latency"}  # a still has none
    try:
        if survey:
            check_numbers(clicks.sightings)
        fit = ties.fit(_prior_sigma(ties, held), clicks.sightings)
    except CalibrationError as error:
        raise CalibrationError(f"{reader.path}: {error}") from None
    judged = _judged(ties, fit)
    _check(reader, judged)
    found = _found(ties, fit, configs)
    lens = [name for name in _LENS if fit.correction[PARAMETERS.index(name)]]
    calibration = camera_yaml(corrected_camera(ties.stepped.recorded.camera, fit.correction))
    nodes = _nodes(found, configs)
    if lens:
        nodes.setdefault("overlay_node", {})["camera"] = os.fspath(beside[1].resolve())
    numbers: dict[str, Any] = {
        "parameters": found,
        "disagreement_m": {name: each.numbers() for name, each in judged.items()},
        "pictures": len(fit.views),
        "pairs": len(ties.pairs),
        "ties": sum(len(pair.first_uv) for pair in ties.pairs),
        "points": len(fit.points_n) - len(fit.flight.surveyed_n),
        "residual_px": fit.noise.pixel_sigma,
    }
    notes = [*opened.notes, *loose, *_notes(fit)]
    if survey:
        numbers["surveyed"] = _surveyed(ties, fit, clicks)
        notes += [*clicks.notes, *left_out(numbers["surveyed"]["outliers"])]
    result = Result(numbers, nodes, notes)
    lines = ties_lines(numbers)
    files: list[tuple[PathLike | None, Callable[[], str | bytes]]] = [
        (output, lambda: result.yaml("boresight --ties", bag, lines)),
        (beside[0], lambda: _plot(judged["all"])),
        (beside[1] if lens else None, lambda: calibration),
    ]
    first = {"input": os.fspath(bag), "smoothed": smooth}
    return first | written(files, numbers | {"notes": result.notes}, reader)


def _prior_sigma(ties: FlightTies, held: Collection[str]) -> Array:
    sigma = PRIOR_SIGMA.copy()
    sigma[PARAMETERS.index("gimbal_north")] = ties.stepped.north_sigma_rad
    sigma[[PARAMETERS.index(name) for name in held]] = 0.0
    return sigma


def _without_scale(ties: FlightTies) -> list[str]:
    """Return a note if positions are too uncertain for the pictures to tell a focal length."""
    variances = [np.trace(tied.view.pose.covariance[:2, :2]) for tied in ties.views.values()]
    if math.sqrt(float(np.median(variances or [0.0]))) < _SCALE_M:
        return []
    return ["focal keeps its value: without RTK the flight has no scale to tell it"]


def _judged(ties: FlightTies, fit: TieFit) -> dict[str, _Judged]:
    """Return the pairs that the fit has not seen, all of them and those of opposite headings."""
    downs, (before, after) = known_downs(fit), _set_up(fit)

    def judged(pairs: Sequence[TiedPair]) -> _Judged:
        ways = (before, None), (after, None), (after, downs)
        return _Judged(len(pairs), *(ties.apart_m(views, pairs, at) for views, at in ways))

    return {name: judged(pairs) for name, pairs in ties.judges(before).items()}


def _set_up(fit: TieFit) -> tuple[dict[int, View], dict[int, View]]:
    """Return the pictures by stamp: before, and with the set-up corrected, not each pose."""
    flight, still = fit.flight, np.zeros(6)
    before = {tied.view.stamp_ns: tied.view for tied in flight.views}
    return before, {s: flight.corrected(k, fit.correction, still) for k, s in enumerate(before)}


def _surveyed(ties: FlightTies, fit: TieFit, clicks: Clicks) -> dict[str, Any]:
    """Return how the surveyed points fit; on the ground at their own heights, without z."""
    plane, used = ties.stepped.plane, fit.used[fit.flight.clicks]
    kept = [s for s, is_used in zip(clicks.sightings, used, strict=True) if is_used]

    def off_m(views: Mapping[int, View]) -> float:
        at = ((views[s.stamp_ns], s.uv[None], s.point_n[2:]) for s in kept)
        located_n = [places(*each, plane, ties.ground)[0] for each in at]
        return rmse_m(np.array(located_n) - [s.point_n for s in kept])

    before, after = map(off_m, _set_up(fit))
    return {
        "points": len({sighting.id for sighting in kept}),
        "observations": len(kept),
        "outliers": clicks.outliers(fit.residuals[fit.flight.clicks], used),
        "ground_rmse_m": {"before": before, "after": after},
    }


def _check(reader: BagReader, judged: Mapping[str, _Judged]) -> None:
    """Raise CalibrationError if pictures that the fit has not seen agree less with it."""
    for name, each in judged.items():
        before, after = median(each.before), median(each.at_own_heights)
        if not after <= _WORSE * before:  # nan: there are none
            of = "" if name == "all" else f" of {name} headings"
            raise CalibrationError(
                f"{reader.path}: no result: {each.pairs} pairs{of} that the fit has not seen "
                f"disagree by {before:.2f} m before, by {after:.2f} m with it: the positions are "
                "too uncertain, or the height of the ground is wrong; fly with RTK, at two "
                "heights, or --hold a part"
            )


def _found(ties: FlightTies, fit: TieFit, configs: NodeConfigs) -> dict[str, dict[str, Any]]:
    """Return the estimates that are not held, each with its prior sigma."""
    stepped, gimbal = ties.stepped, configs.gimbal
    north, key = gimbal.north.bias_deg, "north.bias_deg"
    if stepped.by_encoders:
        north, key = gimbal.yaw_zero_deg, "yaw_zero_deg"
    lens = stepped.recorded.camera
    boresight = np.radians(gimbal.boresight_rpy_deg).tolist()
    height_m = configs.overlay.ground_height_m
    present = {
        **{
            name: (before, "gimbal_node boresight_rpy_deg", 1.0)
            for name, before in zip(("roll", "pitch", "yaw"), boresight, strict=True)
        },
        "gimbal_north": (np.radians(north), f"gimbal_node {key}", 1.0),
        "focal": (lens.fx, "overlay_node camera", lens.fx),
        "k1": ((*lens.distortion, 0.0)[0], "overlay_node camera", 1.0),
        "latency": (configs.overlay.video_latency_s, "overlay_node video_latency_s", 1.0),
        "ground_height": (height_m, "overlay_node ground_height_m", 1.0),
    }
    rows = {}
    for name, change, sigma, prior in zip(
        PARAMETERS, fit.correction, fit.sigma, fit.flight.prior_sigma, strict=True
    ):
        if prior > 0 and name not in fit.undetermined:
            before, where, scale = present[name]
            numbers = before, before + change * scale, sigma * scale, prior * scale
            rows[name] = estimate(where, _UNITS.get(name, "deg"), *numbers)
    return rows


def _nodes(
    found: Mapping[str, Mapping[str, Any]], configs: NodeConfigs
) -> dict[str, dict[str, Value]]:
    """Return the parameters of the nodes that hold the estimates."""
    rpy_deg = [
        found[name]["found"] if name in found else present
        for name, present in zip(
            ("roll", "pitch", "yaw"), configs.gimbal.boresight_rpy_deg, strict=True
        )
    ]
    nodes: dict[str, dict[str, Value]] = {}
    for name, row in found.items():
        node, _, key = row["key"].partition(" ")
        value = {"boresight_rpy_deg": rpy_deg, "video_latency_s": row["found"] * 1e-3}
        if name not in _LENS:
            nodes.setdefault(node, {})[key] = value.get(key, row["found"])
    return nodes


def _notes(fit: TieFit) -> list[str]:
    return [f"{name} keeps its value: {why}" for name, why in fit.undetermined.items()]


def ties_lines(result: Mapping[str, Any]) -> list[str]:
    """Return how far pictures disagree before and after, and the estimates as a table."""
    lines = []
    for name, row in result["disagreement_m"].items():
        where = "" if name == "all" else f" of {name} headings"
        numbers = ", ".join(
            f"{row[key]['median']:.2f} m {words}"
            for key, words in (
                ("before", "before"),
                ("after", "after"),
                ("at_own_heights", "at the ties' own heights"),
            )
        )
        lines.append(f"{row['pairs']} pairs{where} left out of the fit disagree by {numbers}")
    fitted = f"{result['ties']} ties in {result['pairs']} pairs of {result['pictures']} pictures"
    lines += [*estimates_table(result["parameters"]), fitted]
    if "surveyed" in result:
        row = result["surveyed"]
        off = row["ground_rmse_m"]
        lines.append(
            f"{row['observations']} observations of {row['points']} surveyed points: on the "
            f"ground {off['before']:.3f} m before, {off['after']:.3f} m after (rmse)"
        )
    return lines


def _plot(judged: _Judged) -> bytes:
    """Return a plot of the share of ties by how far they are apart."""
    chart, axes = figure()
    for k, (name, words) in enumerate(
        (("before", "before"), ("after", "after"), ("at_own_heights", "after, at own heights"))
    ):
        apart = np.sort(getattr(judged, name))
        apart = apart[np.isfinite(apart)]
        shares = np.arange(1, len(apart) + 1) / max(len(apart), 1)
        axes.plot(apart, 100 * shares, color=COLOURS[k], label=words)
    axes.set_xlim(0, max(2 * float(np.nanmedian(judged.before)), 0.5))
    axes.set_xlabel("distance on the ground between the places of a tie's two pixels, m")
    axes.set_ylabel("ties, %")
    axes.set_title(f"{len(judged.before)} ties of pairs of pictures that the fit has not seen")
    axes.legend(loc="lower right")
    return png(chart)

"""Estimate boresight, latency and more from a recorded flight: ``tirgeo calibrate boresight``."""

from __future__ import annotations

import math
import os
from collections.abc import Collection, Mapping, Sequence
from typing import Any

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
from tirgeo_ros.core.calibration.boresight_model import PARAMETERS, PointSighting
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import EkfConfig, GimbalConfig, OverlayConfig
from tirgeo_ros.core.config.schema import config_from, values_of
from tirgeo_ros.core.frames.rotations import rotation_z
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.parameters.parameter_file import Files, Value, paths_of
from tirgeo_ros.io.surveys.survey import load_observations, load_survey
from tirgeo_ros.tools.calibrate.boresight_flight import ReadFlight, read_flight
from tirgeo_ros.tools.calibrate.result import Result, estimate, estimates_table, written
from tirgeo_ros.tools.presentation.plots import COLOURS, arrows, figure, png
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs

#: Parameters estimated by default, and the one estimated only if the flight can determine it.
USUAL = ("roll", "pitch", "yaw", "latency")
IF_TOLD = "gimbal_north"
#: Standard deviation per axis (px) of an operator's click on a point in a thermal picture.
CLICK_SIGMA_PX = 1.0
_FOLLOWED = (
    "gimbal_north is followed by the flight's own readings (gimbal_node north.*), so there is "
    "nothing to estimate; leave it out"
)


def calibrate_boresight(
    bag_in: PathLike,
    survey: PathLike,
    observations: PathLike,
    output: PathLike,
    *,
    params: Files = None,
    estimate: Sequence[str] | None = None,
    hold: Collection[str] = (),
    namespace: str = "",
    click_sigma_px: float = CLICK_SIGMA_PX,
    plot: PathLike | None = None,
    camera: PathLike | None = None,
    smooth: bool = False,
    progress: Report = silent,
) -> dict[str, object]:
    """Estimate parameters from a flight over surveyed points and write them; return a summary.

    ``estimate`` are names of ``core.calibration.boresight_model.PARAMETERS``; None: USUAL, and
    IF_TOLD if the flight can determine it. Those in ``hold`` keep the values in ``params``.
    ``smooth``: camera poses from all measurements, also later ones. Raise
    CalibrationError if what is asked for is not determined, BagError, ConfigError, SurveyError.
    """
    configs = node_configs(params, namespace, camera=camera)
    given = (bag_in, survey, observations, *paths_of(params), *configs.files)
    check_outputs(given, (output, plot), CalibrationError)
    observed = (load_observations(observations), load_survey(survey), click_sigma_px, progress)
    reader = BagReader(bag_in)
    configs, chosen = configs.fitting(reader.topics(), namespace)
    wanted = _wanted(estimate, hold, configs)
    read = read_flight(reader, namespace, configs, wanted, *observed, smooth=smooth)
    fitted, notes = _fitted(reader, read, wanted, strict=estimate is not None)
    result = _result(read, configs, fitted, chosen + read.notes + notes)
    files = (
        (output, lambda: result.yaml("boresight", bag_in, boresight_lines(result.numbers))),
        (plot, lambda: boresight_png(read.flight.camera, read.sightings, fitted)),
    )
    numbers = {"unknown_ids": read.unknown, "without_pose": read.lost, "notes": result.notes}
    first = {"input": os.fspath(bag_in), "smoothed": smooth}
    return first | written(files, result.numbers | numbers, reader)


def _wanted(
    estimate: Sequence[str] | None, hold: Collection[str], configs: NodeConfigs
) -> list[str]:
    """Return the parameters to estimate. Raise CalibrationError for those that cannot be."""
    asked = (*USUAL, IF_TOLD) if estimate is None else estimate
    wanted = [name for name in asked if name not in hold]
    by_heading = "heading_offset" in wanted
    faults = {
        "ground_height: overlay_node takes the ground from its dem; remove dem from the "
        "parameters, or ground_height from the list": "ground_height" in wanted
        and bool(configs.overlay.dem),
        "gimbal_north and heading_offset both turn the camera about the vertical: estimate one of "
        "them": by_heading and "gimbal_north" in wanted,
        f"heading_offset: method {configs.ekf.method} uses no headings; leave it out": by_heading
        and configs.ekf.method != "ekf_heading",
        "heading_offset: it turns the second RTK antenna about the first; set "
        "aircraft.rtk_antenna_m and aircraft.second_antenna_m in the parameters": by_heading
        and configs.ekf.aircraft.baseline_b is None,
    }
    for reason, is_so in faults.items():
        if is_so:
            raise CalibrationError(reason)
    return wanted


def _fitted(
    reader: BagReader, read: ReadFlight, wanted: list[str], *, strict: bool
) -> tuple[BoresightFit, list[str]]:
    """Return the result of ``_fit``; name the bag where it is refused."""
    try:
        return _fit(read, wanted, strict=strict)
    except CalibrationError as error:
        raise CalibrationError(f"{reader.path}: {error}") from None


def _fit(read: ReadFlight, wanted: list[str], *, strict: bool) -> tuple[BoresightFit, list[str]]:
    """Return the fit, and notes on what was left out of it; ``strict``: leave nothing out.

    Raise CalibrationError if a parameter is not determined well enough.
    """
    check_numbers(read.sightings)
    notes = []
    why = ""
    if IF_TOLD in wanted and read.follows_north:
        why = _FOLLOWED
    elif IF_TOLD in wanted and not strict:
        why = _doubt_of_north(read, wanted)
    if why and strict:
        raise CalibrationError(why)
    if why:
        wanted = [name for name in wanted if name != IF_TOLD]
        key = key_of(IF_TOLD, read.by_encoders)
        notes.append(f"{IF_TOLD} ({key}) held at its present value: {why}")
    _refuse(_doubt_foreseen(read, wanted))
    fitted = fit(read.flight, read.sightings, wanted)
    ambiguity = doubt(wanted, fitted.covariance)
    if ambiguity is not None and fitted.noise_factor > 1:
        raise CalibrationError(
            f"{', '.join(ambiguity.names)}: residuals {fitted.noise_factor:.1f} times as large as "
            "clicks and poses are expected to be off leave too much unexplained: are lens, "
            "survey, lever arms and what is held right?"
        )
    _refuse(ambiguity)
    return fitted, notes


def _doubt_of_north(read: ReadFlight, wanted: Sequence[str]) -> str:
    """Return why the flight does not separate gimbal_north from the others; empty if it does."""
    # An estimated north could only increase the uncertainty of the others.
    _refuse(_doubt_foreseen(read, [name for name in wanted if name != IF_TOLD]))
    ambiguity = _doubt_foreseen(read, wanted, UNASKED_SHARE)
    if ambiguity is None:
        return ""
    if IF_TOLD not in ambiguity.names:
        return "this flight leaves too much uncertain for it"
    return f"{ambiguity.reason}; the boresight includes its error, and holds for this tilt only"


def _doubt_foreseen(
    read: ReadFlight, wanted: Sequence[str], share: float = 1.0
) -> Ambiguity | None:
    covariance = foreseen(read.flight, read.sightings, wanted)
    return doubt(wanted, covariance, share)


def _refuse(ambiguity: Ambiguity | None) -> None:
    if ambiguity is not None:
        raise CalibrationError(str(ambiguity))


#: Residuals larger than expected by this factor cause a note.
_MUCH = 2.0
_UNITS = {"latency": "ms", "ground_height": "m"}  # all others: deg
_SECOND = "aircraft.second_antenna_m"


def key_of(name: str, by_encoders: bool) -> str:
    """Return node and name of the parameter that holds one of PARAMETERS."""
    return {
        "latency": "overlay_node video_latency_s",
        "gimbal_north": f"gimbal_node {'yaw_zero_deg' if by_encoders else 'north.bias_deg'}",
        "heading_offset": _SECOND,
        "ground_height": "overlay_node ground_height_m",
    }.get(name, "gimbal_node boresight_rpy_deg")


def _result(
    read: ReadFlight, configs: NodeConfigs, fitted: BoresightFit, notes: list[str]
) -> Result:
    """Return the result of a fit. Raise ConfigError if a parameter would be out of its range.

    Residuals are in px, lengths on the ground in m.
    """
    used = [s for s, is_used in zip(read.sightings, fitted.used, strict=True) if is_used]
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
        "outliers": _outliers(read, fitted),
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


def _present(read: ReadFlight, configs: NodeConfigs) -> Array:
    """Return the values (7,) of PARAMETERS in this flight, rad, s, m; nan if not configured."""
    gimbal, direction_deg = configs.gimbal, configs.ekf.aircraft.baseline_deg
    north_deg = gimbal.yaw_zero_deg if read.by_encoders else gimbal.north.bias_deg
    offset_deg = math.nan if direction_deg is None else direction_deg
    # The ground's correction is relative to the survey's heights.
    angles = *read.flight.boresight_rpy_rad, read.flight.latency_s
    return np.array([*angles, *np.radians([north_deg, offset_deg]), read.ground_m])


def _nodes(
    present: Array, fitted: BoresightFit, configs: NodeConfigs, keys: set[str]
) -> dict[str, dict[str, Value]]:
    """Return the parameters in ``keys`` by node. Raise ConfigError for one out of range."""
    roll, pitch, yaw, latency_s, north, offset, height_m = (present + fitted.correction).tolist()
    values: dict[str, Value] = {
        "gimbal_node boresight_rpy_deg": np.degrees([roll, pitch, yaw]).tolist(),
        "overlay_node video_latency_s": latency_s,
        "gimbal_node yaw_zero_deg": math.degrees(north),
        "gimbal_node north.bias_deg": math.degrees(north),
        "overlay_node ground_height_m": height_m,
    }
    if _SECOND in keys:
        # The second antenna is turned about the first, clockwise from above.
        aircraft = configs.ekf.aircraft
        first, second = np.array(aircraft.rtk_antenna_m), np.array(aircraft.second_antenna_m)
        turn_rad = offset - float(present[PARAMETERS.index("heading_offset")])
        values[_SECOND] = (first + rotation_z(-turn_rad) @ (second - first)).tolist()
    nodes: dict[str, dict[str, Value]] = {}
    for key in [key for key in values if key in keys]:
        node, _, name = key.rpartition(" ")
        nodes.setdefault(node, {})[name] = values[key]
    node_config: dict[str, EkfConfig | GimbalConfig | OverlayConfig] = {
        "": configs.ekf,
        "gimbal_node": configs.gimbal,
        "overlay_node": configs.overlay,
    }
    for node, own in nodes.items():
        config = node_config[node]
        config_from(type(config), {**values_of(config), **own}, "what was found")
    return nodes


def _outliers(read: ReadFlight, fitted: BoresightFit) -> list[dict[str, Any]]:
    """Return the observations that disagree; ``off_px`` is None for a point not in view."""
    return [
        {
            "id": sighting.id,
            "stamp_ns": sighting.stamp_ns,
            "off_px": length if math.isfinite(length) else None,
        }
        for sighting, length, used in zip(
            read.sightings, np.hypot(*fitted.after.T).tolist(), fitted.used, strict=True
        )
        if not used
    ]


def _notes(numbers: Mapping[str, Any], nodes: Mapping[str, Mapping[str, Value]]) -> list[str]:
    notes = [
        f"left out {row['id']} at {row['stamp_ns']}: "
        + ("not in view" if row["off_px"] is None else f"{row['off_px']:.0f} px off")
        for row in numbers["outliers"]
    ]
    if numbers["noise_factor"] > _MUCH:
        notes.append(
            f"residuals are {numbers['noise_factor']:.1f} times as large as clicks and poses are "
            "expected to be off, and the sigmas that much larger: check lens, survey, lever arms"
        )
    if "north.bias_deg" in nodes.get("gimbal_node", {}):
        notes.append(
            "set gimbal_node north.sigma_deg to what the bias may change by the next flight"
        )
    if _SECOND in nodes.get("", {}):
        notes.append(
            f"{_SECOND} corrects headings where the aircraft's messages are read (dji_node, "
            "tirgeo import); those in this bag stay as they are: import it again"
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


_LONGEST_PX = 60.0


def boresight_png(
    camera: Camera, sightings: Sequence[PointSighting], fitted: BoresightFit
) -> bytes:
    """Return a PNG: an arrow from each observation to its point's expected pixel, outliers too."""
    uv = np.array([sighting.uv for sighting in sightings])
    made, axes = figure(10.0, 5.2, 1, 2, sharex=True, sharey=True)
    for panel, title, residuals in zip(
        axes, ("before", "after"), (fitted.before, fitted.after), strict=True
    ):
        _boresight_panel(panel, uv, residuals, fitted.used)
        rms = float(np.sqrt(np.nanmean((residuals[fitted.used] ** 2).sum(1))))
        panel.set(title=f"{title}: {rms:.2f} px rms", xlabel="column, px", aspect="equal")
    axes[0].set(xlim=(0, camera.width), ylim=(camera.height, 0), ylabel="row, px")
    axes[1].legend(loc="upper left", bbox_to_anchor=(0.0, -0.12), ncols=2)  # under the picture
    return png(made)


def _boresight_panel(panel: Any, uv: Array, residuals: Array, used: BoolArray) -> None:
    longest = float(np.nanmax(np.hypot(*residuals[used].T), initial=1e-3))
    visible = np.isfinite(residuals[:, 0])
    for shown, colour, what in (
        (used & visible, COLOURS[0], "used"),
        (~used & visible, COLOURS[1], "left out"),
    ):
        # An outlier may be hundreds of pixels off: its arrow is cut.
        cut = np.minimum(1.0, longest / np.maximum(np.hypot(*residuals[shown].T), 1e-9))
        moves = -residuals[shown] * cut[:, None] * _LONGEST_PX / longest
        panel.plot(*uv[shown].T, ".", color=colour, markersize=4, label=what)
        arrows(panel, uv[shown], moves, colour, 0.003)
    panel.text(0.01, 0.03, f"longest arrow {longest:.1f} px", transform=panel.transAxes)

"""Estimate boresight, latency and more from a recorded flight: ``tirgeo calibrate boresight``."""

from __future__ import annotations

import os
from collections.abc import Collection, Sequence

from tirgeo_ros.core.calibration.boresight_fit import (
    UNASKED_SHARE,
    Ambiguity,
    BoresightFit,
    check_numbers,
    doubt,
    fit,
    foreseen,
)
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.parameters.parameter_file import Files, parameters_yaml, paths_of
from tirgeo_ros.io.surveys.survey import load_observations, load_survey
from tirgeo_ros.tools.calibrate.boresight_flight import ReadFlight, read_flight
from tirgeo_ros.tools.calibrate.boresight_result import boresight_lines, key_of, summary
from tirgeo_ros.tools.calibrate.estimates import head
from tirgeo_ros.tools.calibrate.residual_plots import boresight_png
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
    configs, chosen = configs.fitting(reader, namespace)
    wanted = _wanted(estimate, hold, configs)
    read = read_flight(reader, namespace, configs, wanted, *observed, smooth=smooth)
    found, notes = _fitted(reader, read, wanted, strict=estimate is not None)
    result = summary(read, configs, found)
    notes = chosen + read.notes + notes + result.notes
    lines = head("boresight", os.fspath(bag_in), boresight_lines(result.numbers), notes)
    contents: dict[PathLike, str | bytes] = {output: parameters_yaml(result.nodes, lines)}
    if plot is not None:
        contents[plot] = boresight_png(read.flight.camera, read.sightings, found)
    write_files(contents, CalibrationError)
    return {
        "input": os.fspath(bag_in),
        "smoothed": smooth,
        "output": [os.fspath(path) for path in contents],
        **result.numbers,
        "unknown_ids": read.unknown,
        "without_pose": read.lost,
        "notes": notes,
        "error": None if reader.damage is None else f"{reader.path}: {reader.damage}",
    }


def _wanted(
    estimate: Sequence[str] | None, hold: Collection[str], configs: NodeConfigs
) -> list[str]:
    """Return the parameters to estimate. Raise CalibrationError for those that cannot be."""
    asked = (*USUAL, IF_TOLD) if estimate is None else estimate
    wanted = [name for name in asked if name not in hold]
    if "ground_height" in wanted and configs.overlay.dem:
        raise CalibrationError(
            "ground_height: overlay_node takes the ground from its dem; remove dem from "
            "the parameters, or ground_height from the list"
        )
    if {"gimbal_north", "heading_offset"} <= set(wanted):
        raise CalibrationError(
            "gimbal_north and heading_offset both turn the camera about the vertical: estimate "
            "one of them"
        )
    if "heading_offset" in wanted and configs.ekf.method != "ekf_heading":
        raise CalibrationError(
            f"heading_offset: method {configs.ekf.method} uses no headings; leave it out"
        )
    if "heading_offset" in wanted and configs.ekf.aircraft.baseline_b is None:
        raise CalibrationError(
            "heading_offset: it turns the second RTK antenna about the first; set "
            "aircraft.rtk_antenna_m and aircraft.second_antenna_m in the parameters"
        )
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
    found = fit(read.flight, read.sightings, wanted)
    left = doubt(wanted, found.covariance)
    if left is not None and found.noise_factor > 1:
        raise CalibrationError(
            f"{', '.join(left.names)}: residuals {found.noise_factor:.1f} times as large as "
            "clicks and poses are expected to be off leave too much unexplained: are lens, "
            "survey, lever "
            "arms and what is held right?"
        )
    _refuse(left)
    return found, notes


def _doubt_of_north(read: ReadFlight, wanted: Sequence[str]) -> str:
    """Return why the flight does not separate gimbal_north from the others; empty if it does."""
    # An estimated north could only increase the uncertainty of the others.
    _refuse(_doubt_foreseen(read, [name for name in wanted if name != IF_TOLD]))
    found = _doubt_foreseen(read, wanted, UNASKED_SHARE)
    if found is None:
        return ""
    if IF_TOLD not in found.names:
        return "this flight leaves too much uncertain for it"
    return f"{found.reason}; the boresight includes its error, and holds for this tilt only"


def _doubt_foreseen(
    read: ReadFlight, wanted: Sequence[str], share: float = 1.0
) -> Ambiguity | None:
    covariance = foreseen(read.flight, read.sightings, wanted)
    return doubt(wanted, covariance, share)


def _refuse(found: Ambiguity | None) -> None:
    if found is not None:
        raise CalibrationError(str(found))

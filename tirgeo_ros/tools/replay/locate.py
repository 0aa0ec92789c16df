"""Locate pixels of a recorded flight on the ground, or convert targets: ``tirgeo locate``.

The results are ground points with error ellipses. The camera poses come from the same core objects
as those of the nodes and of ``tirgeo process``.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from statistics import median

from tirgeo_ros.core.ground.backprojection import Ground, Reason
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.ground.ground_point import Answer, Located, Refusal, place
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.errors import ConfigError, SurveyError, TargetError
from tirgeo_ros.core.types.finding import Finding, stop_line
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.io.surveys.survey import Answered, Observation, load_observations
from tirgeo_ros.io.targets.formats import cot, exported, exported_answers, form_of, read_targets
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.results import finding_items
from tirgeo_ros.tools.replay.flight import Flight
from tirgeo_ros.tools.replay.flight_checks import FlightChecks, tried_map
from tirgeo_ros.tools.replay.node_configs import NodeConfigs, node_configs


def locate_pixels(
    bag_in: PathLike,
    pixels: PathLike,
    output: PathLike,
    *,
    params: Files = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    method: str | None = None,
    kml_out: PathLike | None = None,
    cot_out: PathLike | None = None,
    namespace: str = "",
    camera: PathLike | None = None,
    smooth: bool = False,
    progress: Report = silent,
) -> dict[str, object]:
    """Locate pixels (CSV ``id,stamp_ns,u,v``) of a bag's pictures; return a summary.

    Write the format that the output's name asks for (of ``FORMATS``, else GeoJSON), and KML and
    Cursor-on-Target if asked: all of them or none. ``dem`` or
    ``ground_height`` (ellipsoidal m) and ``camera``, a calibration file, override ``params``. A
    pixel that cannot be located is written with its reason. ``smooth``: camera poses from all
    measurements, also later ones. Raise BagError, CameraError,
    ConfigError, SurveyError, ElevationError.
    """
    configs = node_configs(
        params, namespace, method=method, dem=dem, ground_height=ground_height, camera=camera
    )
    outputs = [path for path in (output, kml_out, cot_out) if path]
    check_outputs((bag_in, pixels, *paths_of(params), *configs.files), outputs, SurveyError)
    observations = load_observations(pixels)
    ground = ground_of(configs.overlay)
    if ground is None:
        raise ConfigError("height of the ground not known: give --ground-height or --dem")
    reader = BagReader(bag_in)
    how = (observations, ground, progress)
    answers, flown, findings = _located(reader, configs, params, namespace, *how, smooth=smooth)
    forms = {output: form_of(output), kml_out: "kml"}
    files: dict[PathLike, str | bytes]
    files = {path: exported_answers(answers, form) for path, form in forms.items() if path}
    if cot_out:
        files[cot_out] = cot(answers)
    write_files(files, SurveyError)
    return {
        "input": os.fspath(bag_in),
        "output": [os.fspath(path) for path in outputs],
        **flown,
        "findings": finding_items(findings),
        "error": _error(reader, answers) or stop_line(findings),
        **_summary(answers, ground),
    }


def convert_targets(
    targets_in: PathLike, output: PathLike, kml_out: PathLike | None = None
) -> dict[str, object]:
    """Write targets in the format that the output's name asks for, and as KML if asked.

    Return a summary. Raises TargetError naming the file.
    """
    outputs = [path for path in (output, kml_out) if path]
    check_outputs([targets_in], outputs, TargetError)
    try:
        targets = read_targets(targets_in)
    except TargetError as error:
        raise TargetError(f"{error} (a recorded flight needs --pixels)") from None
    forms = {output: form_of(output), kml_out: "kml"}
    files: dict[PathLike, str | bytes]
    files = {path: exported(targets, form) for path, form in forms.items() if path}
    write_files(files, TargetError)
    return {
        "input": os.fspath(targets_in),
        "output": [os.fspath(path) for path in outputs],
        "targets": len(targets),
    }


def _located(
    reader: BagReader,
    configs: NodeConfigs,
    params: Files,
    namespace: str,
    observations: Sequence[Observation],
    ground: Ground,
    progress: Report,
    *,
    smooth: bool,
) -> tuple[list[Answered], dict[str, object], list[Finding]]:
    """Read the flight; return the pixels' places, the flight's summary, and its findings."""
    fitted, notes = configs.fitting(reader, namespace)
    ekf, gimbal, overlay, _ = fitted
    lens, failed = given_camera(overlay), list[Finding]()
    layers = tried_map(failed, overlay, overlay.map, used=False)
    of_flight = (fitted, reader, params, namespace)
    checks = FlightChecks(*of_flight, ground=ground, layers=layers, camera=lens)
    checks.at_start += failed
    flight = Flight(reader, namespace, camera=lens, checks=checks)
    exposures_ns = [exposure_ns(pixel.stamp_ns, overlay.video_latency_s) for pixel in observations]
    poses = flight.registered(ekf, gimbal, exposures_ns, checks.watch, smooth=smooth)
    flight.read_all(progress)
    camera = flight.camera

    def answer(pixel: Observation, exposed_ns: int) -> Answer:
        uv, motion = (pixel.u, pixel.v), poses.at(exposed_ns)
        if motion is None or poses.plane is None:
            return Refusal(pixel.stamp_ns, uv, Reason.NO_POSE)
        pose, rates = motion
        where = (poses.plane, ground, overlay.confidence, rates)
        return replace(place(camera, pose, uv, *where), stamp_ns=pixel.stamp_ns)

    answers = [
        Answered(pixel.id, answer(pixel, exposed_ns))
        for pixel, exposed_ns in zip(observations, exposures_ns, strict=True)
    ]
    navigation = poses.registration.navigation.status()
    flown: dict[str, object] = {
        "method": navigation.method,
        "smoothed": smooth,
        "composition": poses.registration.composer.composition,
        "notes": notes,
        "state": navigation.state.value,
        "messages": flight.read.total(),
        "messages_refused": flight.refused,
    }
    return answers, flown, checks.findings()


def _summary(answers: Sequence[Answered], ground: Ground) -> dict[str, object]:
    """Return the numbers of pixels, the median length of the ellipses (m), and the warnings."""
    lengths = [answer.ellipse.major_m for _, answer in answers if isinstance(answer, Located)]
    reasons = _reasons(answers)
    notes = list(ground.notes) if isinstance(ground, Terrain) else []
    if reasons and lengths:
        why = ", ".join(f"{number} x {reason.value}" for reason, number in reasons.most_common())
        notes.append(f"{reasons.total()} of {len(answers)} pixels refused: {why}")
    return {
        "pixels": len(answers),
        "located": len(lengths),
        "refused": {reason.value: number for reason, number in reasons.items()},
        "ellipse_major_m_median": median(lengths) if lengths else None,
        "warning": "; ".join(notes) or None,
    }


def _reasons(answers: Sequence[Answered]) -> Counter[Reason]:
    return Counter(answer.reason for _, answer in answers if isinstance(answer, Refusal))


def _error(reader: BagReader, answers: Sequence[Answered]) -> str | None:
    """Return what makes the run a failure although there is an output, or None."""
    if reader.damage is not None:
        return f"{reader.path}: {reader.damage}; the points come from the rest"
    reasons = _reasons(answers)
    if not answers or reasons.total() < len(answers):
        return None
    most = reasons.most_common(1)[0][0]
    error = f"{reader.path}: none of {len(answers)} pixels could be located: {most.value}"
    if most is not Reason.NO_POSE:
        return error
    asked_ns = [answer.stamp_ns for _, answer in answers]
    first_ns, last_ns = reader.span_ns
    return (
        f"{error}; their stamps are {min(asked_ns)} to {max(asked_ns)} ns, and the bag was "
        f"recorded from {first_ns} to {last_ns}"
    )

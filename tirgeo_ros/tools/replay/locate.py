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
"""Locate pixels of a recorded flight on the ground: the work of ``tirgeo locate``.

The results are ground points with error ellipses. The same core objects compute the camera poses
in the nodes and in ``tirgeo process``.
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from statistics import median

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.ground.backprojection import Ground, Reason, Terrain
from tirgeo_ros.core.ground.ground_point import Answer, Located, Refusal, place
from tirgeo_ros.core.overlay.clicks import TEMPERATURE_SCALE, Thermal, thermal_of
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.errors import ConfigError, MessageError, SurveyError
from tirgeo_ros.core.types.finding import Finding, stop_line
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike, write_files
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.messages import pictures
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.topics import PICTURES, TEMPERATURES, resolved
from tirgeo_ros.io.parameters.parameter_file import Files
from tirgeo_ros.io.pictures.camera_file import configured_camera
from tirgeo_ros.io.surveys.survey import Answered, Observation, load_observations
from tirgeo_ros.io.targets.formats import exported_answers, form_of
from tirgeo_ros.tools.convert.direct_input import NO_OPTIONS
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.results import finding_items
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_checks import FlightChecks, try_load
from tirgeo_ros.tools.replay.flight_ties import flight_adjustment
from tirgeo_ros.tools.replay.node_configs import OpenedFlight, configured_layers, open_flight


def locate_pixels(
    bag: PathLike,
    pixels: PathLike,
    output: PathLike,
    *,
    params: Files = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    method: str | None = None,
    namespace: str = "",
    camera: PathLike | None = None,
    smooth: bool = False,
    adjust: bool = False,
    logs: LogOptions = NO_OPTIONS,
    progress: Report = silent,
) -> dict[str, object]:
    """Locate pixels of a flight's pictures; return a summary.

    ``pixels`` is a CSV ``id,stamp_ns,u,v``, or ``id,picture,u,v`` with the names of stills. The
    ending of ``output`` chooses the format; an unknown one means GeoJSON. ``dem`` or
    ``ground_height`` (ellipsoidal m) and ``camera``, a calibration file, override ``params``. A
    pixel that cannot be located is written with the reason. ``smooth``: camera poses use later
    measurements too; ``adjust``: what pictures show twice corrects them. Raise BagError,
    CameraError, ConfigError, SurveyError, ElevationError.
    """
    needed("mgrs", f"writing {os.fspath(output)}", SurveyError)
    options = {"method": method, "dem": dem, "ground_height": ground_height, "camera": camera}
    arguments = (bag, [output], params, namespace, options)
    opened = open_flight(
        *arguments, inputs=[pixels], error=SurveyError, logs=logs, progress=progress
    )
    observations = load_observations(pixels, opened.reader.stills())
    overlay = opened.configs.overlay
    ground = ground_of(overlay)
    if ground is None:
        raise ConfigError("height of the ground not known: give --ground-height or --dem")
    lens, unread = configured_camera(overlay), list[Finding]()
    layers = try_load(unread, "map", lambda: configured_layers(overlay), used=False)
    checks = FlightChecks(opened, ground=ground, layers=layers, camera=lens)
    checks.at_start += unread
    flight = Flight(opened.reader, namespace, camera=lens, checks=checks)
    exposures_ns = [exposure_ns(pixel.stamp_ns, overlay.video_latency_s) for pixel in observations]
    used = opened.configs.ekf, opened.configs.gimbal, exposures_ns
    adjustment, adjusted = flight_adjustment(opened, progress, adjust=adjust, smooth=smooth)
    poses = flight.registered(*used, checks.watch, smooth=smooth, adjustment=adjustment)
    flight.read_all(progress)
    answers = _answers(observations, exposures_ns, flight, poses, ground, opened)
    answers, unknown = _with_temperatures(answers, flight.camera, opened)
    write_files({output: exported_answers(answers, form_of(output))}, SurveyError)
    located = _summary(opened.reader, answers, ground)
    navigation, findings = poses.registration.navigation.status(), checks.findings()
    return {
        "input": os.fspath(bag),
        "output": os.fspath(output),
        "method": navigation.method,
        "smoothed": smooth,
        "composition": poses.registration.composer.composition,
        "notes": [*opened.notes, *adjusted, *unknown],
        "state": navigation.state.value,
        "messages": flight.read.total(),
        "messages_refused": flight.refused,
        "findings": finding_items(findings),
        **located,
        "error": located["error"] or stop_line(findings),
    }


def _answers(
    observations: Sequence[Observation],
    exposures_ns: Sequence[int],
    flight: Flight,
    poses: FlightPoses,
    ground: Ground,
    opened: OpenedFlight,
) -> list[Answered]:
    """Return for each pixel its place on the ground, or the reason why there is none."""
    camera, confidence = flight.camera, opened.configs.overlay.confidence

    def answer(pixel: Observation, exposed_ns: int) -> Answer:
        uv, motion = (pixel.u, pixel.v), poses.at(exposed_ns)
        if motion is None or poses.plane is None:
            return Refusal(pixel.stamp_ns, uv, Reason.NO_POSE)
        pose, rates = motion
        located = place(camera, pose, uv, poses.plane, ground, confidence, rates)
        return replace(located, stamp_ns=pixel.stamp_ns)

    pairs = zip(observations, exposures_ns, strict=True)
    return [Answered(pixel.id, answer(pixel, exposed_ns)) for pixel, exposed_ns in pairs]


def _with_temperatures(
    answers: Sequence[Answered], camera: Camera | None, opened: OpenedFlight
) -> tuple[list[Answered], list[str]]:
    """Return the answers with the temperatures at their pixels, and why some are unknown."""
    wanted = {answer.stamp_ns for _, answer in answers if isinstance(answer, Located)}
    scales = {TEMPERATURES: TEMPERATURE_SCALE} | dict.fromkeys(
        PICTURES, opened.configs.overlay.picture
    )
    topics = {resolved(t, opened.namespace): t for t, s in scales.items() if s.celsius_per_count}
    cdr = Cdr()
    thermals: dict[int, Thermal | None] = {}
    notes: dict[str, None] = {}  # each once, in order
    for message in opened.reader.messages(topics) if wanted else ():
        stamp_ns, topic = header_stamp_ns(message.data), topics[message.topic]
        if stamp_ns not in wanted or thermals.get(stamp_ns):
            continue
        try:
            content = cdr.deserialize(message.data, message.typename)
            thermals[stamp_ns] = thermal_of(pictures.pixels(topic, content), scales[topic])
        except MessageError as error:
            notes[f"temperatures: {error}"] = None

    def warmed(answer: Answer) -> Answer:
        thermal = thermals.get(answer.stamp_ns)
        if isinstance(answer, Refusal) or camera is None or thermal is None:
            return answer
        return replace(answer, temperature_c=thermal.celsius(answer.uv, camera))

    return [Answered(name, warmed(answer)) for name, answer in answers], list(notes)


def _summary(reader: BagReader, answers: Sequence[Answered], ground: Ground) -> dict[str, object]:
    """Return the numbers of pixels, the median length of the ellipses (m), warnings and error.

    The error tells why the run has failed although there is an output.
    """
    lengths = [answer.ellipse.major_m for _, answer in answers if isinstance(answer, Located)]
    reasons = Counter(answer.reason for _, answer in answers if isinstance(answer, Refusal))
    notes = list(ground.notes) if isinstance(ground, Terrain) else []
    error = None
    if reasons and lengths:
        why = ", ".join(f"{number} x {reason.value}" for reason, number in reasons.most_common())
        notes.append(f"{reasons.total()} of {len(answers)} pixels refused: {why}")
    elif reasons:
        most = reasons.most_common(1)[0][0]
        error = f"{reader.path}: none of {len(answers)} pixels could be located: {most.value}"
        if most is Reason.NO_POSE:
            asked_ns = [answer.stamp_ns for _, answer in answers]
            first_ns, last_ns = reader.span_ns
            error += (
                f"; their stamps are {min(asked_ns)} to {max(asked_ns)} ns, and the bag was "
                f"recorded from {first_ns} to {last_ns}"
            )
    if reader.damage is not None:
        error = f"{reader.path}: {reader.damage}; the points come from the readable part"
    return {
        "pixels": len(answers),
        "located": len(lengths),
        "refused": {reason.value: number for reason, number in reasons.items()},
        "ellipse_major_m_median": median(lengths) if lengths else None,
        "warning": "; ".join(notes) or None,
        "error": error,
    }

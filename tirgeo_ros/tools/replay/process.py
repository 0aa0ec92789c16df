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
"""Geo-register a recorded flight into a new bag: the work of ``tirgeo process``.

The nodes' core objects process the messages in the order of their log times, faster than real
time. The same input gives the same bytes.
"""

from __future__ import annotations

import contextlib
import math
import os
import time
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from tirgeo_ros.core.ground.backprojection import Terrain
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.types.errors import BagError, ConfigError
from tirgeo_ros.core.types.finding import Finding, stop_line
from tirgeo_ros.core.types.verdicts import QUIET, Outcome
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike, made_folder
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.messages.topics import PICTURES
from tirgeo_ros.io.parameters.parameter_file import Files
from tirgeo_ros.io.pictures.camera_file import configured_camera
from tirgeo_ros.io.video.video_file import VideoFile
from tirgeo_ros.tools.convert.direct_input import NO_OPTIONS
from tirgeo_ros.tools.presentation.progress import Report, silent, three
from tirgeo_ros.tools.presentation.results import finding_items, summary
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_checks import FlightChecks, try_load
from tirgeo_ros.tools.replay.flight_ties import flight_adjustment
from tirgeo_ros.tools.replay.node_configs import OpenedFlight, configured_layers, open_flight
from tirgeo_ros.tools.replay.picture_stage import PictureStage, available_cores
from tirgeo_ros.tools.replay.process_outputs import ProcessOutputs, ProcessSetup
from tirgeo_ros.tools.replay.registration import biases_of, done_without, has_rates, inputs_of
from tirgeo_ros.tools.replay.still_outputs import STILL_QUALITY, StillOutputs

#: A larger share of refused measurements of one kind is a problem: gates are at 4 and 5 sigma.
_MOST_REFUSED = 0.01
#: A line of the result for a person: name, text, whether it reports a problem.
Line = tuple[str, str, bool]


def process(
    bag_in: PathLike,
    bag_out: PathLike,
    *,
    params: Files = None,
    map: PathLike | None = None,  # noqa: A002 the option's name
    method: str | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    images: bool = True,
    raw_images: bool = False,
    video: PathLike | None = None,
    namespace: str = "",
    camera: PathLike | None = None,
    smooth: bool = False,
    adjust: bool = False,
    stills: PathLike | None = None,
    logs: LogOptions = NO_OPTIONS,
    progress: Report = silent,
    cores: int | None = None,
) -> dict[str, object]:
    """Process a bag and return a summary; a file gets its name only when it is complete.

    ``error`` in the summary is None, or tells what was lost of the bag, or a STOP of the checks.
    ``params`` are parameter files; ``map``, ``dem`` or ``ground_height`` (ellipsoidal m) and
    ``camera``, a calibration file, override them. ``images`` need the gimbal's topics. They are
    drawn if there is a map, or for ``raw_images`` or ``video``, in another process unless
    ``cores`` (None: as many as this process may use) is 1: the bytes are the same. ``smooth``:
    each pose uses later measurements too. ``adjust``: what pictures show twice corrects them.
    ``stills`` is a folder for pictures that were stills, drawn, with their contact page. Raise
    BagError (no bag, a needed topic absent, nothing readable), CameraError, ConfigError, MapError,
    ElevationError, PictureError, VideoError.
    """
    wanted = raw_images or video is not None
    if (wanted or stills is not None) and not images:
        raise ConfigError("raw_images, video and stills need images: leave out --no-images")
    if stills is not None:
        made_folder(stills, BagError)
    where = {"map": map, "dem": dem, "ground_height": ground_height}
    options = {"method": method, "camera": camera, **where}
    opened = open_flight(
        bag_in, (bag_out, video), params, namespace, options, logs=logs, progress=progress
    )
    draws = images and (wanted or stills is not None or bool(opened.configs.overlay.map))
    sheet = None
    if stills is not None:
        sheet, opened = StillOutputs(stills, opened.reader), _with_quality(opened)
    cores = available_cores() if cores is None else cores
    with PictureStage(cores if draws else 1) as stage:
        setup = _set_up(opened, images=images, draws=draws)._replace(stills=sheet)
        adjustment, adjusted = flight_adjustment(opened, progress, adjust=adjust, smooth=smooth)
        setup = setup._replace(notes=[*setup.notes, *adjusted])
        begun_s = time.perf_counter()
        if setup.overlay is not None:
            stage.begin(
                opened.configs.overlay, setup.overlay.painter.shaper.ground, keeps_images=wanted
            )
        files = (bag_out, video, progress, stage)
        poses = FlightPoses(
            opened.configs.ekf, opened.configs.gimbal, setup.topics.values(), adjustment=adjustment
        )
        flight, outputs, film = _run(setup, poses, *files, raw_images=raw_images, smooth=smooth)
    elapsed_s = time.perf_counter() - begun_s
    findings = setup.checks.findings()  # damage is in the error
    result = _summary(setup, flight, outputs)
    return {
        "input": os.fspath(bag_in),
        "output": os.fspath(bag_out),
        "smoothed": smooth,
        **result,
        "elapsed_s": elapsed_s,
        "speed": flight.duration_s / elapsed_s,
        "findings": finding_items(findings),
        "stills": sheet and sheet.finish(opened.refused),
        "video": film and {"frames": film.frames, "rate_hz": film.rate_hz},
        "error": _error(opened.reader, result) or stop_line(findings),
    }


def _with_quality(opened: OpenedFlight) -> OpenedFlight:
    """Return the flight with the JPEG quality of stills, unless the parameters set one."""
    if "jpeg_quality" in opened.configs.given:
        return opened
    overlay = replace(opened.configs.overlay, jpeg_quality=STILL_QUALITY)
    return opened._replace(configs=opened.configs._replace(overlay=overlay))


def _set_up(opened: OpenedFlight, *, images: bool, draws: bool) -> ProcessSetup:
    """Choose the topics, load the map on its ground, and set up the checks."""
    reader, configs, namespace = opened.reader, opened.configs, opened.namespace
    config, camera = configs.overlay, configured_camera(configs.overlay)
    needed = {"pictures": draws, "camera": camera is None, "gimbal": images}
    method, composition = configs.ekf.method, configs.gimbal.composition
    topics = inputs_of(reader, method, composition, namespace, **needed)
    unread: list[Finding] = []
    overlay: Overlay | None = None
    if draws:
        layers = configured_layers(config)
        ground = ground_of(config)
        terrain = ground if isinstance(ground, Terrain) else None
        overlay = Overlay(config, layers or (), terrain)
        if camera is not None:
            overlay.set_camera(camera)
    else:
        layers = try_load(unread, "map", lambda: configured_layers(config), used=False)
        ground = try_load(unread, "dem", lambda: ground_of(config), used=False)
    # If pictures are drawn, the checks get the map as it is draped for the pictures.
    to_drape = None if draws else layers
    checks = FlightChecks(opened, ground=ground, layers=to_drape, camera=camera)
    checks.at_start += unread
    notes = [*opened.notes, *(ground.notes if isinstance(ground, Terrain) else ())]
    notes += [note for layer in layers or () for note in layer.left_out]
    return ProcessSetup(opened, topics, overlay, checks, notes)


def _run(
    setup: ProcessSetup,
    poses: FlightPoses,
    bag_out: PathLike,
    video: PathLike | None,
    progress: Report,
    stage: PictureStage,
    *,
    raw_images: bool,
    smooth: bool,
) -> tuple[Flight, ProcessOutputs, VideoFile | None]:
    """Process all messages and write the outputs."""
    reader = setup.opened.reader
    with contextlib.ExitStack() as stack:
        film = stack.enter_context(VideoFile(video)) if video is not None else None
        writer = stack.enter_context(BagWriter(bag_out))
        flight = Flight(reader, setup.opened.namespace, checks=setup.checks, needs_camera=False)
        flight.add_poses(poses, smooth=smooth)
        outputs = ProcessOutputs(setup, flight, poses, writer, film, stage, raw_images=raw_images)
        poses.watchers += [setup.checks.watch, outputs.watch]
        flight.read_all(progress, outputs)
        if not flight.read:
            because = f": {reader.damage}" if reader.damage else ""
            raise BagError(f"{reader.path}: no message could be read{because}")
        outputs.finish(flight.now_ns)
    return flight, outputs, film


def _summary(setup: ProcessSetup, flight: Flight, outputs: ProcessOutputs) -> dict[str, object]:
    """Return counts and notes of the messages that were read, and of the outputs."""
    reader, names, overlay = setup.opened.reader, setup.topics.values(), setup.overlay
    absent, namespace = "", setup.opened.namespace
    if has_rates(reader, namespace):  # else each attitude has its position, without a velocity
        absent = done_without(names, setup.opened.configs.ekf.method, namespace)
    without = f"{reader.path} has no {absent}: continuing without it" if absent else None
    notes = [*setup.notes]
    if not any(name.startswith("gimbal/") for name in names):
        notes.append("the bag has no gimbal topic: no camera poses")
    status, composer = outputs.registration.navigation.status(), outputs.registration.composer
    north_deg = math.degrees(math.sqrt(composer.north.variance))
    return {
        "warning": without,
        "method": status.method,
        "composition": composer.composition,
        "duration_s": flight.duration_s,
        "read": dict(flight.read),
        "undecodable": dict(flight.undecoded),
        "unreadable": dict(flight.unreadable),
        "unreadable_because": dict(flight.unreadable_because),
        "stamped_at_arrival": flight.arrivals.counts,
        "written": dict(outputs.written),
        "state": status.state.value,
        "reason": status.reason,
        "states_s": dict(outputs.states_s),
        "verdicts": {f"{a} {b}": number for (a, b), number in status.counts.items()},
        "imu": biases_of(outputs.registration.navigation),
        "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
        "imu_delay_s": status.imu_delay_s,
        "imu_delay_sigma_s": status.imu_delay_sigma_s,
        "north_sigma_deg": None if composer.composition == "encoders" else north_deg,
        "gimbal": composer.counts,
        "overlay": {} if overlay is None else overlay.counts,
        "notes": notes if overlay is None else [*notes, *overlay.notes],
    }


def _error(reader: BagReader, result: Mapping[str, Any]) -> str | None:
    """Return what was lost of the bag, or why there is no pose; None without an error."""
    if reader.damage is not None:
        return f"{reader.path}: {reader.damage}; the output is made from the readable part"
    if not any(name.endswith("tirgeo/odometry") for name in result["written"]):
        return f"{reader.path}: no pose was computed: {result['reason'] or 'see verdicts'}"
    return None


def six_lines(result: Mapping[str, Any]) -> str:
    """Return six lines for a person; the lines that report a problem are first."""
    read, written = result["read"], result["written"]
    text = f"{three(result['duration_s'])} s of {result['input']} in "
    text += f"{three(result['elapsed_s'])} s, {three(result['speed'])}x real time"
    lines: list[Line] = [("read", f"{text}; {sum(read.values())} messages", False)]
    times = Counter(result["states_s"]).most_common()
    reason = f" ({result['reason']})" if result["reason"] else ""
    method = f"{result['method']}{', smoothed' if result['smoothed'] else ''}"
    text = f"{result['state']} at the end{reason}, by {method}; in all "
    text += ", ".join(f"{state} {seconds} s" for state, seconds in times)
    lines.append(("state", text, result["state"] not in ("running", "degraded")))
    body, camera = (
        sum(count for topic, count in written.items() if topic.endswith(f"tirgeo/{name}"))
        for name in ("odometry", "camera_pose")
    )
    sigma_deg = result["heading_sigma_deg"]
    heading = f", heading to {three(sigma_deg)} deg" if math.isfinite(sigma_deg) else ""
    if result["north_sigma_deg"] is not None:
        heading += f", the gimbal's north to {three(result['north_sigma_deg'])} deg"
    is_wrong = not body or (bool(result["overlay"]) and not camera)
    lines.append(("poses", f"{body} of the body, {camera} of the camera{heading}", is_wrong))
    lines += [_frames_line(result), refused_line(result)]
    text = f"{result['output']}, {three(Path(result['output']).stat().st_size / 1e6)} MB"
    if film := result["video"]:
        text += f", and a video of {film['frames']} frames at {film['rate_hz']:.3g} Hz"
    if sheet := result.get("stills"):
        text += f"; {sheet['drawn']} of {sheet['stills']} stills drawn: {sheet['page']}"
    if notes := result["notes"]:
        text += f"; {notes[0]}"
        text += f" (and {len(notes) - 1} more, with --json)" if len(notes) > 1 else ""
    return summary([*lines, ("output", text, False)])


def _frames_line(result: Mapping[str, Any]) -> Line:
    """Return a line: how many frames have a trusted pose, and how many show a notice instead."""
    counts = result["overlay"]
    if not counts:
        return "frames", "not drawn: give --map or --video, without --no-images", False
    drawn, notices = counts["drawn"], counts["notices"]
    read = sum(n for topic, n in result["read"].items() if topic.endswith(PICTURES))
    lost = f", {read - drawn - notices} lost" if read > drawn + notices else ""
    text = f"{drawn} of {read} with a trusted pose, {notices} with a notice why not{lost}"
    return "frames", text, drawn < notices or bool(lost)


def refused_line(result: Mapping[str, Any]) -> Line:
    """Return a line: refused measurements by source and outcome, unreadable messages by topic."""
    taken: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    parts: list[tuple[str, str, int]] = []
    for name, number in result["verdicts"].items():
        source, outcome = name.split(" ")
        taken[source] += number
        if Outcome(outcome) not in QUIET:
            refused[source] += number
            parts.append((source, outcome.replace("_", " "), number))
    texts = [f"{source} {number} of {taken[source]} {what}" for source, what, number in parts]
    unreadable = Counter(result["undecodable"]) + Counter(result["unreadable"])
    for topic, number in unreadable.items():
        because = result["unreadable_because"].get(topic)
        texts.append(f"{topic} {number} unreadable{f' ({because})' if because else ''}")
    many = any(number > _MOST_REFUSED * taken[source] for source, number in refused.items())
    return "refused", "; ".join(texts) or "nothing", many or bool(unreadable)

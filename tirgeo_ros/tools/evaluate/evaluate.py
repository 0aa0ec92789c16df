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
"""Locate every observed control point of a flight under every method (section 5.1)."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from tirgeo_ros.core.adjustment.adjustment import Adjustment
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.errors import BagError, CalibrationError
from tirgeo_ros.core.types.finding import stop_line
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.messages.topics import resolved
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import configured_camera
from tirgeo_ros.tools.convert.direct_input import NO_OPTIONS, open_input
from tirgeo_ros.tools.evaluate.experiment import (
    Experiment,
    MethodSetup,
    input_notes,
    load_experiment,
    method_setups,
    setup_notes,
)
from tirgeo_ros.tools.evaluate.report import SETTLED_S, check_folder, place_note
from tirgeo_ros.tools.evaluate.result import (
    Evaluation,
    MethodResult,
    TruePoses,
    body_errors,
    load_truth,
    locate_observations,
)
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_ties import flight_adjustment
from tirgeo_ros.tools.replay.node_configs import OpenedFlight, configured_layers, node_configs
from tirgeo_ros.tools.replay.registration import (
    FILTERS,
    Registered,
    Sample,
    done_without,
)

#: Topics that a method must have. Without them the filter would still run, on ordinary GPS.
_ESSENTIAL = {"ekf": ("rtk/fix",), "ekf_heading": ("rtk/fix", "rtk/heading")}


@dataclass
class _Run:
    """Run one method over the flight; with a truth, keep all body poses, in the truth's plane."""

    setup: MethodSetup
    truth: TruePoses | None
    adjustment: Adjustment | None = None
    has_poses: bool = False
    bodies: list[BodyPose] = field(default_factory=list)
    poses: FlightPoses = field(init=False)

    @property
    def ekf_method(self) -> str:
        """Return the filter's method: that of ``calibrated`` is ``ekf_heading``."""
        return self.setup.configs.ekf.method

    def watch(self, _sample: Sample, registered: Registered) -> None:
        """Take the poses that were computed from a sample."""
        self.has_poses = self.has_poses or bool(registered.cameras)
        if self.truth is not None and registered.solution is not None:
            self.bodies.append(self.truth.plane.body_pose(registered.solution))

    def result(self, camera: Camera, experiment: Experiment) -> MethodResult:
        """Return the method's results."""
        poses, setup, truth = self.poses, self.setup, self.truth
        assert poses.plane is not None
        located, refused = locate_observations(
            poses.cameras, poses.plane, camera, experiment, setup.ground, setup.configs.overlay
        )
        composition = poses.registration.composer.composition
        state = poses.registration.navigation.status().state.value
        against_truth = None if truth is None else body_errors(self.bodies, truth, SETTLED_S)
        return MethodResult(setup, composition, state, located, refused, against_truth)


def evaluate(
    bag: PathLike,
    survey: PathLike,
    observations: PathLike,
    *,
    output: PathLike | None = None,
    params: Files = None,
    boresight: PathLike | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    namespace: str = "",
    truth: PathLike | None = None,
    camera: PathLike | None = None,
    smooth: bool = False,
    adjust: bool = False,
    logs: LogOptions = NO_OPTIONS,
    progress: Report = silent,
) -> Evaluation:
    """Locate the observations of a bag under every method, in one pass through it.

    ``output`` is the folder that ``write_evaluation`` will write: it is checked first.
    ``boresight``, one more parameter file, adds the method ``calibrated``. ``dem`` or
    ``ground_height`` (ellipsoidal m) and ``camera`` override the parameters; if none gives a
    ground, it is level at the median of the observed points' heights. A method whose topics the
    bag lacks is reported as missing. ``smooth``: filter poses use later measurements
    too. ``adjust``: what pictures show twice corrects the camera's poses.
    Raise BagError, CameraError, ConfigError, SurveyError, ElevationError, MapError, and
    CalibrationError if no method can be run.
    """
    needed("scipy", "comparing the methods", CalibrationError)
    inputs = [*paths_of(params), *paths_of(boresight)]
    places: dict[str, Any] = {"dem": dem, "ground_height": ground_height, "camera": camera}
    if output is not None:
        needed("matplotlib", f"drawing the report in {output}", CalibrationError)
        configs = node_configs(inputs, namespace, **places)
        check_folder(output, (bag, survey, observations, truth, *inputs, *configs.files))
    read = open_input(bag, params, namespace, logs, progress)
    reader, params, files = read.reader, read.params, [*read.params, *paths_of(boresight)]
    experiment = load_experiment(survey, observations, reader.stills())
    heights_m = experiment.heights_m
    setups = method_setups(params, boresight, namespace, heights_m, places)
    setups = [replace(s, configs=s.configs.for_bag(reader, namespace)[0]) for s in setups]
    last = setups[-1]  # the checks use its parameters
    overlay = last.configs.overlay
    lens, layers = configured_camera(overlay), configured_layers(overlay)
    opened = OpenedFlight(reader, last.configs, files, namespace, [])
    checks = FlightChecks(opened, ground=last.ground, layers=layers or None, camera=lens)
    flight = Flight(reader, namespace, pictures=True, camera=lens, checks=checks)
    true_poses = None if truth is None else load_truth(Path(truth))
    runs = [_Run(setup, true_poses) for setup in setups]
    adjusted = _adjust(runs, opened, progress, smooth=smooth) if adjust else []
    runs, missing = _read(runs, flight, checks, experiment, reader, namespace, smooth, progress)
    methods = [run.result(flight.camera, experiment) for run in runs]
    notes = [
        *read.notes,
        *adjusted,
        *setup_notes(setups, heights_m),
        *_run_notes(runs, namespace, smooth=smooth),
        *(f"{method} is left out: {why}" for method, why in missing.items()),
        *input_notes(experiment, flight.picture_stamps_ns),
        *filter(None, [place_note(methods)]),
    ]
    findings = checks.findings()
    error = _error(reader, methods) or stop_line(findings)
    paths = os.fspath(bag), os.fspath(survey), os.fspath(observations)
    return Evaluation(*paths, experiment, methods, missing, notes, error, findings, smooth)


def _adjust(
    runs: Sequence[_Run], opened: OpenedFlight, progress: Report, *, smooth: bool
) -> list[str]:
    """Find the correction of each method's camera poses by ties; return notes."""
    notes = []
    for run in runs:
        own = opened._replace(configs=run.setup.configs)
        smoothed = smooth and run.ekf_method in FILTERS
        run.adjustment, why = flight_adjustment(own, progress, adjust=True, smooth=smoothed)
        notes += [f"{run.setup.method}: {note}" for note in why]
    return notes


def _run_notes(runs: Sequence[_Run], namespace: str, *, smooth: bool) -> Iterator[str]:
    """Yield notes on topics that methods lack, and on methods that cannot be smoothed."""
    for run in runs:
        absent = done_without(run.poses.topics, run.ekf_method, namespace)
        if absent:
            yield f"{run.setup.method}: {absent} absent: continuing without it"
    if smooth and runs[0].ekf_method not in FILTERS:
        yield "raw and rtk are not smoothed: they have no filter"


def _read(
    runs: Sequence[_Run],
    flight: Flight,
    checks: FlightChecks,
    experiment: Experiment,
    reader: BagReader,
    namespace: str,
    smooth: bool,
    progress: Report,
) -> tuple[list[_Run], dict[str, str]]:
    """Read the flight; return the methods that have poses, and why the others are missing."""
    missing: dict[str, str] = {}
    for run in runs:
        reason = _begin(run, flight, experiment, namespace, smooth=smooth)
        if reason:
            missing[run.setup.method] = reason.removeprefix(f"{reader.path}: ")
    runs = _remaining(runs, missing, reader)
    runs[-1].poses.watchers.append(checks.watch)
    flight.read_all(progress)
    for run in runs:
        if run.poses.plane is None or not run.has_poses:
            reason = run.poses.registration.navigation.status().reason
            missing[run.setup.method] = f"no camera pose could be computed: {reason}"
    return _remaining(runs, missing, reader), missing


def _begin(
    run: _Run, flight: Flight, experiment: Experiment, namespace: str, *, smooth: bool
) -> str:
    """Begin a method's run; return an error if the bag lacks a topic that it needs."""
    ekf, gimbal, overlay, _ = run.setup.configs
    lacking = [topic for topic in _ESSENTIAL.get(run.ekf_method, ()) if not flight.has(topic)]
    if lacking:
        return f"needed topic absent: {', '.join(resolved(name, namespace) for name in lacking)}"
    instants_ns = [
        exposure_ns(click.stamp_ns, overlay.video_latency_s) for click in experiment.observations
    ]
    smooth = smooth and run.ekf_method in FILTERS
    try:
        run.poses = flight.registered(
            ekf, gimbal, instants_ns, run.watch, smooth=smooth, adjustment=run.adjustment
        )
    except BagError as error:
        return str(error)
    return ""


def _remaining(runs: Sequence[_Run], missing: dict[str, str], reader: BagReader) -> list[_Run]:
    """Return the runs that are not missing. Raise CalibrationError with the reasons if all are."""
    remaining = [run for run in runs if run.setup.method not in missing]
    if remaining:
        return remaining
    by_reason: dict[str, list[str]] = {}
    for method, reason in missing.items():
        by_reason.setdefault(reason, []).append(method)
    text = "; ".join(f"{', '.join(names)}: {why}" for why, names in by_reason.items())
    raise CalibrationError(f"{reader.path}: no method can be run: {text}")


def _error(reader: BagReader, methods: Sequence[MethodResult]) -> str | None:
    """Return why the run has failed although there is a result, or None."""
    if reader.damage is not None:
        return f"{reader.path}: {reader.damage}; the numbers come from the readable part"
    if not any(each.located for each in methods):
        reason = methods[-1].refused[0].reason
        return f"{reader.path}: no observation could be located: {reason}"
    return None

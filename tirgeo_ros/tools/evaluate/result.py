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
"""Locate the observed control points under a method, and hold the results of the experiment.

East and north are metres in one projected plane (``Experiment.projection``). Stamps are int ns.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.accuracy.ground_errors import GroundErrors
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat, wrap_pi
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground, Reason
from tirgeo_ros.core.ground.ground_point import Ellipse, Refusal, ellipse_of, place
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.tools.evaluate.experiment import Experiment, MethodSetup
from tirgeo_ros.tools.replay.flight import WHOLE_FLIGHT_S, pose_at

#: Differences that vary by less are taken as equal: a nanometre is rounding.
_ALIKE_M = 1e-9


@dataclass(frozen=True, slots=True)
class LocatedPoint:
    """Hold one observation of a control point, located on the ground by one method."""

    id: str
    stamp_ns: int  # of the picture
    uv: tuple[float, float]  # column, row, px
    place_en: Array  # (2,)
    height_m: float  # ellipsoidal height of the ground at this place
    error_en: Array  # (2,) located minus surveyed, m
    covariance_en: Array  # (2, 2) of the located point, as the method predicts it, m2
    ellipse: Ellipse  # 95 % ellipse; azimuth from the plane's north

    @property
    def is_inside(self) -> bool:
        """Return whether the surveyed position is inside the 95 % ellipse."""
        squared = self.error_en @ np.linalg.solve(self.covariance_en, self.error_en)
        return bool(squared <= CHI2_95)


def ground_errors(located: Sequence[LocatedPoint]) -> GroundErrors:
    """Return the horizontal errors of located points."""
    errors_en = np.array([point.error_en for point in located]).reshape(-1, 2)
    return GroundErrors([point.id for point in located], errors_en)


class RefusedPoint(NamedTuple):
    """Hold one observation that a method could not locate."""

    id: str
    stamp_ns: int
    uv: tuple[float, float]
    reason: str


def locate_observations(
    poses: PoseBuffer[CameraPose],
    plane: TangentPlane,
    camera: Camera,
    experiment: Experiment,
    ground: Ground,
    overlay: OverlayConfig,
) -> tuple[list[LocatedPoint], list[RefusedPoint]]:
    """Locate every observation of a control point (Eq. 23); other observations are left out.

    ``poses`` are in ``plane`` and cover the observations. An observation is located from the pose
    at its picture's exposure, which is its stamp minus ``overlay.video_latency_s``.
    """
    located: list[LocatedPoint] = []
    refused: list[RefusedPoint] = []
    project = experiment.projection.project
    for click in experiment.observations:
        point = experiment.survey.get(click.id)
        if point is None:
            continue
        lead = click.id, click.stamp_ns, (click.u, click.v)
        motion = pose_at(poses, exposure_ns(click.stamp_ns, overlay.video_latency_s))
        if motion is None:
            refused.append(RefusedPoint(*lead, Reason.NO_POSE.value))
            continue
        pose, rates = motion
        result = place(camera, pose, lead[2], plane, ground, overlay.confidence, rates)
        if isinstance(result, Refusal):
            refused.append(RefusedPoint(*lead, result.reason.value))
            continue
        place_en = project(result.latitude_rad, result.longitude_rad)
        axes = experiment.projection.local_axes(result.latitude_rad, result.longitude_rad)
        error_en = place_en - project(point.latitude_rad, point.longitude_rad)
        covariance_en = axes @ result.covariance_n[:2, :2] @ axes.T
        ellipse = ellipse_of(covariance_en[::-1, ::-1])
        height_m = result.height_m
        located.append(LocatedPoint(*lead, place_en, height_m, error_en, covariance_en, ellipse))
    return located, refused


@dataclass(frozen=True)
class TruePoses:
    """Hold the true poses of a flight and their tangent plane."""

    plane: TangentPlane
    bodies: PoseBuffer[BodyPose]


def load_truth(path: Path) -> TruePoses:
    """Read ``tirgeo/odometry`` and ``tirgeo/origin`` of a bag. Raise BagError without them."""
    cdr, plane = Cdr(), None
    bodies: PoseBuffer[BodyPose] = PoseBuffer(WHOLE_FLIGHT_S)
    for item in BagReader(path).messages(["/tirgeo/origin", "/tirgeo/odometry"]):
        message = cdr.deserialize(item.data, item.typename)
        if item.topic == "/tirgeo/origin":
            plane = convert.tangent_plane(message)
        else:
            bodies.add(convert.body_pose(message))
    if plane is None or not len(bodies):
        raise BagError(f"{path}: needed topic absent: /tirgeo/origin or /tirgeo/odometry")
    return TruePoses(plane, bodies)


@dataclass(frozen=True, slots=True)
class BodyErrors:
    """Hold root mean square errors against the truth."""

    roll_rad: float
    pitch_rad: float
    heading_rad: float
    position_m: float  # in space


def body_errors(bodies: Sequence[BodyPose], truth: TruePoses, after_s: float) -> BodyErrors:
    """Return the errors of poses in the truth's plane, from ``after_s`` after the first pose."""
    pairs = [
        (pose, true)
        for pose in bodies
        if pose.stamp_ns >= bodies[0].stamp_ns + after_s * 1e9
        and isinstance(true := truth.bodies.at(pose.stamp_ns), BodyPose)
    ]
    if not pairs:
        return BodyErrors(math.nan, math.nan, math.nan, math.nan)
    angles, true_angles = (
        euler_from_quat(np.array([pair[k].q_nb for pair in pairs])) for k in (0, 1)
    )
    roll, pitch, heading = np.sqrt(np.mean(wrap_pi(angles - true_angles) ** 2, axis=0)).tolist()
    apart = np.array([pose.position_n - true.position_n for pose, true in pairs])
    return BodyErrors(roll, pitch, heading, float(np.sqrt(np.mean(np.sum(apart**2, axis=1)))))


@dataclass(frozen=True)
class MethodResult:
    """Hold the experiment's result under one method."""

    setup: MethodSetup
    composition: str  # of the gimbal: paper or encoders
    state: str  # the filter's at the end
    located: Sequence[LocatedPoint]
    refused: Sequence[RefusedPoint]
    #: Errors of the body's poses after the filter has settled; None without a truth.
    against_truth: BodyErrors | None

    @property
    def method(self) -> str:
        """Return the method's name."""
        return self.setup.method

    @cached_property
    def errors(self) -> GroundErrors:
        """Return the horizontal errors of the located points."""
        return ground_errors(self.located)


@dataclass(frozen=True)
class Evaluation:
    """Hold the whole experiment."""

    bag: str
    survey_path: str
    observations_path: str
    experiment: Experiment
    methods: Sequence[MethodResult]  # those that could be run, in the order of the paper
    missing: Mapping[str, str]  # method -> the reason why it could not be run
    notes: Sequence[str]
    error: str | None  # why the run has failed although there is a result
    findings: Sequence[Finding]  # problems of set-up or sensors, the worst first
    smoothed: bool = False

    @cached_property
    def tests(self) -> list[PairedTest]:
        """Return the comparison of each pair of methods."""
        return paired_tests({each.method: each.errors.point_rmse_m for each in self.methods})

    def method(self, name: str) -> MethodResult | None:
        """Return a method by its name, or None if it is missing."""
        return next((each for each in self.methods if each.method == name), None)


class PairedTest(NamedTuple):
    """Hold the comparison of two methods over the points that both have located."""

    first: str
    second: str
    points: int
    mean_difference_m: float | None  # first minus second
    t: float | None
    p_value: float | None  # two-sided
    note: str  # why there is no p-value, else empty


def paired_tests(errors_m: Mapping[str, Mapping[str, float]]) -> list[PairedTest]:
    """Compare each pair of methods once, in order; ``errors_m`` is method -> point -> error."""
    from scipy import stats  # noqa: PLC0415  slow to import

    tests = []
    for first, second in combinations(errors_m, 2):
        common = sorted(errors_m[first].keys() & errors_m[second].keys())
        columns = [np.array([errors_m[m][point] for point in common]) for m in (first, second)]
        apart_m = columns[0] - columns[1]
        mean_m = float(apart_m.mean()) if common else None
        t, p_value, note = None, None, ""
        if len(common) < 2:
            note = "fewer than 2 points"
        elif np.ptp(apart_m) <= _ALIKE_M:
            note = "all differences are equal"
        else:
            test = stats.ttest_rel(*columns)
            t, p_value = float(test.statistic), float(test.pvalue)
        tests.append(PairedTest(first, second, len(common), mean_m, t, p_value, note))
    return tests

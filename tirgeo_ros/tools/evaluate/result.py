"""Locate the observed control points under a method, and hold the results of the experiment.

East and north are metres in one projected plane (``Evaluation.projection``). Stamps are int ns.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.accuracy.ground_errors import GroundErrors
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CHI2_95, CameraRates, pixel_jacobian
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground, Reason
from tirgeo_ros.core.ground.ground_point import Ellipse, Refusal, ellipse_of, place
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.surveys.survey import SurveyPoint
from tirgeo_ros.tools.evaluate.experiment import Experiment, MethodSetup, Projection
from tirgeo_ros.tools.evaluate.series import BodyErrors, Track
from tirgeo_ros.tools.replay.flight import pose_at

#: Differences within this are equal: a nanometre is rounding.
_ALIKE_M = 1e-9


class PixelMoves(NamedTuple):
    """Hold one observation's pixel offset, and the effect on it of each cause of an error.

    The causes are ``boresight`` (rad about the camera's right, down and forward), ``latency`` (s
    later than assumed), ``datum`` (m east, north from the surveyed to the located points) and
    ``height`` (m by which the assumed ground is too high).
    """

    offset_px: Array  # (2,) observed less predicted, column and row
    by: Mapping[str, Array]  # (2, k) px per unit of the cause


@dataclass(frozen=True, slots=True)
class LocatedPoint:
    """Hold one observation of a control point, located on the ground by one method."""

    id: str
    stamp_ns: int  # of the picture
    uv: tuple[float, float]  # column, row, px
    place_en: Array  # (2,)
    height_m: float  # ellipsoidal height of the ground there
    error_en: Array  # (2,) located minus surveyed, m
    covariance_en: Array  # (2, 2) of the located point, as the method predicts it, m2
    ellipse: Ellipse  # 95 % ellipse; azimuth from the plane's north
    moves: PixelMoves | None = None  # None if the camera cannot see the surveyed point

    @property
    def is_inside(self) -> bool:
        """Return whether the surveyed position is inside the 95 % ellipse."""
        squared = self.error_en @ np.linalg.solve(self.covariance_en, self.error_en)
        return bool(squared <= CHI2_95)


def ground_errors(located: Sequence[LocatedPoint]) -> GroundErrors:
    """Return the horizontal errors of located points."""
    errors_en = np.array([one.error_en for one in located]).reshape(-1, 2)
    return GroundErrors([one.id for one in located], errors_en)


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
    given: Experiment,
    ground: Ground,
    overlay: OverlayConfig,
) -> tuple[list[LocatedPoint], list[RefusedPoint]]:
    """Locate every observation of a control point (Eq. 23); other observations are left out.

    ``poses`` are in ``plane`` and cover the observations. The pose of an observation is that of
    its picture's exposure: the stamp minus ``overlay.video_latency_s``.
    """
    located, refused = [], []
    for seen in given.observations:
        point, uv = given.control.get(seen.id), (seen.u, seen.v)
        if point is None:
            continue
        motion = pose_at(poses, exposure_ns(seen.stamp_ns, overlay.video_latency_s))
        if motion is None:
            refused.append(RefusedPoint(seen.id, seen.stamp_ns, uv, Reason.NO_POSE.value))
            continue
        pose, rates = motion
        found = place(camera, pose, uv, plane, ground, overlay.confidence, rates)
        if isinstance(found, Refusal):
            refused.append(RefusedPoint(seen.id, seen.stamp_ns, uv, found.reason.value))
            continue
        here = found.latitude_rad, found.longitude_rad
        place_en, axes = given.projection.project(*here), given.projection.local_axes(*here)
        covariance_en = axes @ found.covariance_n[:2, :2] @ axes.T
        there = point.latitude_rad, point.longitude_rad
        surveyed_n = plane.ned_from_geodetic(*there, found.height_m)
        located.append(
            LocatedPoint(
                seen.id,
                seen.stamp_ns,
                uv,
                place_en,
                found.height_m,
                place_en - given.projection.project(*there),
                covariance_en,
                ellipse_of(covariance_en[::-1, ::-1]),
                pixel_moves(camera, pose, rates, uv, surveyed_n),
            )
        )
    return located, refused


def pixel_moves(
    camera: Camera,
    pose: CameraPose,
    rates: CameraRates | None,
    uv: tuple[float, float],
    surveyed_n: Array,
) -> PixelMoves | None:
    """Return one observation's moves; None if the camera cannot see the surveyed point.

    ``surveyed_n`` (3,) is the surveyed point at the height of the assumed ground, NED in the
    pose's plane. Without ``rates`` latency is not considered.
    """
    rotation_nc = matrix_from_quat(pose.q_nc)
    predicted, _ = camera.project((surveyed_n - pose.position_n)[None] @ rotation_nc)
    by_pose, by_point = (both[0] for both in pixel_jacobian(camera, pose, surveyed_n))
    if not (np.isfinite(predicted).all() and np.isfinite(by_pose).all()):
        return None
    by = {
        "boresight": by_pose[:, 3:] @ rotation_nc,
        "datum": by_point[:, [1, 0]],
        "height": by_point[:, 2:],
    }
    if rates is not None:
        by["latency"] = -(by_pose @ np.concatenate(rates))[:, None]
    return PixelMoves(np.array(uv) - predicted[0], by)


@dataclass(frozen=True)
class MethodResult:
    """Hold the experiment's result under one method."""

    setup: MethodSetup
    composition: str  # of the gimbal: paper or encoders
    state: str  # the filter's at the end
    located: Sequence[LocatedPoint]
    refused: Sequence[RefusedPoint]
    track: Track  # of the aircraft
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
    projection: Projection
    control: Mapping[str, SurveyPoint]  # every surveyed point by its id
    receivers: Mapping[str, Track]  # of the antennas, by source
    methods: Sequence[MethodResult]  # those that could be run, in the order of the paper
    missing: Mapping[str, str]  # method -> the reason why it could not be run
    tests: Sequence[PairedTest]  # each pair of ``methods`` once
    stills: Sequence[tuple[str, bytes]]  # captions, JPEG; of the last method
    notes: Sequence[str]
    error: str | None  # what makes the run a failure although there is a result
    findings: Sequence[Finding]  # problems of set-up or sensors, the worst first
    smoothed: bool = False

    @cached_property
    def places_en(self) -> Array:
        """Return the places (P, 2) of the surveyed points."""
        geodetic = [(one.latitude_rad, one.longitude_rad) for one in self.control.values()]
        return self.projection.project(*np.transpose(geodetic))

    def method(self, name: str) -> MethodResult | None:
        """Return a method by its name, or None if it is missing."""
        return next((one for one in self.methods if one.method == name), None)


class PairedTest(NamedTuple):
    """Hold the comparison of two methods over the points that both have."""

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
        columns = [np.array([errors_m[one][point] for point in common]) for one in (first, second)]
        apart_m = columns[0] - columns[1]
        mean_m = float(apart_m.mean()) if common else None
        t, p_value, note = None, None, ""
        if len(common) < 2:
            note = "fewer than 2 points"
        elif np.ptp(apart_m) <= _ALIKE_M:
            note = "all differences are alike"
        else:
            found = stats.ttest_rel(*columns)
            t, p_value = float(found.statistic), float(found.pvalue)
        tests.append(PairedTest(first, second, len(common), mean_m, t, p_value, note))
    return tests

"""Collect series over a flight for plots: poses, attitudes, fixes, innovations, thinned."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from typing import final

import numpy as np

from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import (
    euler_from_quat,
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.streams.rates import RateLimit
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    ImuSample,
    PositionSample,
    Source,
)
from tirgeo_ros.core.types.poses import BodyPose, CameraPose, NavSolution
from tirgeo_ros.core.types.verdicts import Verdict
from tirgeo_ros.tools.evaluate.projection import Projection
from tirgeo_ros.tools.evaluate.result import (
    SERIES_HZ,
    AttitudeSeries,
    FixTrack,
    Innovations,
    PoseTrack,
    Sensors,
)
from tirgeo_ros.tools.replay.recorded_flight import BodyErrors, TruePoses, body_errors
from tirgeo_ros.tools.replay.registration import Registered, Sample

#: Settling time of the filter; errors count only after it.
SETTLED_S = 20.0
_Q_OPTICAL_BODY = quat_conjugate(Q_BODY_OPTICAL)


@final
class MethodSeries:
    """Collect a method's results over a flight; a Watcher.

    With a truth, which only simulated flights have, every body pose is compared with it.
    """

    def __init__(self, truth: TruePoses | None = None) -> None:
        self._truth = truth
        self._bodies: list[BodyPose] = []  # in the truth's plane
        self._solutions: list[NavSolution] = []
        self._cameras: list[CameraPose] = []
        self._pending: list[Verdict] = []
        self._verdicts: defaultdict[Source, list[tuple[int, Verdict]]] = defaultdict(list)
        self._solution_rate, self._camera_rate = RateLimit(SERIES_HZ), RateLimit(SERIES_HZ)

    def heard(self, verdict: Verdict) -> None:
        """Keep a verdict that has an innovation."""
        if verdict.innovation and math.isfinite(verdict.test_ratio):
            self._pending.append(verdict)

    def took(self, sample: Sample, found: Registered) -> None:
        """Stamp the verdicts, and keep poses at their rate."""
        for verdict in self._pending:
            self._verdicts[verdict.source].append((sample.stamp_ns, verdict))
        self._pending.clear()
        solution = found.solution
        if solution is not None and self._solution_rate.due(solution.stamp_ns):
            self._solutions.append(solution)
        if solution is not None and self._truth is not None:
            self._bodies.append(self._truth.plane.body_pose(solution))
        self._cameras += [one for one in found.cameras if self._camera_rate.due(one.stamp_ns)]

    @property
    def has_poses(self) -> bool:
        """Return whether there was any camera pose."""
        return bool(self._cameras)

    def body_errors(self) -> BodyErrors | None:
        """Return the errors of the body's poses after settling; None without a truth."""
        return None if self._truth is None else body_errors(self._bodies, self._truth, SETTLED_S)

    def body(self, projection: Projection) -> PoseTrack:
        """Return the poses of the body."""
        found = self._solutions
        return _track(
            [s.stamp_ns for s in found],
            _rows([s.q_nb for s in found], 4),
            _rows([(s.latitude_rad, s.longitude_rad, s.height_m) for s in found], 3),
            _rows([s.pose_covariance.diagonal() for s in found], 6),
            projection,
        )

    def camera(self, plane: TangentPlane, projection: Projection) -> PoseTrack:
        """Return the poses of the camera; the attitude is that of the camera body."""
        found = self._cameras
        places = np.stack(plane.geodetic_from_ned(_rows([p.position_n for p in found], 3)), -1)
        # The axes of the plane are rotated to those at the camera.
        turned = [
            quat_multiply(
                quat_conjugate(quat_from_matrix(plane.rotation_from_local(*at))), pose.q_nc
            )
            for pose, at in zip(found, places[:, :2].tolist(), strict=True)
        ]
        return _track(
            [p.stamp_ns for p in found],
            quat_multiply(_rows(turned, 4), _Q_OPTICAL_BODY),
            places,
            _rows([p.covariance.diagonal() for p in found], 6),
            projection,
        )

    def innovations(self) -> list[Innovations]:
        """Return the innovations by source, sorted by the sources' names."""
        return [
            Innovations(
                source.value,
                np.array([stamp for stamp, _ in verdicts], np.int64),
                np.array([verdict.innovation for _, verdict in verdicts]),
                np.array([verdict.test_ratio for _, verdict in verdicts]),
                np.array([verdict.used for _, verdict in verdicts]),
            )
            for source, verdicts in sorted(self._verdicts.items(), key=lambda item: item[0].value)
        ]


def _track(
    stamps_ns: list[int], q_n: Array, geodetic: Array, variances: Array, projection: Projection
) -> PoseTrack:
    """Return a track of N poses: attitudes (N, 4), places (N, 3) rad, m, variances (N, 6)."""
    sigma = np.sqrt(np.maximum(variances, 0))
    return PoseTrack(
        np.array(stamps_ns, np.int64),
        euler_from_quat(q_n),
        projection.project(geodetic[:, 0], geodetic[:, 1]),
        geodetic[:, 2],
        sigma[:, :3],
        sigma[:, 3:],
    )


def _rows(rows: Sequence[Sequence[float] | Array], width: int) -> Array:
    return np.array(rows, float).reshape(-1, width)


@final
class SensorSeries:
    """Collect the instruments' data over a flight."""

    topics = ("imu/data", "rtk/fix", "gps/fix", "gimbal/attitude")

    def __init__(self) -> None:
        self._kept: defaultdict[object, list[tuple[int, Array]]] = defaultdict(list)
        self._rates: defaultdict[object, RateLimit] = defaultdict(lambda: RateLimit(SERIES_HZ))

    def take(self, sample: Sample) -> None:
        """Keep a sample if it is usable and its rate allows it."""
        if isinstance(sample, PositionSample):
            place = np.array([sample.latitude_rad, sample.longitude_rad, sample.height_m])
            self._keep(
                sample.source, sample.stamp_ns, place, usable=bool(np.isfinite(place).all())
            )
            return
        q_n: Array | None = None
        if isinstance(sample, ImuSample):
            q_n = sample.autopilot_q_nb
        elif isinstance(sample, CameraAttitudeSample):
            q_n = sample.q_ng
        if q_n is not None:
            self._keep(type(sample), sample.stamp_ns, q_n, usable=usable_attitude(q_n))

    def _keep(self, kind: object, stamp_ns: int, values: Array, *, usable: bool) -> None:
        if usable and self._rates[kind].due(stamp_ns):
            self._kept[kind].append((stamp_ns, values))

    def sensors(self, projection: Projection) -> Sensors:
        """Return the series in the projected plane."""

        def fixes(source: Source) -> FixTrack:
            stamps, places = self._series(source, 3)
            return FixTrack(stamps, projection.project(places[:, 0], places[:, 1]))

        def attitudes(kind: type) -> AttitudeSeries:
            stamps, q_n = self._series(kind, 4)
            return AttitudeSeries(stamps, euler_from_quat(q_n))

        return Sensors(
            fixes(Source.RTK_POSITION),
            fixes(Source.GPS_POSITION),
            attitudes(ImuSample),
            attitudes(CameraAttitudeSample),
        )

    def _series(self, kind: object, width: int) -> tuple[IntArray, Array]:
        found = self._kept[kind]
        stamps = np.array([stamp for stamp, _ in found], np.int64)
        return stamps, _rows([values for _, values in found], width)

"""Collect series over a flight for the report's plots, thinned in time."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import euler_from_quat, quat_conjugate, quat_multiply
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.streams.stamps import RateLimit
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, ImuSample, PositionSample
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.core.types.verdicts import Verdict
from tirgeo_ros.tools.replay.recorded_flight import BodyErrors, TruePoses, body_errors
from tirgeo_ros.tools.replay.registration import Registered, Sample

#: Settling time of the filter; errors against the truth count only after it.
SETTLED_S = 20.0
_SERIES_HZ = 10.0
_SHOWN = 1500  # instants, up to twice as many: a figure resolves no more
_Q_OPTICAL_BODY = quat_conjugate(Q_BODY_OPTICAL)


class Series:
    """Hold rows of numbers with their stamps, by kind.

    ``series[kind]`` is their stamps (N,), ns, and the rows (N, k); both are (0,) without any.
    """

    def __init__(self) -> None:
        self._rows: defaultdict[str, list[tuple[int, Sequence[float] | Array]]]
        self._rows = defaultdict(list)
        self._rates: defaultdict[str, RateLimit] = defaultdict(lambda: RateLimit(_SERIES_HZ))

    def keep(self, kind: str, stamp_ns: int, row: Sequence[float] | Array) -> None:
        """Add a row if it is finite and the rate of its kind allows it."""
        if np.isfinite(row).all() and self._rates[kind].due(stamp_ns):
            self._rows[kind].append((stamp_ns, row))

    def __getitem__(self, kind: str) -> tuple[IntArray, Array]:
        rows = self._rows[kind]
        rows = rows[:: max(len(rows) // _SHOWN, 1)]
        stamps = np.array([stamp for stamp, _ in rows], np.int64)
        return stamps, np.array([row for _, row in rows], float)


class SensorSeries(Series):
    """Collect the instruments' data over a flight.

    The kinds are ``rtk_position`` and ``gps_position`` (latitude, longitude, rad), ``autopilot``
    and ``gimbal`` (roll, pitch, yaw of body and camera body, rad).
    """

    topics = ("imu/data", "rtk/fix", "gps/fix", "gimbal/attitude")

    def take(self, sample: Sample) -> None:
        """Keep a sample if it is usable."""
        if isinstance(sample, PositionSample):
            place = sample.latitude_rad, sample.longitude_rad
            self.keep(sample.source.value, sample.stamp_ns, place)
        elif isinstance(sample, ImuSample):
            self._attitude("autopilot", sample.stamp_ns, sample.autopilot_q_nb)
        elif isinstance(sample, CameraAttitudeSample):
            self._attitude("gimbal", sample.stamp_ns, sample.q_ng)

    def _attitude(self, kind: str, stamp_ns: int, q_n: Array | None) -> None:
        if q_n is not None and usable_attitude(q_n):
            self.keep(kind, stamp_ns, euler_from_quat(q_n))


class MethodSeries(Series):
    """Collect a method's results over a flight; a Watcher.

    The kinds are ``place`` (latitude, longitude, rad), ``body`` and ``camera`` (roll, pitch, yaw,
    rad; the camera's relative to the axes of the tangent plane), and each of ``sources``: test
    ratio, above 1 is refused, and innovation (m or m/s along north, east, down, or rad). With a
    truth, which only simulated flights have, every body pose is compared with it.
    """

    def __init__(self, truth: TruePoses | None = None) -> None:
        super().__init__()
        self._truth = truth
        self._bodies: list[BodyPose] = []  # in the truth's plane
        self.sources: set[str] = set()
        self._now_ns: int | None = None

    @property
    def has_poses(self) -> bool:
        """Return whether there was any camera pose."""
        return bool(self._rows["camera"])

    def heard(self, verdict: Verdict) -> None:
        """Keep a verdict that has an innovation, at the stamp of the sample before."""
        if self._now_ns and verdict.innovation and math.isfinite(verdict.test_ratio):
            source = verdict.source.value
            self.sources.add(source)
            self._rows[source].append((self._now_ns, [verdict.test_ratio, *verdict.innovation]))

    def took(self, sample: Sample, found: Registered) -> None:
        """Keep the poses at their rate."""
        self._now_ns = sample.stamp_ns
        solution = found.solution
        if solution is not None:
            place = solution.latitude_rad, solution.longitude_rad
            self.keep("place", solution.stamp_ns, place)
            self.keep("body", solution.stamp_ns, euler_from_quat(solution.q_nb))
            if self._truth is not None:
                self._bodies.append(self._truth.plane.body_pose(solution))
        for pose in found.cameras:
            q_ng = quat_multiply(pose.q_nc, _Q_OPTICAL_BODY)
            self.keep("camera", pose.stamp_ns, euler_from_quat(q_ng))

    def body_errors(self) -> BodyErrors | None:
        """Return the errors of the body's poses after settling; None without a truth."""
        return None if self._truth is None else body_errors(self._bodies, self._truth, SETTLED_S)

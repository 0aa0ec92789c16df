"""The first attitude, at rest or in motion.

Over a window the specific force, carried by the gyroscopes into one body frame, sums to the change
of velocity less gravity (Groves, 2nd ed., section 5.6.2, extended to motion by the velocity
change). That gives roll and pitch; a heading turns the answer about that vector.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.aiding.heading import azimuth, baseline_b
from tirgeo_ros.core.attitude import (
    euler_from_quat,
    matrix_from_quat,
    matrix_from_rotvec,
    quat_from_matrix,
    wrap_pi,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.error_state import ACCEL_BIAS, ATTITUDE, GYRO_BIAS, POSITION, VELOCITY
from tirgeo_ros.core.geodesy import gravity_down, radii_of_curvature
from tirgeo_ros.core.samples import (
    Array,
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
    VelocitySample,
)
from tirgeo_ros.core.strapdown import NavState
from tirgeo_ros.core.validity import usable_attitude

#: Tilt is believed no better than this at first, so that the filter itself shares the remaining
#: error out between tilt and accelerometer bias.
_TILT_SIGMA_RAD = np.radians(1.0)
#: A force sum that differs from gravity and motion by more is a wrong unit or a wrong axis.
_LARGEST_FORCE_MISMATCH_M_S2 = 1.0
_LARGEST_POSITION_AGE_S = 0.6


@dataclass(frozen=True, slots=True)
class Alignment:
    """A state to start from: the IMU's, at ``stamp_ns``."""

    stamp_ns: int
    state: NavState
    covariance: Array  # (15, 15)
    imu: tuple[ImuSample, ...]  # the newest sample up to the stamp and all after it
    later: tuple[NavigationInput, ...]  # measurements after the stamp, in order of arrival


@dataclass(frozen=True, slots=True)
class _Window:
    """IMU readings between two velocities, resolved in the body frame at the window's end."""

    stamps_ns: npt.NDArray[np.int64]  # (n,) ends of the steps
    to_end: Array  # (n, 3, 3) body at each stamp to body at the end
    force_sum: Array  # (3,) m/s
    first_rate: Array  # (3,) rad/s
    last_rate: Array  # (3,) rad/s


class Aligner:
    """Collects samples until an attitude can be found; ``reason`` says what is missing."""

    def __init__(self, config: EkfConfig, *, use_heading: bool) -> None:
        self._config = config
        self._use_heading = use_heading
        keep_s = config.alignment.duration_s + config.max_delay_s + 1.0
        self._keep_ns = round(keep_s * 1e9)
        self._imu: deque[ImuSample] = deque()
        self._aiding: deque[NavigationInput] = deque()
        self._needs_velocity = f"needs rtk/vel over {config.alignment.duration_s:g} s"
        self.reason = "needs imu/data"

    def add(self, sample: NavigationInput) -> Alignment | None:
        """Take one valid sample; gives the alignment once it is possible."""
        if isinstance(sample, ImuSample):
            if not self._imu:
                self.reason = self._needs_velocity
            self._imu.append(sample)
        else:
            self._aiding.append(sample)
        newest = self._imu[-1].stamp_ns if self._imu else sample.stamp_ns
        for queue in (self._imu, self._aiding):
            while queue and queue[0].stamp_ns < newest - self._keep_ns:
                queue.popleft()
        return self._try() if isinstance(sample, VelocitySample) else None

    def _try(self) -> Alignment | None:
        pair = self._velocity_pair()
        if pair is None:
            return None
        first, last = pair
        position = self._position_at(last)
        if position is None:
            return None
        window = self._window(first.stamp_ns, last.stamp_ns)
        directions, headings = self._headings(window, first.stamp_ns, last.stamp_ns)
        if not headings:
            return None
        return self._solve(first, last, position, window, directions, headings)

    def _velocity_pair(self) -> tuple[VelocitySample, VelocitySample] | None:
        if len(self._imu) < 2:
            self.reason = "needs imu/data"
            return None
        oldest, newest = self._imu[0].stamp_ns, self._imu[-1].stamp_ns
        found = [s for s in self._aiding if isinstance(s, VelocitySample)]
        found = [s for s in found if oldest <= s.stamp_ns <= newest]
        duration_ns = round(self._config.alignment.duration_s * 1e9)
        last = max(found, key=lambda s: s.stamp_ns, default=None)
        first = max(
            (s for s in found if last and s.stamp_ns <= last.stamp_ns - duration_ns),
            key=lambda s: s.stamp_ns,
            default=None,
        )
        if first is None or last is None:
            self.reason = self._needs_velocity
            return None
        return first, last

    def _position_at(self, last: VelocitySample) -> PositionSample | None:
        found = [s for s in self._aiding if isinstance(s, PositionSample)]
        best = min(found, key=lambda s: abs(s.stamp_ns - last.stamp_ns), default=None)
        if best is None or abs(best.stamp_ns - last.stamp_ns) > _LARGEST_POSITION_AGE_S * 1e9:
            self.reason = "needs rtk/fix"
            return None
        return best

    def _window(self, first_ns: int, last_ns: int) -> _Window:
        inside = [s for s in self._imu if first_ns < s.stamp_ns < last_ns]
        stamps = np.array([first_ns, *(s.stamp_ns for s in inside), last_ns], np.int64)
        seconds = (stamps - first_ns) * 1e-9
        rates = self._interpolated(seconds, first_ns, "angular_rate_b")
        forces = self._interpolated(seconds, first_ns, "specific_force_b")
        steps = np.diff(seconds)[:, None]
        turns = 0.5 * (rates[1:] + rates[:-1]) * steps
        to_first = [np.eye(3)]
        for turn in matrix_from_rotvec(turns):
            to_first.append(to_first[-1] @ turn)
        to_end = to_first[-1].T @ np.array(to_first)
        middle = to_end[:-1] @ matrix_from_rotvec(0.5 * turns)
        pushes = 0.5 * (forces[1:] + forces[:-1]) * steps
        force_sum = np.einsum("kij,kj->i", middle, pushes)
        return _Window(stamps, to_end, force_sum, rates[0], rates[-1])

    def _interpolated(self, seconds: npt.NDArray[np.floating], first_ns: int, name: str) -> Array:
        known = np.array([(s.stamp_ns - first_ns) * 1e-9 for s in self._imu])
        values = np.array([getattr(s, name) for s in self._imu])
        return np.stack([np.interp(seconds, known, column) for column in values.T], -1)

    def _headings(
        self, window: _Window, first_ns: int, last_ns: int
    ) -> tuple[list[Array], list[float]]:
        """Directions in the end's body frame, and the azimuth of each."""
        if not self._use_heading:
            return self._autopilot_heading()
        baseline = baseline_b(self._config.heading.offset_deg)
        found = [
            s
            for s in self._aiding
            if isinstance(s, HeadingSample) and first_ns <= s.stamp_ns <= last_ns
        ]
        near = [int(np.argmin(np.abs(window.stamps_ns - s.stamp_ns))) for s in found]
        if not found:
            self.reason = "needs rtk/heading"
        return [window.to_end[k] @ baseline for k in near], [s.heading_rad for s in found]

    def _autopilot_heading(self) -> tuple[list[Array], list[float]]:
        q_nb = self._imu[-1].autopilot_q_nb
        if q_nb is None or not usable_attitude(q_nb):
            self.reason = "imu/data has no orientation to take the first heading from"
            return [], []
        return [np.array([1.0, 0.0, 0.0])], [float(euler_from_quat(q_nb)[2])]

    def _solve(
        self,
        first: VelocitySample,
        last: VelocitySample,
        position: PositionSample,
        window: _Window,
        directions: list[Array],
        headings: list[float],
    ) -> Alignment | None:
        lever = self._config.rtk.lever_arm_b
        span_s = (last.stamp_ns - first.stamp_ns) * 1e-9
        gravity = np.array([0, 0, gravity_down(position.latitude_rad, position.height_m)])
        rotation = np.eye(3)
        swing_first = window.to_end[0] @ np.cross(window.first_rate, lever)
        swing_last = np.cross(window.last_rate, lever)
        for turn in range(4):  # the lever arm's swing needs the attitude that it helps to find
            swing = rotation @ (swing_last - swing_first) if turn else np.zeros(3)
            force_n = last.velocity_n - first.velocity_n - swing - gravity * span_s
            rotation = attitude_from(window.force_sum, force_n, directions, headings)
        mismatch = abs(np.linalg.norm(window.force_sum) - np.linalg.norm(force_n)) / span_s
        if mismatch > _LARGEST_FORCE_MISMATCH_M_S2:
            self.reason = f"imu/data and rtk/vel differ by {mismatch:.1f} m/s2"
            return None
        velocity_n = last.velocity_n - rotation @ swing_last
        return self._start(last, position, rotation, velocity_n)

    def _start(
        self, last: VelocitySample, position: PositionSample, rotation: Array, velocity_n: Array
    ) -> Alignment:
        age_s = (last.stamp_ns - position.stamp_ns) * 1e-9
        shift = velocity_n * age_s - rotation @ self._config.rtk.lever_arm_b
        meridian, transverse = radii_of_curvature(position.latitude_rad)
        transverse *= np.cos(position.latitude_rad)
        state = NavState(
            tuple(quat_from_matrix(rotation).tolist()),
            tuple(velocity_n.tolist()),
            position.latitude_rad + float(shift[0]) / meridian,
            position.longitude_rad + float(shift[1]) / float(transverse),
            position.height_m - float(shift[2]),
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 0.0),
            (0.0, 0.0, 0.0),
        )
        covariance = self._covariance(position, last, age_s)
        return Alignment(last.stamp_ns, state, covariance, *self._rest(last.stamp_ns))

    def _covariance(self, position: PositionSample, last: VelocitySample, age_s: float) -> Array:
        config = self._config
        heading_deg = config.heading.sigma_floor_deg
        if not self._use_heading:
            heading_deg = config.autopilot.attitude_sigma_deg[2]
        variances = np.zeros(15)
        variances[ATTITUDE] = [_TILT_SIGMA_RAD**2] * 2 + [np.radians(heading_deg) ** 2]
        floor = config.rtk.velocity_sigma_floor_m_s**2
        variances[VELOCITY] = np.maximum(np.diag(last.covariance_n), floor)
        floor = config.rtk.position_sigma_floor_m**2
        variances[POSITION] = np.maximum(np.diag(position.covariance_n), floor) + age_s**2
        imu = config.imu
        variances[GYRO_BIAS] = imu.gyro_turn_on_bias**2 + np.array(imu.gyro_bias_instability) ** 2
        variances[ACCEL_BIAS] = (
            imu.accel_turn_on_bias**2 + np.array(imu.accel_bias_instability) ** 2
        )
        return np.diag(variances)

    def _rest(self, stamp_ns: int) -> tuple[tuple[ImuSample, ...], tuple[NavigationInput, ...]]:
        before = [s for s in self._imu if s.stamp_ns <= stamp_ns][-1:]
        after = [s for s in self._imu if s.stamp_ns > stamp_ns]
        return (*before, *after), tuple(s for s in self._aiding if s.stamp_ns > stamp_ns)


def attitude_from(
    force_b: Array, force_n: Array, directions_b: list[Array], azimuths_rad: list[float]
) -> Array:
    """``R_nb`` (3, 3) that takes ``force_b`` along ``force_n`` and turns directions to azimuths.

    The force is met exactly; the azimuths in the mean, by turning about the force.
    """
    axis_b = force_b / np.linalg.norm(force_b)
    axis_n = force_n / np.linalg.norm(force_n)
    rotation = _shortest_turn(axis_b, axis_n)
    for _ in range(20):
        left = [
            float(wrap_pi(wanted - azimuth(rotation @ direction)))
            for direction, wanted in zip(directions_b, azimuths_rad, strict=True)
        ]
        # Close to each other all errors are on one side of the wrap once the first is zero.
        turn = left[0] + float(np.mean(wrap_pi(np.array(left) - left[0])))
        rotation = matrix_from_rotvec(-turn * axis_n) @ rotation  # up is minus down
    return rotation


def _shortest_turn(a: Array, b: Array) -> Array:
    """(3, 3) the smallest rotation that takes unit vector ``a`` to unit vector ``b``."""
    q = np.concatenate([[1 + a @ b], np.cross(a, b)])
    if q[0] < 1e-9:  # opposite: half a turn about any axis across
        across = np.cross(a, [1.0, 0, 0] if abs(a[0]) < 0.9 else [0, 1.0, 0])
        q = np.concatenate([[0.0], across])
    return matrix_from_quat(q / np.linalg.norm(q))

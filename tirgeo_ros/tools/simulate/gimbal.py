"""Simulate the true camera on its gimbal, its encoders and its reported attitude.

The gimbal follows the nose with a lag and holds roll and pitch imperfectly: the camera drifts by
Table 8's amounts. The encoders measure this drift, the flight controller does not. The north of
the reported attitude may differ from the autopilot's.
"""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import (
    euler_from_matrix,
    matrix_from_euler,
    quat_from_euler,
    quat_from_matrix,
    quat_multiply,
)
from tirgeo_ros.core.gimbal.camera_pose import joint_angles
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample
from tirgeo_ros.tools.simulate.processes import Spline, generator, scaled_noise
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.sensors import Arrival, Autopilot, Epochs
from tirgeo_ros.tools.simulate.trajectory import Trajectory

#: Correlation time of the camera's roll and pitch errors.
ERROR_TIME_S = 2.5
_KNOT_S = 0.05
_TILTING_S = 1.0  # duration of a change of the commanded pitch


class SimulatedGimbal:
    """Compute the true attitude and position of the camera as functions of time.

    The boresight turns the camera away from the gimbal's axes; neither the encoders nor the flight
    controller measure it.
    """

    def __init__(self, scenario: Scenario, seed: int, trajectory: Trajectory) -> None:
        """Draw the camera's drift and let its heading follow that of the flight."""
        self._scenario, self._places = scenario.gimbal, scenario.aircraft
        self._trajectory = trajectory
        boresight = quat_from_euler(*scenario.gimbal.boresight_rpy_rad)
        self._q_gc = quat_multiply(boresight, Q_BODY_OPTICAL)
        knots_s = np.arange(0.0, scenario.duration_s + 2 * _KNOT_S, _KNOT_S)
        nose = trajectory.motion(knots_s).heading_rad
        self._heading = Spline(_lagging(nose, scenario.gimbal.lag_s)[:, None], _KNOT_S)
        rms = np.radians(scenario.gimbal.error_rms_deg)
        rng = generator(seed, "gimbal")
        #: True minus commanded camera roll and pitch (N, 2), rad, at times (N,).
        self.wander_rad: Spline = scaled_noise(rng, scenario.duration_s, ERROR_TIME_S, rms)

    def commanded_pitch_rad(self, t_s: Array) -> Array:
        """Return the camera pitch (N,) that the gimbal is commanded to hold."""
        changed = np.clip((t_s - self._scenario.pitch_step_s) / _TILTING_S, 0.0, 1.0)
        return np.radians(self._scenario.pitch_deg + self._scenario.pitch_step_deg * changed)

    def north_bias_rad(self, t_s: Array) -> Array:
        """Return the reported camera heading minus the one from the autopilot's north (N,)."""
        gimbal = self._scenario
        bias_deg = gimbal.north_bias_deg + gimbal.north_drift_deg_s * t_s
        return np.radians(bias_deg + gimbal.north_step_deg * (t_s >= gimbal.north_step_s))

    def rotation_pg(self, t_s: Array) -> Array:
        """Return the true camera attitude (N, 3, 3) in the plane of the site."""
        roll, pitch = self.wander_rad(t_s).T
        pitch = pitch + self.commanded_pitch_rad(t_s)
        return matrix_from_euler(roll, pitch, self._heading(t_s)[:, 0])

    def camera(self, t_s: npt.ArrayLike) -> tuple[Array, Array]:
        """Return position (N, 3) and quaternion ``q_pc`` (N, 4) of the optical frame in ``p``."""
        times = np.atleast_1d(np.asarray(t_s, float))
        motion = self._trajectory.motion(times)
        rotation = self.rotation_pg(times)
        pivot_p, _ = motion.at_arm(self._places.pivot_lever_b)
        q_pc = quat_multiply(quat_from_matrix(rotation), self._q_gc)
        return pivot_p + rotation @ self._places.camera_from_pivot_g, q_pc


def gimbal_samples(
    scenario: Scenario,
    seed: int,
    trajectory: Trajectory,
    pilot: Autopilot,
    gimbal: SimulatedGimbal,
) -> list[Arrival]:
    """Return ``gimbal/joint_states`` and ``gimbal/attitude``, which arrive without delay.

    The reported attitude has the commanded roll and pitch; its heading is the autopilot's plus the
    encoders' angle and the north bias.
    """
    epochs = Epochs.at_rate(scenario, scenario.gimbal.rate_hz)
    motion = trajectory.motion(epochs.t_s)
    rotation_pg = gimbal.rotation_pg(epochs.t_s)
    noise = generator(seed, "encoders").standard_normal((len(epochs.t_s), 3))
    noise *= math.radians(scenario.gimbal.encoder_sigma_deg)
    rotation_bg = np.swapaxes(motion.rotation_pb, 1, 2) @ rotation_pg
    joints = joint_angles(rotation_bg, scenario.gimbal.joint_order) + noise
    nose = pilot.euler_rad(motion, trajectory.rotation_nb(motion))[:, 2]
    camera = euler_from_matrix(rotation_pg)[:, 2]
    aside = camera - euler_from_matrix(motion.rotation_pb)[:, 2] + noise[:, 0]
    heading = nose + aside + gimbal.north_bias_rad(epochs.t_s)
    reported = quat_from_euler(0.0, gimbal.commanded_pitch_rad(epochs.t_s), heading)
    samples: list[Arrival] = []
    for stamp, (yaw, roll, pitch), q_ng in zip(epochs.stamp_ns, joints, reported, strict=True):
        samples.append((stamp, JointSample(stamp, float(yaw), float(roll), float(pitch))))
        samples.append((stamp, CameraAttitudeSample(stamp, q_ng)))
    return samples


def _lagging(heading_rad: Array, lag_s: float) -> Array:
    """Return the heading (N,) behind a first-order lag."""
    gain = 1 - math.exp(-_KNOT_S / lag_s)
    out = np.empty_like(heading_rad)
    value = heading_rad[0]
    for k, nose in enumerate(heading_rad):
        value += gain * (nose - value)
        out[k] = value
    return out

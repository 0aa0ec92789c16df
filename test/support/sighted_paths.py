"""A camera on a winding path, and clicks on points that it sees, for tests of the boresight."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from tirgeo_ros.core.calibration.boresight_model import (
    PointSighting,
    SightedFlight,
    Stepped,
)
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.config import AircraftConfig, GimbalConfig
from tirgeo_ros.core.frames.rotations import (
    matrix_from_quat,
    quat_from_rotvec,
    quat_multiply,
)
from tirgeo_ros.core.gimbal.camera_pose import Mount, from_joints
from tirgeo_ros.core.types.measurements import JointSample
from tirgeo_ros.core.types.poses import BodyPose

USUAL = ("roll", "pitch", "yaw", "latency")
LATENCY_S = 0.05
POSE_SIGMA = np.array([0.01, 0.01, 0.02, *np.radians([0.1, 0.1, 0.2])])


class Path:
    """A camera 20 m up whose heading winds and whose tilt steps; the map's plane is the ground."""

    def __init__(self, *, tilts_deg=(-30.0,), turning=True, speed_m_s=3.0, rpy_deg=(0, 0, 0)):
        self.tilts, self.turning, self.speed = np.radians(tilts_deg), turning, speed_m_s
        self.mount = Mount.from_config(
            GimbalConfig(
                boresight_rpy_deg=tuple(map(float, rpy_deg)),
                aircraft=AircraftConfig(camera_from_pivot_m=(0.05, 0, 0)),
            )
        )
        self.errors = None  # (6,) of the poses given out, by time
        self.latency_s = LATENCY_S

    def true_pose(self, t_s, swing_rad=0.0):
        heading = 1.2 * math.sin(0.35 * t_s) + 0.4 * math.sin(1.1 * t_s) if self.turning else 0.3
        tilt = self.tilts[int(t_s / 20) % len(self.tilts)]
        place = np.array([self.speed * t_s, 4 * math.sin(0.2 * t_s) * self.turning, -20.0])
        covariance = np.diag(POSE_SIGMA**2)
        body = BodyPose(round(t_s * 1e9), place, np.eye(4)[0], covariance)
        joints = JointSample(body.stamp_ns, heading + swing_rad, 0.0, float(tilt))
        return from_joints(self.mount, body, joints)

    def at(self, stamp_ns, swing_rad=0.0):
        t_s = stamp_ns * 1e-9
        around = [self.true_pose(t_s + step, swing_rad) for step in (-0.01, 0.0, 0.01)]
        rates = CameraRates.between(around[0], around[2])
        return self._wrong(around[1]), rates

    def _wrong(self, pose):
        if self.errors is None:
            return pose
        error = self.errors(pose.stamp_ns * 1e-9)
        return dataclasses.replace(
            pose,
            position_n=pose.position_n - error[:3],
            q_nc=quat_multiply(quat_from_rotvec(-error[3:]), pose.q_nc),
        )


STEP = math.radians(1.0)


def flight_of(path, present_rpy_deg=(0, 0, 0), click_sigma_px=0.5, *, north=False):
    """The flight as read with the present parameters; a step of north turns back by as much."""
    return SightedFlight(
        XT2,
        path.at,
        np.radians(np.array(present_rpy_deg, float)),
        LATENCY_S,
        np.array([0.05, 0, 0]),
        click_sigma_px,
        {"gimbal_north": Stepped(lambda t: path.at(t, -STEP), STEP)} if north else {},
    )


def seen_by(path, rng, *, count=60, latency_s=LATENCY_S, sigma_px=0.5, span_s=60.0, area=1.0):
    """Clicks by the true path: a point for every three, all over the picture."""
    found = []
    while len(found) < count:
        t_s = float(rng.uniform(2.0, span_s))
        uv = np.array([320, 330]) + area * rng.uniform([-270, -140], [270, 150])
        pose = path.true_pose(t_s)
        ray = matrix_from_quat(pose.q_nc) @ XT2.rays(uv)[0]
        point_n = pose.position_n - ray * pose.position_n[2] / ray[2]
        exposure_ns = round(t_s * 1e9)
        stamp_ns = exposure_ns + round(latency_s * 1e9)
        noise = sigma_px * rng.standard_normal(2)
        found.append(PointSighting(f"P{len(found) // 3}", stamp_ns, uv + noise, point_n))
    return found

"""The parameters of gimbal_node."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.config.aircraft import AircraftConfig
from tirgeo_ros.core.config.renamed import NodeParameters
from tirgeo_ros.core.config.schema import group, param
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.joint_orders import JOINT_ORDERS, USUAL_ORDER


@dataclass(frozen=True, slots=True)
class NorthConfig:
    """The gimbal's north against the autopilot's, for the composition ``paper``."""

    bias_deg: float = param(
        0.0,
        "reported camera heading less the true one by the autopilot's north, as calibrated",
        unit="deg",
        low=-180,
        high=180,
    )
    sigma_deg: float = param(
        3.0, "standard deviation of bias_deg at the start", unit="deg", low=0, high=100
    )
    walk_deg: float = param(
        0.03,
        "standard deviation of the bias's change in one second; grows with the root of the time",
        unit="deg",
        low=0,
        high=10,
    )
    centred: bool = param(
        False, "the gimbal follows the nose and nobody turns it aside: the bias can be read"
    )
    settle_s: float = param(
        3.0,
        "a centred gimbal is read after the nose has kept still for so long; six of its time "
        "constants",
        unit="s",
        low=0,
        high=60,
    )
    centred_sigma_deg: float = param(
        0.3,
        "standard deviation of the angle from the nose to a centred camera, which stays the same",
        unit="deg",
        low=0,
        high=90,
    )
    noise_deg: float = param(
        0.2,
        "standard deviation of a reading of the bias, the mean of one second",
        unit="deg",
        low=1e-3,
        high=90,
    )
    gate_sigma: float = param(
        5.0, "readings beyond this many standard deviations are refused", low=1, high=1e6
    )
    reset_after_s: float = param(
        5.0,
        "readings that agree with each other but are refused for at least so long set the bias",
        unit="s",
        low=0.1,
        high=3600,
    )


@dataclass(frozen=True, slots=True)
class GimbalConfig(NodeParameters):
    """Parameters of gimbal_node."""

    composition: str = param(
        "auto",
        "paper (reported roll and pitch, filtered heading), encoders (body attitude and joints), "
        "or auto: encoders while joint angles arrive, else paper",
        choices=("auto", "paper", "encoders"),
    )
    joint_order: str = param(
        USUAL_ORDER,
        "the gimbal's joints as they follow each other from the aircraft to the camera",
        choices=JOINT_ORDERS,
    )
    boresight_rpy_deg: tuple[float, ...] = param(
        (0.0, 0.0, 0.0),
        "mounting error of the camera: roll, pitch, yaw about camera body axes forward, left, up",
        unit="deg",
        low=-180,
        high=180,
    )
    yaw_zero_deg: float = param(
        0.0,
        "yaw joint angle as gimbal/joint_states has it from an encoder, less the true one",
        unit="deg",
        low=-180,
        high=180,
    )
    encoder_sigma_deg: float = param(
        0.05, "standard deviation of a joint angle", unit="deg", low=0, high=90
    )
    reported_sigma_deg: tuple[float, ...] = param(
        (0.2704, 0.4839),
        "standard deviation of the reported camera roll and pitch (Table 8)",
        unit="deg",
        low=0,
        high=90,
    )
    autopilot_tilt_sigma_deg: float = param(
        0.5,
        "standard deviation of the autopilot's own tilt, per axis, which joint angles computed "
        "from its attitude take over",
        unit="deg",
        low=0,
        high=90,
    )
    max_wait_s: float = param(
        0.5,
        "a gimbal sample waits this long for the body pose around it",
        unit="s",
        low=0,
        high=10,
    )
    max_gap_s: float = param(
        0.25,
        "longest time between two body poses that is bridged; more than 1 / publish_rate_hz",
        unit="s",
        low=1e-3,
        high=2,
    )
    north: NorthConfig = group(NorthConfig)
    aircraft: AircraftConfig = group(AircraftConfig)

    @property
    def yaw_zero_rad(self) -> float:
        """The error of the yaw encoder's zero about body down, rad."""
        return -math.radians(self.yaw_zero_deg)

    @property
    def boresight_rpy_rad(self) -> Array:
        """(3,) roll, pitch, yaw of the mounting error about camera body FRD axes, rad."""
        return np.radians(flu_from_frd(np.array(self.boresight_rpy_deg)))

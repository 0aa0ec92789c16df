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
"""Define the parameters of gimbal_node."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.config.aircraft_parameters import AircraftConfig, TransformsConfig
from tirgeo_ros.core.config.schema import group, param
from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import JOINT_ORDERS, USUAL_ORDER

_ANGLE, _SIGMA = ("deg", -180, 180), ("deg", 0, 90)


@dataclass(frozen=True, slots=True)
class NorthConfig:
    """The bias of the gimbal's north against the autopilot's, for ``composition: paper``."""

    bias_deg: float = param(
        0.0,
        "calibrated bias: reported heading of the camera minus its true one. To measure it, "
        "centre the gimbal on the nose and subtract the aircraft's heading from the gimbal's",
        _ANGLE,
    )
    sigma_deg: float = param(
        3.0,
        "sigma of bias_deg at the start; 3 = not calibrated, 0.5 suits a calibration of the day",
        ("deg", 0, 100),
    )
    walk_deg: float = param(
        0.03,
        "random walk of the bias: sigma of its change in a second; 0.03 is 1 deg in 18 minutes",
        ("deg", 0, 10),
    )
    centred: bool = param(
        False,
        "true = the gimbal follows the nose and is never turned aside, so that the bias can be "
        "measured whenever the nose keeps still",
    )
    settle_s: float = param(
        3.0,
        "time for which the nose must have kept still, within 2 deg, before the gimbal is read",
        ("s", 0, 60),
    )
    centred_sigma_deg: float = param(
        0.3, "sigma of the constant angle between nose and centred camera", _SIGMA
    )
    noise_deg: float = param(
        0.2, "sigma of one reading of the bias, a mean over one second", ("deg", 1e-3, 90)
    )
    gate_sigma: float = param(
        5.0,
        "innovation gate: reject readings further than this many sigmas from the estimate",
        ("", 1, 1e6),
    )
    reset_after_s: float = param(
        5.0,
        "reset the bias to the readings if they were rejected for this long and agree with each "
        "other",
        ("s", 0.1, 3600),
    )


@dataclass(frozen=True, slots=True)
class GimbalConfig(TransformsConfig):
    """Parameters of gimbal_node."""

    composition: str = param(
        "auto",
        "how the camera's attitude is composed: paper (reported roll and pitch, filtered "
        "heading), encoders (body attitude and joint angles), auto (encoders where they come)",
        choices=("auto", "paper", "encoders"),
    )
    joint_order: str = param(
        USUAL_ORDER,
        "order of the gimbal's joints, from the aircraft to the camera",
        choices=JOINT_ORDERS,
    )
    boresight_rpy_deg: tuple[float, ...] = param(
        (0.0, 0.0, 0.0),
        "mounting error of the camera: roll, pitch, yaw about its axes forward, left, up",
        _ANGLE,
        live=True,
    )
    yaw_zero_deg: float = param(
        0.0,
        "error of the yaw encoder's zero: yaw in gimbal/joint_states minus the true one",
        _ANGLE,
        live=True,
    )
    encoder_sigma_deg: float = param(
        0.05, "standard deviation of a joint angle", _SIGMA, live=True
    )
    reported_sigma_deg: tuple[float, ...] = param(
        (0.2704, 0.4839),
        "sigma of reported roll and pitch (Ren et al. 2022, Table 8)",
        _SIGMA,
        live=True,
    )
    autopilot_tilt_sigma_deg: float = param(
        0.5,
        "sigma of the autopilot's tilt, which joint angles computed from it inherit",
        _SIGMA,
        live=True,
    )
    max_wait_s: float = param(
        0.5,
        "longest wait of a gimbal sample for the next body pose; above 1 / publish_rate_hz",
        ("s", 0, 10),
        live=True,
    )
    max_gap_s: float = param(
        0.25,
        "longest gap between two body poses that is interpolated; above 1 / publish_rate_hz",
        ("s", 1e-3, 2),
        live=True,
    )
    north: NorthConfig = group(NorthConfig, live=True)
    aircraft: AircraftConfig = group(AircraftConfig)

    @property
    def yaw_zero_rad(self) -> float:
        """Return the error of the yaw encoder's zero, about the body's down axis, rad."""
        return -math.radians(self.yaw_zero_deg)

    @property
    def boresight_rpy_rad(self) -> Array:
        """Return the boresight (3,): roll, pitch, yaw about the camera's FRD axes, rad."""
        return np.radians(flu_from_frd(np.array(self.boresight_rpy_deg)))

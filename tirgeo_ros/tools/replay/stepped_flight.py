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
"""Read a flight's poses with their derivatives by the parameters of the set-up.

The flight runs through the nodes' core objects with the parameters as they are and, in the same
pass, with a step in the gimbal's north, which acts before the camera pose is computed.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from tirgeo_ros.core.calibration.boresight_model import SightedFlight, Stepped
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.pictures.camera_file import configured_camera
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.node_configs import NodeConfigs

_NORTH = "gimbal_north"
_STEP_RAD = math.radians(1.0)


class SteppedFlight:
    """Hold the poses of a flight at its pictures, and with ``north`` those with a step in it."""

    def __init__(
        self,
        reader: BagReader,
        namespace: str,
        configs: NodeConfigs,
        stamps_ns: Iterable[int],
        progress: Report,
        *,
        north: bool,
        smooth: bool = False,
    ) -> None:
        """Read the flight once; raise BagError, or CalibrationError if there is no pose."""
        self._configs = configs
        self.recorded = Flight(reader, namespace, camera=configured_camera(configs.overlay))
        latency_s = configs.overlay.video_latency_s
        at_ns = [exposure_ns(stamp_ns, latency_s) for stamp_ns in stamps_ns]
        self._usual = self.recorded.registered(configs.ekf, configs.gimbal, at_ns, smooth=smooth)
        self._stepped: dict[str, FlightPoses] = {}
        if north:
            gimbal, step_deg = configs.gimbal, math.degrees(_STEP_RAD)
            # Only the parameter of the composition in use has an effect.
            bias = replace(gimbal.north, bias_deg=gimbal.north.bias_deg + step_deg)
            turned = replace(gimbal, north=bias, yaw_zero_deg=gimbal.yaw_zero_deg + step_deg)
            poses = self.recorded.registered(configs.ekf, turned, at_ns, smooth=smooth)
            self._stepped[_NORTH] = poses
        self.recorded.read_all(progress)
        if self._usual.plane is None:
            raise CalibrationError(
                f"{reader.path}: the filter computed no pose for this flight; run 'tirgeo "
                "process' to see why"
            )
        self.plane: TangentPlane = self._usual.plane

    @property
    def by_encoders(self) -> bool:
        """Return whether the camera's pose is composed by the gimbal's encoders."""
        return self._usual.registration.composer.sees_joints

    @property
    def follows_north(self) -> bool:
        """Return whether the composer estimated the gimbal's north during the flight."""
        counts = self._usual.registration.composer.counts
        return not self.by_encoders and counts.get("north_used", 0) > 0

    @property
    def north_sigma_rad(self) -> float:
        """Return the standard deviation of the gimbal's north that the poses carry."""
        # Joint angles, or estimates during the flight, give the north without this uncertainty.
        has_north = self.by_encoders or self.follows_north
        return 0.0 if has_north else math.radians(self._configs.gimbal.north.sigma_deg)

    def sighted(self, click_sigma_px: float) -> SightedFlight:
        """Return the flight for sightings of that standard deviation per axis."""
        gimbal = self._configs.gimbal
        return SightedFlight(
            camera=self.recorded.camera,
            poses=self._usual.at,
            boresight_rpy_rad=np.radians(np.array(gimbal.boresight_rpy_deg)),
            latency_s=self._configs.overlay.video_latency_s,
            camera_offset_g=gimbal.aircraft.camera_from_pivot_g,
            click_sigma_px=click_sigma_px,
            stepped={name: Stepped(each.at, _STEP_RAD) for name, each in self._stepped.items()},
            north_variance=self.north_sigma_rad**2,
        )

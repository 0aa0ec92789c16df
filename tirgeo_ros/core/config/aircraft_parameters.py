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
"""Define the positions of antennas, gimbal and camera on the aircraft, the same for every node.

The user measures all of them with a tape from one point of the aircraft, in ROS's axes
(``base_link``: forward, left, up). The properties are relative to the IMU, the origin of
``base_link``, in the core's axes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config.schema import param
from tirgeo_ros.core.frames.rotations import azimuth, flu_from_frd, matrix_from_euler
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import Source

_NOWHERE = (0.0, 0.0, 0.0)
_PLACE = ("m", -1e3, 1e3)
#: Least horizontal distance between the two antennas: an error of 1 cm of the tape turns a
#: baseline of 5 cm by 11 deg.
_LEAST_APART_M = 0.05
#: Least horizontal share of a baseline's length (75 deg of tilt).
_LEAST_HORIZONTAL = 0.25
#: Sigma (forward, left, up) of an antenna's position that was not measured. Every tilt shows the
#: height above the IMU; on the other axes, a few turns cannot tell a lever arm from a clock error.
_UNMEASURED_M = (0.0, 0.0, 0.3)
_GPS = (Source.GPS_POSITION, Source.GPS_VELOCITY)


class FrameIds(NamedTuple):
    """Hold the frame ids of messages, with their prefix; docs/outputs.md draws them."""

    map: str
    base_link: str
    camera: str
    imu_link: str
    rtk_antenna: str
    second_antenna: str
    gps_antenna: str
    gimbal_pivot: str


_FIXED = FrameIds._fields[3:]


def _prefix_fault(text: str) -> str:
    if text.startswith("/"):
        return f"begins with a slash, which tf2 refuses: write {text.lstrip('/')!r}"
    return "has a space: remove it" if any(letter.isspace() for letter in text) else ""


def _name_fault(text: str) -> str:
    return _prefix_fault(text) if text else "is empty: a frame needs a name"


@dataclass(frozen=True, slots=True)
class FramesConfig:
    """Names of the frames in messages, set once for all nodes."""

    map_frame: str = param(
        "map",
        "frame of all poses: the tangent plane at tirgeo/origin, east, north, up",
        fault=_name_fault,
    )
    base_link_frame: str = param(
        "base_link", "frame of the aircraft: forward, left, up, at the IMU", fault=_name_fault
    )
    camera_frame: str = param(
        "tir_optical_frame",
        "optical frame of the thermal camera: x right, y down, z forward",
        fault=_name_fault,
    )
    frame_prefix: str = param(
        "",
        "prefix of every frame's name, such as uav1/, so that several aircraft can share /tf",
        fault=_prefix_fault,
    )

    @property
    def frame_ids(self) -> FrameIds:
        """Return the ids with their prefix. Raise ConfigError if two have the same name."""
        names = FrameIds(self.map_frame, self.base_link_frame, self.camera_frame, *_FIXED)
        twice = sorted({name for name in names if names.count(name) > 1})
        if twice:
            raise ConfigError(
                f"parameters map_frame, base_link_frame, camera_frame: two frames are named "
                f"{', '.join(twice)}: give each its own name ({', '.join(_FIXED)} are taken)"
            )
        return FrameIds(*(self.frame_prefix + name for name in names))


@dataclass(frozen=True, slots=True)
class TransformsConfig(FramesConfig):
    """Names of the frames, and whether a node publishes the transforms between them."""

    publish_tf: bool = param(
        True,
        "publish the transforms between the frames on /tf and /tf_static, where tf2_msgs is "
        "installed; false = another node publishes them",
    )


@dataclass(frozen=True, slots=True)
class AircraftConfig:
    """Positions of IMU, antennas, gimbal and camera on the aircraft, set once for all nodes."""

    imu_m: tuple[float, ...] = param(
        _NOWHERE,
        "position of the IMU, the origin of base_link (forward, left, up)",
        _PLACE,
    )
    imu_rpy_deg: tuple[float, ...] = param(
        _NOWHERE,
        "rotation of the IMU's axes to base_link: roll, pitch, yaw about forward, left, up",
        ("deg", -180, 180),
    )
    rtk_antenna_m: tuple[float, ...] = param(
        _NOWHERE,
        "position of the first RTK antenna (forward, left, up); with D-RTK the left one",
        _PLACE,
    )
    rtk_antenna_sigma_m: tuple[float, ...] = param(
        (),
        "standard deviation of rtk_antenna_m (forward, left, up); components above 0 are "
        "estimated in flight. Empty = zeros, or 0.3 up if rtk_antenna_m is not measured",
        ("m", 0, 10),
        sizes=(0, 3),
    )
    second_antenna_m: tuple[float, ...] = param(
        (),
        "position of the second RTK antenna (forward, left, up), 5 cm or more from the first "
        "seen from above; with D-RTK the right one. Empty = one antenna",
        _PLACE,
        sizes=(0, 3),
    )
    gps_antenna_m: tuple[float, ...] = param(
        _NOWHERE, "position of the autopilot's ordinary GPS antenna (forward, left, up)", _PLACE
    )
    gimbal_pivot_m: tuple[float, ...] = param(
        _NOWHERE,
        "position of the point about which the gimbal turns the camera (forward, left, up)",
        _PLACE,
    )
    camera_from_pivot_m: tuple[float, ...] = param(
        _NOWHERE,
        "position of the camera from gimbal_pivot_m, in the camera's axes (forward, left, up)",
        _PLACE,
    )

    @property
    def rtk_lever_b(self) -> Array:
        """Return the lever arm (3,) from the IMU to the first RTK antenna, FRD, m."""
        return self._from_imu_b(self.rtk_antenna_m)

    @property
    def rtk_lever_sigma_b(self) -> Array:
        """Return the sigmas (3,) of ``rtk_lever_b``, m; 0 for a component taken as exact."""
        if self.rtk_antenna_sigma_m:
            return np.array(self.rtk_antenna_sigma_m)
        return np.zeros(3) if self.rtk_lever_b.any() else np.array(_UNMEASURED_M)

    @property
    def gps_lever_b(self) -> Array:
        """Return the lever arm (3,) from the IMU to the ordinary GPS antenna, FRD, m."""
        return self._from_imu_b(self.gps_antenna_m)

    @property
    def pivot_lever_b(self) -> Array:
        """Return the lever arm (3,) from the IMU to the gimbal's pivot, FRD, m."""
        return self._from_imu_b(self.gimbal_pivot_m)

    @property
    def camera_from_pivot_g(self) -> Array:
        """Return the offset (3,) from the pivot to the camera, in the camera's FRD axes, m."""
        return flu_from_frd(np.array(self.camera_from_pivot_m))

    @property
    def rotation_bi(self) -> Array | None:
        """Return ``R_bi`` (3, 3), from the IMU's axes to the body's, both FRD; None if equal."""
        if not any(self.imu_rpy_deg):
            return None
        roll, pitch, yaw = np.radians(flu_from_frd(np.array(self.imu_rpy_deg)))
        return matrix_from_euler(roll, pitch, yaw)

    @property
    def baseline_b(self) -> Array | None:
        """Return the vector (3,) from the first RTK antenna to the second, FRD, m.

        None with one antenna. Raises ConfigError if the two are too close to give a heading.
        """
        if not self.second_antenna_m:
            return None
        baseline_b = flu_from_frd(np.array(self.second_antenna_m) - np.array(self.rtk_antenna_m))
        apart_m = math.hypot(baseline_b[0], baseline_b[1])
        if apart_m < _LEAST_APART_M or apart_m < _LEAST_HORIZONTAL * np.linalg.norm(baseline_b):
            first, second = list(self.rtk_antenna_m), list(self.second_antenna_m)
            raise ConfigError(
                f"parameters aircraft.rtk_antenna_m {first} and aircraft.second_antenna_m "
                f"{second}: only {apart_m:.2f} m apart seen from above, too little for a heading: "
                "measure both from the same point (forward, left, up); if there is one antenna, "
                "set second_antenna_m: []"
            )
        return baseline_b

    @property
    def baseline_deg(self) -> float | None:
        """Return the azimuth, deg, of ``baseline_b`` from the nose, clockwise seen from above.

        None with one antenna. Raises ConfigError as ``baseline_b``.
        """
        baseline_b = self.baseline_b
        if baseline_b is None:
            return None
        return math.degrees(azimuth(baseline_b))

    def antenna_b(self, source: Source) -> Array:
        """Return the lever arm (3,) from the IMU to a source's antenna, FRD, m."""
        return self.gps_lever_b if source in _GPS else self.rtk_lever_b

    def _from_imu_b(self, place_m: tuple[float, ...]) -> Array:
        return flu_from_frd(np.array(place_m) - np.array(self.imu_m))

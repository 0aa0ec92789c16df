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
"""Flights of a drone without a computer: stills with attitudes and a position, and no IMU.

Each still knows its truth, the samples that a reader makes of it, and its file. Position,
attitude, gimbal and picture of an instant have one stamp.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from made_stills import still

from tirgeo_ros.core.camera.known_cameras import camera_of
from tirgeo_ros.core.frames.rotations import BODY_OPTICAL, matrix_from_quat, quat_from_euler
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    ImuSample,
    JointSample,
    PositionSample,
    Source,
)

START_NS = 1_720_000_000_123_456_000
GROUND_M = 200.0  # ellipsoidal
CAMERA = camera_of("DJI", "M3T", (640, 512))
PLANE = TangentPlane(math.radians(51.366), math.radians(12.309), GROUND_M)
#: East, north of surveyed points (m), all inside of some pictures.
POINTS = {"A": (4.0, 8.0), "B": (-6.0, 20.0), "C": (10.0, 33.0), "D": (0.0, 48.0)}
#: A segment with the raw data of a thermal picture, which must not be copied.
RAW = b"\xff\xe3\x00\x0araw data"


class Still(NamedTuple):
    """A still: its stamp, the place NED in PLANE, and both attitudes (yaw, pitch, roll), deg."""

    stamp_ns: int
    place_n: tuple[float, float, float]
    flight_deg: tuple[float, float, float]
    gimbal_deg: tuple[float, float, float]
    joints_deg: tuple[float, float, float] | None = None  # yaw, roll, pitch

    @property
    def q_ng(self) -> Array:
        """The camera's attitude, by one rotation."""
        return _attitude(self.gimbal_deg)

    @property
    def rotation_nc(self) -> Array:
        """The true R_nc (3, 3)."""
        return np.asarray(matrix_from_quat(self.q_ng) @ BODY_OPTICAL)

    @property
    def geodetic(self) -> tuple[float, float, float]:
        """Latitude and longitude, rad, and ellipsoidal height, m."""
        latitude, longitude, height_m = PLANE.geodetic_from_ned(np.array(self.place_n))
        return float(latitude), float(longitude), float(height_m)

    def samples(self, rtk: bool = True) -> list[Any]:
        """What a reader makes of it."""
        source = Source.RTK_POSITION if rtk else Source.GPS_POSITION
        status, sigma = (FixStatus.FIXED, 0.02) if rtk else (FixStatus.SINGLE, 0.0)
        stamp_ns = self.stamp_ns
        samples: list[Any] = [
            PositionSample(stamp_ns, source, status, *self.geodetic, np.eye(3) * sigma**2),
            ImuSample.of_attitude(stamp_ns, _attitude(self.flight_deg)),
        ]
        if self.joints_deg is None:
            return [*samples, CameraAttitudeSample(stamp_ns, self.q_ng)]
        return [*samples, JointSample(stamp_ns, *np.radians(self.joints_deg).tolist())]

    def jpeg(self, **fields: Any) -> bytes:
        """Its file, with raw data; ``fields`` as in ``made_stills.still``."""
        taken = datetime.fromtimestamp(self.stamp_ns // 10**9, timezone.utc)
        micros = self.stamp_ns // 1000 % 10**6
        latitude, longitude, height_m = self.geodetic
        own = {
            "UTCAtExposure": f"{taken:%Y:%m:%d %H:%M:%S}.{micros:06}",
            "GpsLatitude": f"{math.degrees(latitude):+.12f}",
            "GpsLongitude": f"{math.degrees(longitude):+.12f}",
            "AbsoluteAltitude": f"{height_m:+.9f}",
        }
        for of, angles in (("Flight", self.flight_deg), ("Gimbal", self.gimbal_deg)):
            for axis, angle in zip(("Yaw", "Pitch", "Roll"), angles, strict=True):
                own[f"{of}{axis}Degree"] = f"{angle:+.9f}"
        data = still(**own | fields)
        return data[:2] + RAW + data[2:]


def _attitude(ypr_deg: tuple[float, float, float]) -> Array:
    yaw, pitch, roll = np.radians(ypr_deg)
    return quat_from_euler(roll, pitch, yaw)


def strip(step_s: float = 2.0, aside_deg: float = 3.0, seed: int = 1) -> list[Still]:
    """Twelve stills 75 m up: eight look down on the way north, some of them with DJI's roll of
    180 deg, and four look obliquely on the way back; ``aside_deg`` is gimbal less flight yaw."""
    rng, stills = np.random.default_rng(seed), []
    for number in range(12):
        is_down = number < 8
        heading = 5.0 if is_down else -174.0
        flight = heading + rng.normal(0, 1), -4.0 + rng.normal(0, 1), rng.normal(0, 2)
        yaw = heading + aside_deg
        gimbal = (yaw, -90.0, 0.0) if number % 2 else (yaw + 180.0, -90.0, 180.0)
        gimbal = gimbal if is_down else (yaw, -62.0, 0.3)
        north_m = 6.5 * number if is_down else 80.0 - 5.0 * (number - 8)
        place_n = north_m, 3.0 * (not is_down) + rng.normal(0, 0.5), -75.0 + rng.normal(0, 0.3)
        stamp_ns = START_NS + 1000 * round(1e6 * (number * step_s + rng.uniform(0, 0.1)))
        stills.append(Still(stamp_ns, place_n, flight, gimbal))
    return stills


def still_jpeg(number: int) -> bytes:
    """The file of a still of the strip."""
    return strip()[number].jpeg()


def name_of(number: int) -> str:
    """The name of a still's file in the folder."""
    return f"DJI_{number:04}_T.JPG"


def write_folder(path: Path, stills: Iterable[Still]) -> Path:
    """A folder of stills."""
    path.mkdir()
    for number, each in enumerate(stills):
        (path / name_of(number)).write_bytes(each.jpeg())
    return path


def pixel_of(still: Still, point_n: Array) -> Array | None:
    """(u, v) of a point NED in PLANE, or None outside of the picture."""
    uv, _ = CAMERA.project((point_n - np.array(still.place_n)) @ still.rotation_nc)
    u, v = uv[0]
    return uv[0] if 0 <= u < CAMERA.width and 0 <= v < CAMERA.height else None


def write_ground(folder: Path, stills: Iterable[Still]) -> None:
    """A map, a survey and observations of POINTS in the pictures that see them, by their names."""
    places, rows = {}, ["id,picture,u,v"]
    for name, (east_m, north_m) in POINTS.items():
        point_n = np.array([north_m, east_m, 0.0])
        latitude, longitude, height_m = map(float, PLANE.geodetic_from_ned(point_n))
        places[name] = math.degrees(latitude), math.degrees(longitude), height_m
        for number, each in enumerate(stills):
            uv = pixel_of(each, point_n)
            if uv is not None:
                rows.append(f"{name},{name_of(number)},{uv[0]:.6f},{uv[1]:.6f}")
    line = [[longitude, latitude] for latitude, longitude, _ in places.values()]
    path = {"type": "LineString", "coordinates": line}
    feature = {"type": "Feature", "geometry": path, "properties": {"name": "path"}}
    collection = {"type": "FeatureCollection", "features": [feature]}
    survey = [f"{name},{a:.9f},{b:.9f},{h:.4f}" for name, (a, b, h) in places.items()]
    (folder / "map.geojson").write_text(json.dumps(collection))
    (folder / "survey.csv").write_text("\n".join(["id,lat,lon,h", *survey]))
    (folder / "observations.csv").write_text("\n".join(rows))

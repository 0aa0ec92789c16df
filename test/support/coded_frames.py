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
"""Frames of which each pixel's values say where on the ground it looks: x and y of a plane."""

from __future__ import annotations

import numpy as np
from scenes import PLANE, camera_pose, graticule

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Terrain, locate
from tirgeo_ros.core.orthorectification.orthophoto import GroundTiles
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.tools.export.frames import ExportFrame
from tirgeo_ros.tools.export.rasters import RasterOptions, RasterSetup

#: A small camera with the XT2's field of view and a lens that bends as much.
CAMERA = Camera(80, 64, 100.4, 99.7, 43.7, 31.2, (0.054, 0.3462, -0.0037, 0.0076))
GROUND_M = PLANE.height_m
#: North, east and down; looking 35 deg down to the north-east, and rolled.
OBLIQUE = camera_pose([3.0, -2.0, -20.0], 4.0, -35.0, 40.0)
NADIR = camera_pose([3.0, -2.0, -20.0], 0.0, -90.0, 40.0)
UTM = Plane(None, np.degrees([[PLANE.longitude_rad, PLANE.latitude_rad]]))
PIXEL_M = 0.2
CODE_M, WHOLE = 0.002, 65535
_STEP_DEG = (2e-5, 2.5e-5)  # about 2 m
_NODES = 201


def terrain_of(height_m) -> Terrain:
    """A surface around the origin: its height by metres north and east, every 2 m."""
    south_west = np.degrees([PLANE.latitude_rad, PLANE.longitude_rad]) - np.multiply(
        _STEP_DEG, _NODES // 2
    )
    north, east = (step * np.arange(_NODES) for step in _STEP_DEG)
    latitude, longitude = np.radians(south_west[0] + north), np.radians(south_west[1] + east)
    place = PLANE.ned_from_geodetic(latitude[::-1, None], longitude[None, :], GROUND_M)
    heights = GROUND_M + height_m(place[..., 0], place[..., 1])
    return Terrain(heights, graticule(tuple(south_west), _STEP_DEG, _NODES))


def coded(pose, ground, camera=CAMERA):
    """A 16-bit frame of x and y, in CODE_M from a corner, and that corner's x and y, m.

    The places are those of the rays' intersections with the ground. The third value is WHOLE
    where there is such a place, else 0; it is 0 in the outermost pixels too, beyond whose middles
    there is nothing to interpolate with.
    """
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    uv = np.stack([u.ravel(), v.ravel()], 1).astype(float)
    points_n, _ = locate(camera, pose, uv, PLANE, ground)
    latitude, longitude, _ = PLANE.geodetic_from_ned(points_n)
    places = UTM.metres(np.degrees(np.stack([longitude, latitude], 1)))
    origin = np.degrees([[PLANE.longitude_rad, PLANE.latitude_rad]])
    corner = np.floor(UTM.metres(origin)[0]) - 60.0
    values = (places - corner) / CODE_M
    aside = np.abs(uv / np.array([camera.width - 1, camera.height - 1]) - 0.5).max(axis=1)
    inside = (aside < 0.5) & (np.isfinite(values) & (values > 0) & (values < 65535)).all(axis=1)
    values = np.column_stack([np.where(inside[:, None], values, 0), inside * WHOLE])
    return np.rint(values).astype(np.uint16).reshape(*v.shape, 3), corner


def tiles_of(ground, pixel_m=PIXEL_M, plane: TangentPlane = PLANE) -> GroundTiles:
    return GroundTiles(UTM, pixel_m, plane, ground)


def setup_of(ground=GROUND_M, pixel_m=PIXEL_M, **options) -> RasterSetup:
    return RasterSetup(UTM, tiles_of(ground, pixel_m), RasterOptions(**options))


def frame_of(pixels, pose=NADIR, number=0, ground=GROUND_M, camera=CAMERA) -> ExportFrame:
    body = BodyPose(pose.stamp_ns, pose.position_n, np.array([1.0, 0, 0, 0]), np.eye(6))
    stamp_ns = pose.stamp_ns + 50_000_000
    return ExportFrame(number, stamp_ns, pixels, camera, pose, body, PLANE, ground)

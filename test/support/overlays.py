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
"""An overlay over a square on the ground, and where its lines truly are."""

import math
from itertools import pairwise

import numpy as np
from scenes import camera_pose

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.map.vector_map import GeoFeature, MapLayer
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.overlay.written_text import status_box
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus

PLANE = TangentPlane(math.radians(30.5), math.radians(114.3), 25.0)
MS = 1_000_000
START = 1_700_000_000_000 * MS
LATENCY = 50 * MS
WAIT = 100 * MS
GREY = np.full((512, 640), 90, np.uint8)
STRIP_TOP = status_box(GREY).top
#: No scale bar, rose, ellipses or fading: lines and labels alone.
PLAIN = ConfidenceConfig(ellipses=False, lines="none", scale_bar=False, heading_rose=False)
SQUARE_N = np.array([[30, -6, 0], [30, 6, 0], [42, 6, 0], [42, -6, 0]], float)
MOVED_N = np.array([2.0, 3.0, 0.0])


def geo(points_n, label=""):
    points = np.column_stack(PLANE.geodetic_from_ned(np.asarray(points_n, float)))
    return GeoFeature(label, closed=len(points_n) > 2, points=points)


def pose_at(stamp_ns, north=0.0, yaw_deg=0.0):
    return camera_pose([north, 0.0, -20.0], 0.0, -30.0, yaw_deg, 1e-4, stamp_ns)


def status(state=FilterState.RUNNING, reason=""):
    return NavigationStatus("ekf_heading", state, reason, FixStatus.FIXED, 0.002, {}, {})


def ready(features=None, *, layers=(), has_status=True, **config):
    """Return an overlay with camera and plane; with ``layers`` None its map is set later."""
    layer = MapLayer("map", [geo(SQUARE_N)] if features is None else features)
    overlay = Overlay(OverlayConfig(**config), None if layers is None else [layer])
    overlay.set_plane(PLANE)
    overlay.set_camera(XT2)
    if has_status:
        overlay.status = status()
    return overlay


def luminance(bgr):
    """Relative luminance of sRGB colours (..., 3) (IEC 61966-2-1)."""
    unit = np.array(bgr) / 255
    linear = np.where(unit <= 0.04045, unit / 12.92, ((unit + 0.055) / 1.055) ** 2.4)
    return linear @ [0.0722, 0.7152, 0.2126]


def ink_on(image):
    v, u = np.nonzero(image[:490, :, 2].astype(int) - image[:490, :, 0] > 100)
    return np.column_stack([u, v])


def true_outline(pose, points_n=SQUARE_N, camera=XT2):
    ring = np.concatenate([points_n, points_n[:1]])
    t = np.linspace(0, 1, 2000)[:, None]
    points = np.concatenate([a + t * (b - a) for a, b in pairwise(ring)])
    uv, valid = camera.project((points - pose.position_n) @ matrix_from_quat(pose.q_nc))
    return uv[valid]


def distances(pixels, outline):
    return np.array([np.hypot(*(outline - pixel).T).min() for pixel in pixels])


def pictured(overlay, stamp_ns=START, now_ns=START, frame=GREY, **pose):
    """Return what becomes of a frame whose pose is there."""
    overlay.poses.add(pose_at(stamp_ns, **pose))
    overlay.add_frame(stamp_ns + LATENCY, frame, now_ns)
    return overlay.take(now_ns)


def assert_on(image, pose):
    pixels = ink_on(image)
    assert len(pixels) > 400
    # Half the diagonal of a pixel and the ink's own width to each side.
    assert distances(pixels, true_outline(pose)).max() < 1.5
    outline = true_outline(pose)
    observed = outline[(outline > 2).all(axis=1) & (outline < [637, 487]).all(axis=1)]
    assert distances(observed[::40], pixels).max() < 1.5

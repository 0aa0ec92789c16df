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
"""A target and an aircraft to say as Cursor-on-Target, and a link that says them."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Iterator

import numpy as np

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import BODY_OPTICAL, matrix_from_euler, quat_from_matrix
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.frame_geometry import Sight, frame_geometry
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.targets.cot_events import AircraftState
from tirgeo_ros.page.cot.link import CotLink

#: 2 m in each level direction and 0.5 m up, one standard deviation.
ROUND = (4.0, 0, 0, 0, 4.0, 0, 0, 0, 0.25)


def target(number: int, name: str = "", latitude_deg: float = 48.20817425) -> Target:
    now_ns = time.time_ns()
    click = Located(now_ns, latitude_deg, 16.37381885, 211.25, ROUND)
    return Target(f"{number:032x}", number, name, "person", "", "", now_ns, now_ns, (click,))


def flying() -> AircraftState:
    """Return an aircraft 150 m above the ground whose camera looks down to the south-west."""
    plane = TangentPlane(math.radians(48.2), math.radians(16.37), 200.0)
    q_nc = quat_from_matrix(matrix_from_euler(*np.radians([3, -50, 225])) @ BODY_OPTICAL)
    covariance = np.diag([0.01] * 3 + [1e-6] * 3)
    pose = CameraPose(0, np.array([0.0, 0, -150]), q_nc, covariance)
    view = frame_geometry(Sight(XT2, pose, plane, 200.0), ConfidenceConfig())
    return AircraftState("uav1", 48.2, 16.37, 350.0, 0.1, 0.2, 225.0, 8.5, view)


@contextlib.contextmanager
def sharing(cot: str, **parameters: str) -> Iterator[CotLink]:
    """Run a link that shares."""
    link = CotLink(ViewerConfig(cot=cot, **parameters), lambda _: None)
    link.start()
    link.share(on=True)
    try:
        yield link
    finally:
        link.stop()

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
"""How far located pixels of a planted flight are from the truth, in units of their ellipses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dev.planted_faults.faults import FlightFiles
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CHI2_95, CameraRates
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.ground_point import Located, place
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.messages import pictures as picture_messages
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.tools.replay.graph_outputs import read_outputs
from tirgeo_ros.tools.replay.node_configs import node_configs

_PICTURES = "/thermal/image_raw/compressed"
_WHOLE_FLIGHT_S = 1e9
_RATES_NS = 100_000_000
#: Of the picture's width and height: the middle, and a quarter from the edges.
_PLACES = ((0.5, 0.5), (0.25, 0.5), (0.75, 0.5), (0.5, 0.75))


@dataclass
class Locator:
    """Locate pixels: poses of a bag, a lens, a latency and a ground."""

    poses: PoseBuffer[CameraPose]
    plane: TangentPlane
    camera: Camera
    ground: Ground
    config: OverlayConfig

    @classmethod
    def of(cls, flight: FlightFiles, poses_bag: Path) -> Locator | None:
        """Return that of a bag with camera poses; None without poses, a lens or a ground."""
        overlay = node_configs(flight.params, dem=flight.options.get("dem")).overlay
        outputs, ground = read_outputs(poses_bag), ground_of(overlay)
        item = next(iter(BagReader(flight.bag).messages(["/thermal/camera_info"])), None)
        if item is None or ground is None or outputs.plane is None or not outputs.cameras:
            return None
        camera = picture_messages.camera(Cdr().deserialize(item.data, item.typename))
        poses: PoseBuffer[CameraPose] = PoseBuffer(_WHOLE_FLIGHT_S)
        for pose in outputs.cameras:
            poses.add(pose)
        return cls(poses, outputs.plane, camera, ground, overlay)

    def locate(self, stamp_ns: int, uv: tuple[float, float]) -> Located | None:
        """Return the place at a pixel of a picture; None where there is none."""
        exposed_ns = exposure_ns(stamp_ns, self.config.video_latency_s)
        pose, before = self.poses.at(exposed_ns), self.poses.at(exposed_ns - _RATES_NS)
        if isinstance(pose, Miss):
            return None
        rates = None if isinstance(before, Miss) else CameraRates.between(before, pose)
        located = place(
            self.camera, pose, uv, self.plane, self.ground, self.config.confidence, rates
        )
        return located if isinstance(located, Located) else None


def times_of_ellipse(
    assumed: Locator, true: Locator, stamp_ns: int, true_ns: int, flipped: Sequence[int] = ()
) -> float:
    """Return the largest error of a picture's pixels over its ellipse; nan: none is located.

    1 is on the ellipse of 95 %. A pixel that the truth has nowhere counts as infinitely wrong.
    ``true_ns``: the picture's stamp in the good flight; ``flipped``: its axes, 0 down, 1 across.
    """
    right, bottom = true.camera.width - 1, true.camera.height - 1
    errors = []
    for across, down in _PLACES:
        located = assumed.locate(stamp_ns, (across * right, down * bottom))
        if located is None:
            continue
        true_across = 1 - across if 1 in flipped else across
        true_down = 1 - down if 0 in flipped else down
        actual = true.locate(true_ns, (true_across * right, true_down * bottom))
        if actual is None:
            return math.inf
        geodetic = actual.latitude_rad, actual.longitude_rad, actual.height_m
        off = (located.point_n - assumed.plane.ned_from_geodetic(*geodetic))[:2]
        squared = float(off @ np.linalg.solve(located.covariance_n[:2, :2], off))
        errors.append(math.sqrt(squared / CHI2_95))
    return max(errors, default=math.nan)


def flight_times(
    good: FlightFiles, planted: FlightFiles, poses: Path, flipped: Sequence[int]
) -> list[float]:
    """Return the errors over the ellipse of all pictures that are located."""
    assumed = Locator.of(planted, poses)
    true = Locator.of(good, good.bag.with_name("truth.mcap"))
    if assumed is None or true is None:
        return []
    stamps = [
        [header_stamp_ns(item.data) for item in BagReader(bag).messages([_PICTURES])]
        for bag in (planted.bag, good.bag)
    ]
    errors = [
        times_of_ellipse(assumed, true, planted_ns, good_ns, flipped)
        for planted_ns, good_ns in zip(*stamps, strict=True)
    ]
    return [error for error in errors if not math.isnan(error)]

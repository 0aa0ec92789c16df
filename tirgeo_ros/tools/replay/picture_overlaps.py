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
"""Compare what a few of a flight's pictures show twice, for ``tirgeo check``."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np

from tirgeo_ros.core.adjustment.adjustment import disagreement, shift_sigmas
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground, is_given
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.ties.tie_config import TieConfig
from tirgeo_ros.core.ties.tie_finder import OTHER_HEADING_RAD, TieFinder, turns_rad
from tirgeo_ros.core.ties.tracks import TiedPair
from tirgeo_ros.core.ties.view import View
from tirgeo_ros.core.types.errors import BagError, CameraError, TirgeoError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_pictures import FlightPictures
from tirgeo_ros.tools.replay.flight_ties import fits, median

#: Of a check: the pictures to choose from, evenly in time, and the places where four of them are
#: compared, for 0.2 s each. In a large picture features take several times as long.
_MOST_PICTURES, _PLACES, _LARGE_PX = 200, 3, 500_000
_BRIEF = TieConfig(features=800, pairs_per_picture=3)


class PictureOverlaps:
    """Compare what a few of a flight's pictures show twice, by poses computed for other work.

    Without pictures or a known ground nothing is compared.
    """

    def __init__(
        self, reader: BagReader, namespace: str, overlay: OverlayConfig, ground: Ground | None
    ) -> None:
        self._ground, self._overlay = ground, overlay
        self._stamps_ns: dict[int, int] = {}  # by the pictures' numbers, evenly in time
        with suppress(BagError):
            self._pictures = FlightPictures(reader, namespace)
            if is_given(ground):
                stamps_ns = [*enumerate(self._pictures.stamps_ns)]
                self._stamps_ns = dict(stamps_ns[:: len(stamps_ns) // _MOST_PICTURES + 1])

    @property
    def instants_ns(self) -> list[int]:
        """Return the instants at which poses are needed."""
        latency_s = self._overlay.video_latency_s
        return [exposure_ns(stamp_ns, latency_s) for stamp_ns in self._stamps_ns.values()]

    def disagreement(self, flight: Flight, poses: FlightPoses) -> dict[str, dict[str, float]]:
        """Read a few pictures; return medians over pairs of other headings, and of the same one.

        A picture that cannot be read, or does not fit the lens, is left out.
        """
        if poses.plane is None or self._ground is None or not self._stamps_ns:
            return {}
        given, sigma_m = (poses.plane, self._ground), self._overlay.confidence.ground_sigma_m
        rows: dict[str, list[tuple[float, float]]] = {}
        with suppress(CameraError, BagError):  # other findings name it
            views, pairs = self._tied(flight.camera, poses, *given)
            for pair in pairs:
                both = [views[stamp_ns] for stamp_ns in (pair.first_ns, pair.second_ns)]
                turn_rad = turns_rad(np.stack([view.pose.q_nc for view in both]))[0, 1]
                name = "other_headings" if turn_rad >= OTHER_HEADING_RAD else "same_heading"
                sigmas = shift_sigmas(both, pair, *given, sigma_m)
                if math.isfinite(sigmas):
                    apart_m = median(disagreement(views, [pair], *given))
                    rows.setdefault(name, []).append((apart_m, sigmas))
        medians = {name: np.median(row, axis=0).tolist() for name, row in rows.items()}
        return {
            name: {"pairs": len(rows[name]), "apart_m": apart_m, "sigmas": sigmas}
            for name, (apart_m, sigmas) in medians.items()
        }

    def _tied(
        self, camera: Camera, poses: FlightPoses, plane: TangentPlane, ground: Ground
    ) -> tuple[dict[int, View], list[TiedPair]]:
        chooser = TieFinder(plane, ground)
        for stamp_ns, at_ns in zip(self._stamps_ns.values(), self.instants_ns, strict=True):
            posed = poses.at(at_ns)
            if posed is not None:
                chooser.add(View(stamp_ns, camera, posed[0]), None)
        large = camera.width * camera.height > _LARGE_PX
        views = {view.stamp_ns: view for view in chooser.crossing(1 if large else _PLACES)}
        numbers = [number for number, stamp_ns in self._stamps_ns.items() if stamp_ns in views]
        finder = TieFinder(plane, ground, _BRIEF)
        for number, pixels in self._pictures.read(numbers):
            view = views[self._stamps_ns[number]]
            if not isinstance(pixels, TirgeoError) and fits(pixels.shape, camera):
                finder.add(view, pixels)
        return views, finder.pairs()

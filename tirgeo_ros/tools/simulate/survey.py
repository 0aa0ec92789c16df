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
"""Survey control points on corners of flower beds, and simulate an operator's clicks on them.

As in section 5.1 of Ren et al. 2022, each point is measured with RTK and clicked in several
pictures that show it from near enough.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.io.surveys.survey import Observation, SurveyPoint
from tirgeo_ros.tools.simulate.flight import SimulatedFlight
from tirgeo_ros.tools.simulate.park import Park, Relief
from tirgeo_ros.tools.simulate.processes import generator
from tirgeo_ros.tools.simulate.renderer import Target
from tirgeo_ros.tools.simulate.scenario import SurveyScenario
from tirgeo_ros.tools.simulate.sensors import Epochs


@dataclass(frozen=True)
class Views:
    """Hold the pixels of points, for example corners of beds, in every picture."""

    corners_p: Array  # (C, 3) m, on the plane of the site
    t_s: Array  # (F,) exposures of F pictures
    stamp_ns: list[int]  # F, of the pictures
    uv: Array  # (F, C, 2) px, by the true camera; nan if not visible
    good: npt.NDArray[np.bool_]  # (F, C) whether an operator would click


def surveyed(
    flight: SimulatedFlight, camera: Camera, park: Park
) -> tuple[list[SurveyPoint], list[Observation]]:
    """Return control points of a flight, and the clicks on them in order of their stamps.

    Raise ScenarioError if too few corners are visible in enough pictures.
    """
    config = flight.scenario.survey
    level = np.concatenate([bed.outline for bed in park.beds])
    views = _views(flight, camera, level)
    clicked = {corner: _apart(views, corner, config) for corner in range(len(views.corners_p))}
    candidates = [corner for corner, frames in clicked.items() if len(frames) >= config.views]
    if len(candidates) < config.points:
        raise ScenarioError(
            f"survey.points: {config.points} are wanted, but only {len(candidates)} corners are "
            f"seen well {config.views} times; fly longer or set fewer points"
        )
    chosen = _spread(views.corners_p, candidates, config.points)
    chosen.sort(key=lambda corner: clicked[corner][0])
    noise = generator(flight.seed, "survey").standard_normal((len(chosen), 3))
    measured_p = views.corners_p[chosen] + noise * np.array(config.sigma_m)
    geodetic = np.transpose(flight.plane.geodetic_from_ned(measured_p)).tolist()
    points = [SurveyPoint(f"P{k:02d}", *place) for k, place in enumerate(geodetic, 1)]
    rng, clicks = generator(flight.seed, "clicks"), []
    for point, corner in zip(points, chosen, strict=True):
        for frame in rng.choice(clicked[corner], config.views, replace=False).tolist():
            u, v = views.uv[frame, corner] + config.click_sigma_px * rng.standard_normal(2)
            clicks.append(Observation(point.id, views.stamp_ns[frame], float(u), float(v)))
    return points, sorted(clicks, key=lambda click: (click.stamp_ns, click.id))


def frames(flight: SimulatedFlight) -> Iterator[tuple[int, float]]:
    """Yield stamp (ns) and time of exposure (s) of the pictures, which arrive at their stamps."""
    video = flight.scenario.video
    epochs = Epochs.at_rate(flight.scenario, video.rate_hz, less_s=video.latency_s)
    for exposed_ns, t_s in zip(epochs.stamp_ns, epochs.t_s.tolist(), strict=True):
        yield exposed_ns + round(video.latency_s * 1e9), t_s


def sightings(
    flight: SimulatedFlight, camera: Camera, targets: Sequence[Target]
) -> list[Observation]:
    """Return a click on each target for each pass through the part of the picture for clicks.

    A pass is clicked without error, in the picture with the target nearest to the middle. Clicks
    are in order of their stamps.
    """
    if not targets:
        return []
    views = _views(flight, camera, np.array([target.center for target in targets]))
    off_middle = np.hypot(*np.moveaxis(views.uv - [camera.width / 2, camera.height / 2], -1, 0))
    clicks = []
    for k, target in enumerate(targets):
        frames = np.flatnonzero(views.good[:, k])
        passes = np.split(frames, np.flatnonzero(np.diff(frames) > 1) + 1)
        for frames in filter(len, passes):
            best = frames[int(np.argmin(off_middle[frames, k]))]
            u, v = views.uv[best, k].tolist()
            clicks.append(Observation(target.id, views.stamp_ns[best], u, v))
    return sorted(clicks, key=lambda click: (click.stamp_ns, click.id))


def _views(flight: SimulatedFlight, camera: Camera, level: Array) -> Views:
    """Project places on the ground, north and east (C, 2), into all pictures."""
    corners_p = Relief(flight.scenario.park).places(level)
    stamp_ns, times_s = map(list, zip(*frames(flight), strict=True))
    t_s = np.array(times_s)
    position, q_pc = flight.gimbal.camera(t_s)
    turned = [
        (corners_p - place) @ rotation
        for place, rotation in zip(position, matrix_from_quat(q_pc), strict=True)
    ]
    uv = np.array([camera.project(points_c)[0] for points_c in turned])
    (u, v), config = np.moveaxis(uv, -1, 0), flight.scenario.survey
    good = (v >= config.rows_px[0]) & (v <= config.rows_px[1])
    good &= (u >= config.side_px) & (u <= camera.width - 1 - config.side_px)
    good &= (t_s >= config.after_s)[:, None]
    return Views(corners_p, t_s, stamp_ns, uv, good)


def _apart(views: Views, corner: int, config: SurveyScenario) -> list[int]:
    """Return pictures that show a corner well, each at least ``apart_s`` after the previous."""
    frames: list[int] = []
    for frame in np.flatnonzero(views.good[:, corner]).tolist():
        if not frames or views.t_s[frame] - views.t_s[frames[-1]] >= config.apart_s:
            frames.append(frame)
    return frames


def _spread(corners_p: Array, candidates: list[int], count: int) -> list[int]:
    """Choose ``count`` candidates far apart: each is the farthest from all chosen before it."""
    places = corners_p[candidates]
    chosen = [int(np.argmin(places[:, 1]))]
    distance = np.linalg.norm(places - places[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(distance)))
        distance = np.minimum(distance, np.linalg.norm(places - places[chosen[-1]], axis=1))
    return [candidates[k] for k in chosen]

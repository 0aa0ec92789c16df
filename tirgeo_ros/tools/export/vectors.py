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
"""Export the flight for a GIS: what each picture shows, the track, and the targets."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import azimuth_row, matrix_from_quat
from tirgeo_ros.core.ground.frame_geometry import (
    Sight,
    body_rpy,
    camera_heading_rad,
    footprint,
    frame_geometry,
    height_above_m,
)
from tirgeo_ros.core.map.visibility import farthest_m
from tirgeo_ros.core.overlay.scale_bar_compass import ground_sample_m
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io.files.geopackage_layers import Layer, Row, write_layers
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.targets.geopackage import TARGET_LAYERS, read_targets, rows_of_target
from tirgeo_ros.tools.export.frames import ExportFrame

_WHEN = {"stamp_ns": "INTEGER", "time": "DATETIME"}
FOOTPRINTS = Layer(
    "footprints",
    "Polygon",
    {
        "picture": "INTEGER",  # its number in the flight, from 0
        **_WHEN,  # of the exposure
        "latitude_deg": "REAL",  # of the camera
        "longitude_deg": "REAL",
        "height_m": "REAL",  # ellipsoidal
        "above_ground_m": "REAL",
        "heading_deg": "REAL",  # of the view, from true north, clockwise
        "pitch_deg": "REAL",  # of the line of sight, 0 level, negative down
        "gsd_m": "REAL",  # ground that the middle pixel spans along its row
        "slant_range_m": "REAL",  # to the ground in the picture's middle
        "ce90_m": "REAL",  # of that ground point
        "le90_m": "REAL",
    },
    "what the pictures show of the ground, with where they were taken",
)
TRACK = Layer(
    "track",
    "LineString Z",
    {"begin": "DATETIME", "end": "DATETIME", "points": "INTEGER", "length_m": "REAL"},
    "the aircraft's way, a line for each unbroken part; ellipsoidal heights",
)
TRACK_POINTS = Layer(
    "track_points",
    "Point Z",
    {
        "picture": "INTEGER",
        **_WHEN,
        "state": "TEXT",  # of the filter
        "height_m": "REAL",
        "speed_m_s": "REAL",  # in space, the mean since the point before
        "roll_deg": "REAL",  # of the aircraft
        "pitch_deg": "REAL",
        "heading_deg": "REAL",
        "sigma_north_m": "REAL",  # one standard deviation
        "sigma_east_m": "REAL",
        "sigma_height_m": "REAL",
        "sigma_heading_deg": "REAL",
    },
    "the aircraft, at its IMU, when pictures were taken; ellipsoidal heights",
)
_CONFIDENCE = ConfidenceConfig()
#: The track is broken where points are so many intervals apart, or seconds if that is longer.
_INTERVALS, _LONGEST_S = 2.5, 2.0


class Vectors:
    """Write a GeoPackage of footprints, track and targets, in WGS84 (EPSG:4326); a Product.

    Each picture that is taken gives an outline and a point of the track. They are expected every
    ``every_s`` seconds (0: all of the flight): where they are missing, the track is broken.
    ``targets`` is a file of targets; without it, their layers are absent. ``confidence`` gives the
    sigmas other than the pose's. ``state_at`` returns the filter's state at a time of exposure
    (ns). Raises ExportError and TargetError naming the file.
    """

    def __init__(
        self,
        path: Path,
        every_s: float = 0.0,
        targets: PathLike | None = None,
        confidence: ConfidenceConfig = _CONFIDENCE,
        state_at: Callable[[int], str | None] | None = None,
    ) -> None:
        clicked = [] if targets is None else read_targets(targets)
        layers = (FOOTPRINTS, TRACK, TRACK_POINTS) + (() if targets is None else TARGET_LAYERS)
        self._path, self._confidence, self._state_at = path, confidence, state_at
        self._rows: dict[str, list[Row]] = {layer.name: [] for layer in layers}
        self._layers = layers
        for target in clicked:
            for layer, row, positions in rows_of_target(target):
                self._rows[layer.name].append((positions, row))
        self._longest_s = max(_INTERVALS * every_s, _LONGEST_S)
        self._newest: BodyPose | None = None
        #: The parts of the track: time (ns), place and step (m) of each point.
        self._parts: list[list[tuple[int, tuple[float, ...], float]]] = []
        self._without_ground = 0

    def take(self, frame: ExportFrame) -> None:
        """Add the picture's outline and the aircraft's place."""
        self._add_track_point(frame)
        outline_n = np.empty((0, 3))
        if frame.ground is not None:
            sight = frame.pose, frame.plane, frame.ground
            far_m = farthest_m(frame.camera, height_above_m(*sight))
            outline_n = footprint(frame.camera, *sight, far_m)
        if len(outline_n) < 3:
            self._without_ground += 1
            return
        # Reversed, because the outline runs clockwise around the picture.
        latitude, longitude, _ = frame.plane.geodetic_from_ned(outline_n[::-1])
        # Longitudes go beyond 180 deg if the outline lies across that meridian.
        positions = np.degrees(np.stack([np.unwrap(longitude), latitude], axis=1))
        self._rows[FOOTPRINTS.name].append((positions, self._footprint_row(frame)))

    def finish(self) -> dict[str, object]:
        """Write the file; return its name and the rows by layer."""
        for part in self._parts:
            if len(part) > 1:
                stamps_ns, places, steps_m = zip(*part, strict=True)
                row = {
                    "begin": stamps_ns[0],
                    "end": stamps_ns[-1],
                    "points": len(part),
                    "length_m": sum(steps_m),
                }
                self._rows[TRACK.name].append((places, row))
        write_layers(self._path, [(layer, self._rows[layer.name]) for layer in self._layers])
        result: dict[str, object] = {"file": str(self._path)}
        result |= {name: len(rows) for name, rows in self._rows.items()}
        return result | {"pictures_without_ground": self._without_ground}

    def _footprint_row(self, frame: ExportFrame) -> dict[str, object]:
        pose, plane, ground = frame.pose, frame.plane, frame.ground
        assert ground is not None  # there is an outline
        sight = Sight(frame.camera, pose, plane, ground, frame.body)
        geometry = frame_geometry(sight, self._confidence)
        latitude, longitude, height_m = geometry.sensor
        return {
            "picture": frame.number,
            "stamp_ns": pose.stamp_ns,
            "time": pose.stamp_ns,
            "latitude_deg": math.degrees(latitude),
            "longitude_deg": math.degrees(longitude),
            "height_m": height_m,
            "above_ground_m": height_above_m(pose, plane, ground),
            "heading_deg": math.degrees(camera_heading_rad(pose)),
            "pitch_deg": math.degrees(geometry.sight_rpy[1]),
            "gsd_m": ground_sample_m(sight),
            "slant_range_m": geometry.slant_range_m,
            "ce90_m": geometry.ce90_m,
            "le90_m": geometry.le90_m,
        }

    def _add_track_point(self, frame: ExportFrame) -> None:
        """Add a point to the track; begin a new part if the one before lies too far back."""
        body, before = frame.body, self._newest
        latitude, longitude, height_m = map(float, frame.plane.geodetic_from_ned(body.position_n))
        place = math.degrees(longitude), math.degrees(latitude), height_m
        step_s = (body.stamp_ns - before.stamp_ns) * 1e-9 if before else math.inf
        step_m, speed_m_s = 0.0, None
        if before is None or not 0 < step_s <= self._longest_s:
            self._parts.append([])
        else:
            step_m = float(np.linalg.norm(body.position_n - before.position_n))
            speed_m_s = step_m / step_s
        self._parts[-1].append((body.stamp_ns, place, step_m))
        self._newest = body
        roll, pitch, heading = map(math.degrees, body_rpy(body, frame.plane))
        north_m, east_m, down_m = np.sqrt(body.covariance.diagonal()[:3]).tolist()
        nose_n: Sequence[float] = matrix_from_quat(body.q_nb)[:, 0].tolist()
        azimuth = np.array(azimuth_row(nose_n))
        row = {
            "picture": frame.number,
            "stamp_ns": body.stamp_ns,
            "time": body.stamp_ns,
            "state": self._state_at(body.stamp_ns) if self._state_at else None,
            "height_m": height_m,
            "speed_m_s": speed_m_s,
            "roll_deg": roll,
            "pitch_deg": pitch,
            "heading_deg": heading % 360.0,
            "sigma_north_m": north_m,
            "sigma_east_m": east_m,
            "sigma_height_m": down_m,
            "sigma_heading_deg": math.degrees(
                math.sqrt(azimuth @ body.covariance[3:, 3:] @ azimuth)
            ),
        }
        self._rows[TRACK_POINTS.name].append(([place], row))

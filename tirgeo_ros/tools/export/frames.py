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
"""Register chosen pictures of a flight, and read them with the data of their products."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground, Terrain
from tirgeo_ros.core.streams.stamps import exposure_ns
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import BagError, TirgeoError
from tirgeo_ros.core.types.finding import stop_line
from tirgeo_ros.core.types.poses import BodyPose, CameraPose
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.pictures.camera_file import configured_camera
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.presentation.results import finding_items
from tirgeo_ros.tools.replay.flight import Flight, FlightPoses
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_pictures import Chosen, FlightPictures
from tirgeo_ros.tools.replay.flight_ties import flight_adjustment
from tirgeo_ros.tools.replay.node_configs import OpenedFlight
from tirgeo_ros.tools.replay.registration import Registered, Sample

#: Why a picture has no pose.
_WHY_NOT = {
    Miss.EMPTY: "no pose near the exposure",
    Miss.TOO_OLD: "before the first pose",
    Miss.TOO_NEW: "after the last pose",
    Miss.GAP: "no pose near the exposure",
}


class Posed(NamedTuple):
    """Hold the poses at a picture's exposure."""

    stamp_ns: int  # of the picture's header
    pose: CameraPose
    body: BodyPose


class RegisteredFlight(NamedTuple):
    """Hold a flight whose pictures have poses, at least one of them."""

    camera: Camera
    plane: TangentPlane
    ground: Ground | None
    posed: Mapping[int, Posed]  # by the picture's number
    refused: Counter[str]  # pictures without a trusted pose, by reason
    states: Mapping[int, str]  # of the filter, by the exposures (ns)
    summary: Mapping[str, object]
    no_go: str | None  # the worst STOP of the checks


def register(
    opened: OpenedFlight,
    chosen: Sequence[Chosen],
    progress: Report,
    *,
    smooth: bool = False,
    adjust: bool = False,
) -> RegisteredFlight:
    """Find the poses of pictures. Raise BagError without any; CameraError, ElevationError."""
    reader, namespace, overlay = opened.reader, opened.namespace, opened.configs.overlay
    ground, lens = ground_of(overlay), configured_camera(overlay)
    checks = FlightChecks(opened, ground=ground, camera=lens, pictures=True)
    flight = Flight(reader, namespace, pictures=True, camera=lens, checks=checks)
    exposures_ns = [exposure_ns(each.stamp_ns, overlay.video_latency_s) for each in chosen]
    ekf, gimbal = opened.configs.ekf, opened.configs.gimbal
    adjustment, adjusted = flight_adjustment(opened, progress, adjust=adjust, smooth=smooth)
    poses = flight.registered(ekf, gimbal, exposures_ns, smooth=smooth, adjustment=adjustment)
    bodies = _Bodies(exposures_ns, poses)
    poses.watchers += [bodies.watch, checks.watch]
    flight.read_all(progress)
    posed: dict[int, Posed] = {}
    refused: Counter[str] = Counter()
    for (number, stamp_ns), exposed_ns in zip(chosen, exposures_ns, strict=True):
        pose, body = poses.cameras.at(exposed_ns), bodies.at(exposed_ns)
        if isinstance(pose, Miss):
            refused[_WHY_NOT[pose]] += 1
        elif isinstance(body, Miss):
            refused[_WHY_NOT[body]] += 1
        else:
            posed[number] = Posed(stamp_ns, pose, body)
    status = poses.registration.navigation.status()
    if not posed or poses.plane is None:
        why = ", ".join(refused) or "none was recorded then (--from, --to)"
        state = f"; the filter is {status.state.value} at the end"
        start = f"{reader.path}: none of {len(chosen)} pictures has a trusted pose"
        raise BagError(f"{start}: {why}{state}")
    findings = checks.findings()
    summary = {
        "method": status.method,
        "composition": poses.registration.composer.composition,
        "state": status.state.value,
        "smoothed": smooth,
        "findings": finding_items(findings),
        "notes": [
            *opened.notes,
            *adjusted,
            *(ground.notes if isinstance(ground, Terrain) else ()),
        ],
    }
    place = flight.camera, poses.plane, ground
    return RegisteredFlight(*place, posed, refused, bodies.states, summary, stop_line(findings))


class _Bodies:
    """Keep the aircraft's poses and the filter's states at some instants (ns)."""

    def __init__(self, instants_ns: Sequence[int], flight_poses: FlightPoses) -> None:
        self._flight_poses = flight_poses
        self._waiting = sorted(instants_ns, reverse=True)
        self._recent: PoseBuffer[BodyPose] = PoseBuffer()
        self._poses: dict[int, BodyPose | Miss] = {}
        self.states: dict[int, str] = {}

    def watch(self, _sample: Sample, registered: Registered) -> None:
        """Take a new pose, and keep those at the instants before it."""
        if registered.body is None or not self._recent.add(registered.body):
            return
        while self._waiting and self._waiting[-1] <= registered.body.stamp_ns:
            instant_ns = self._waiting.pop()
            self._poses[instant_ns] = self._recent.at(instant_ns)
            status = self._flight_poses.registration.navigation.status()
            self.states[instant_ns] = status.state.value

    def at(self, instant_ns: int) -> BodyPose | Miss:
        """Return the pose at an instant, or why there is none."""
        return self._poses.get(instant_ns, Miss.TOO_NEW)


@dataclass(frozen=True)
class ExportFrame:
    """Hold a picture as recorded, with the poses at its exposure and the ground."""

    number: int  # of the picture in the flight, from 0
    stamp_ns: int  # of the picture's header
    pixels: Pixels  # (h, w) 8 or 16 bits, or (h, w, 3) BGR
    camera: Camera
    pose: CameraPose  # at the time of exposure
    body: BodyPose  # at the time of exposure
    plane: TangentPlane
    ground: Ground | None


def frames(
    pictures: FlightPictures, flight: RegisteredFlight, progress: Report
) -> Iterator[ExportFrame]:
    """Yield the pictures that have a pose, in order; count those that cannot be read."""
    kind = None
    for done, (number, pixels) in enumerate(pictures.read(flight.posed)):
        progress(done, len(flight.posed))
        if isinstance(pixels, TirgeoError):
            flight.refused["damaged"] += 1
            continue
        kind = kind or (pixels.dtype, pixels.ndim)
        if pixels.shape[:2] != (flight.camera.height, flight.camera.width):
            flight.refused["of another size than the camera's calibration"] += 1
        elif (pixels.dtype, pixels.ndim) != kind:
            flight.refused["of another kind than the first picture"] += 1
        else:
            stamp_ns, pose, body = flight.posed[number]
            place = flight.camera, pose, body, flight.plane, flight.ground
            yield ExportFrame(number, stamp_ns, pixels, *place)

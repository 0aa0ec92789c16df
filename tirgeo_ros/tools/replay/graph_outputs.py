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
"""Read poses, pictures and states from the bag of a run of the node graph."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from tirgeo_ros.core.frames.rotations import (
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.arrays import Array, Pixels
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import NavigationStatus
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import pictures as picture_messages
from tirgeo_ros.io.messages.topics import prefix
from tirgeo_ros.tools.replay.flight import WHOLE_FLIGHT_S

OVERLAY = "tirgeo/overlay/image/compressed"


def in_plane(pose: CameraPose, plane: TangentPlane, target: TangentPlane) -> CameraPose:
    """Convert a pose given in ``plane`` to ``target``, with its rotation and covariance."""
    turn = target.rotation_from_local(plane.latitude_rad, plane.longitude_rad)
    both = np.kron(np.eye(2), turn)
    return dataclasses.replace(
        pose,
        position_n=target.ned_from_geodetic(*plane.geodetic_from_ned(pose.position_n)),
        q_nc=quat_multiply(quat_from_matrix(turn), pose.q_nc),
        covariance=both @ pose.covariance @ both.T,
    )


@dataclass(frozen=True)
class PoseDifferences:
    """Hold the differences of N poses from the reference at the same instants."""

    stamp_ns: list[int]
    position_n: Array  # (N, 3) m
    rotation_n: Array  # (N, 3) rad: the rotation from the reference to the pose

    @property
    def distance_m(self) -> Array:
        """Return the distances in space (N,), m."""
        return np.asarray(np.linalg.norm(self.position_n, axis=1))

    @property
    def angle_rad(self) -> Array:
        """Return the angles of the rotations (N,), rad."""
        return np.asarray(np.linalg.norm(self.rotation_n, axis=1))


def differences(poses: Sequence[CameraPose], reference: Sequence[CameraPose]) -> PoseDifferences:
    """Compare poses in one plane; skip instants where the reference has no pose."""
    history: PoseBuffer[CameraPose] = PoseBuffer(WHOLE_FLIGHT_S)
    for pose in reference:
        history.add(pose)
    pairs = [(p, r) for p in poses if isinstance(r := history.at(p.stamp_ns), CameraPose)]
    return PoseDifferences(
        [pose.stamp_ns for pose, _ in pairs],
        np.array([pose.position_n - other.position_n for pose, other in pairs]).reshape(-1, 3),
        np.array(
            [rotvec_from_quat(quat_multiply(p.q_nc, quat_conjugate(r.q_nc))) for p, r in pairs]
        ).reshape(-1, 3),
    )


@dataclass
class Outputs:
    """Hold the contents of a bag of outputs, without its pictures."""

    plane: TangentPlane | None = None
    cameras: list[CameraPose] = field(default_factory=list)
    frame_stamps_ns: list[int] = field(default_factory=list)
    #: States that each node reported, in order, by the node's name in the namespace.
    states: dict[str, list[convert.NodeState]] = field(default_factory=dict)

    @property
    def navigation(self) -> list[NavigationStatus]:
        """Return the estimator's status, in order."""
        states = self.states.get("ekf_node", [])
        return [state.navigation for state in states if state.navigation is not None]

    def topic(self, node: str, topic: str) -> list[convert.TopicState]:
        """Return the reported states of a node's topic, in order."""
        states = self.states.get(node, [])
        return [state.topics[topic] for state in states if topic in state.topics]

    def counts(self, node: str) -> Mapping[str, int]:
        """Return the newest counts of a node; none if it reported nothing."""
        states = self.states.get(node, [])
        return states[-1].counts if states else {}

    def earlier(self, shift_ns: int) -> Outputs:
        """Return a copy with the stamps of poses and frames reduced by ``shift_ns``.

        This undoes the shift of a bag that was played live.
        """
        return replace(
            self,
            cameras=[replace(pose, stamp_ns=pose.stamp_ns - shift_ns) for pose in self.cameras],
            frame_stamps_ns=[stamp_ns - shift_ns for stamp_ns in self.frame_stamps_ns],
        )


def read_outputs(path: Path, namespace: str = "") -> Outputs:
    """Read a bag that ``recorder`` or ``tirgeo process`` wrote. Raise BagError."""
    lead = prefix(namespace)
    cdr, outputs = Cdr(), Outputs()
    for item in BagReader(path).messages():
        message = cdr.deserialize(item.data, item.typename)
        if item.topic == f"{lead}tirgeo/origin":
            outputs.plane = convert.tangent_plane(message)
        elif item.topic == f"{lead}tirgeo/camera_pose":
            outputs.cameras.append(convert.camera_pose(message))
        elif item.topic == lead + OVERLAY:
            outputs.frame_stamps_ns.append(convert.stamp_ns(message))
        elif item.topic == f"{lead}{convert.STATE_TOPIC}":
            state = convert.node_state(message)
            outputs.states.setdefault(state.name, []).append(state)
    return outputs


def read_pictures(path: Path) -> Iterator[tuple[int, Pixels]]:
    """Yield stamp (ns) and overlay picture (h, w, 3) BGR of such a bag, in order."""
    cdr = Cdr()
    for item in BagReader(path).messages([f"/{OVERLAY}"]):
        message = cdr.deserialize(item.data, item.typename)
        yield convert.stamp_ns(message), picture_messages.compressed_pixels(message)

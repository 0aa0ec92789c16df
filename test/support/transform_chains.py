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
"""Look transforms up as tf2 does: interpolated in time, chained to the root, by SciPy alone."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from tirgeo_ros.io.messages import stamp_ns


def rigid(xyz, q) -> np.ndarray:
    """(4, 4) of a translation and a rotation as messages have them."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix()
    matrix[:3, 3] = xyz.x, xyz.y, xyz.z
    return matrix


class Chains:
    """The newest of each stamp of all transforms; ``parents`` has each frame's one parent."""

    def __init__(self, messages) -> None:
        self.parents: dict[str, str] = {}
        self._poses: dict[str, dict[int, np.ndarray]] = defaultdict(dict)
        for message in messages:
            for item in message.transforms:
                child, parent = item.child_frame_id, item.header.frame_id
                assert self.parents.setdefault(child, parent) == parent, f"{child} has two parents"
                pose = rigid(item.transform.translation, item.transform.rotation)
                self._poses[child][stamp_ns(item)] = pose

    def pose(self, child: str, stamp: int) -> np.ndarray:
        """(4, 4) of a frame in the root of its tree."""
        parent = self.parents[child]
        own = self._between(self._poses[child], stamp)
        return self.pose(parent, stamp) @ own if parent in self.parents else own

    @staticmethod
    def _between(poses: dict[int, np.ndarray], stamp: int) -> np.ndarray:
        if stamp in poses:
            return poses[stamp]
        stamps = sorted(poses)
        after = bisect_left(stamps, stamp)
        start, end = stamps[after - 1], stamps[after]
        share, two = (stamp - start) / (end - start), [poses[start], poses[end]]
        result = np.eye(4)
        turns = Rotation.from_matrix([pose[:3, :3] for pose in two])
        result[:3, :3] = Slerp([0, 1], turns)(share).as_matrix()
        result[:3, 3] = two[0][:3, 3] + share * (two[1][:3, 3] - two[0][:3, 3])
        return result

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
"""Compose camera poses from gimbal samples, each at the sample's own time stamp.

A gimbal sample waits until there are body poses before and after its stamp. Then the camera's pose
is composed (``tirgeo_ros.core.gimbal.camera_pose``) with the interpolated body pose. Nothing is
extrapolated: a sample that waits too long, or that falls into a gap, is dropped and counted.

The reported attitudes also measure the bias of the gimbal's north relative to the autopilot's
(``tirgeo_ros.core.gimbal.yaw_bias``). No body pose is needed for that.

Joints may be computed from the reported attitudes (``JointSample.computed``). They give camera
poses as encoder angles do, but they are not an independent measurement: compared with the reported
attitudes they would always show a bias of zero, so this comparison is never made. If the gimbal is
centred, however, computed joints measure the bias as well as reported attitudes do, and that
measurement is used.
"""

from __future__ import annotations

import math
from collections import Counter, deque
from dataclasses import replace

from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.frames.rotations import quat_multiply, slerp
from tirgeo_ros.core.gimbal.camera_pose import (
    Mount,
    YawBias,
    camera_turn,
    from_computed,
    from_joints,
    from_reported,
)
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer, StampedBuffer
from tirgeo_ros.core.gimbal.yaw_bias import YawBiasFilter, YawBiasMeasurements
from tirgeo_ros.core.streams.sanity_checks import joints_fault, usable_attitude
from tirgeo_ros.core.streams.stamps import StreamPresence
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample
from tirgeo_ros.core.types.poses import BodyPose, CameraPose

_HISTORY_S = 3.0
_MAY_COME = (Miss.EMPTY, Miss.TOO_NEW)


class GimbalComposer:
    """Compose camera poses from gimbal samples and body poses that arrive in any order.

    Each ``add_`` method returns the camera poses that became possible, one per gimbal sample, in
    order of their stamps. With ``composition: auto`` the joint angles are used while they arrive
    steadily, and the reported attitude otherwise. While both arrive, they measure the bias of the
    gimbal's north, so that it is known when the joints stop. Computed joints use the covariance
    and the north bias of reported attitudes.
    """

    def __init__(self, config: GimbalConfig) -> None:
        self._choice = config.composition
        self._by_joints = config.composition == "encoders"
        self._computed = False  # whether the newest joints are computed
        self._bodies: PoseBuffer[BodyPose] = PoseBuffer()
        self._autopilot: StampedBuffer[Array] = StampedBuffer()
        self._joints: StampedBuffer[Array] = StampedBuffer()  # q_bg
        self._presence = StreamPresence()
        self._waiting: deque[JointSample | CameraAttitudeSample] = deque()
        self._newest_ns: int | None = None
        self._handover_ns: int | None = None
        self._counts: Counter[str] = Counter()
        self._north = YawBiasFilter(config.north)
        self.configure(config)

    def configure(self, config: GimbalConfig) -> None:
        """Set all parameters but ``composition``, at start or in flight.

        The estimate of the bias of the gimbal's north restarts if its initial values change.
        """
        self._mount = Mount.from_config(config)
        self._yaw_zero_rad = config.yaw_zero_rad
        self._max_wait_ns = round(config.max_wait_s * 1e9)
        span_s = _HISTORY_S + config.max_wait_s
        self._bodies.keep(span_s, config.max_gap_s)
        for buffer in (self._autopilot, self._joints):
            buffer.keep(span_s)
        self._north.configure(config.north)
        roll_sigma_rad = math.radians(config.reported_sigma_deg[0])
        self._readings = YawBiasMeasurements(config.north, roll_sigma_rad)
        self._centred = config.north.centred

    @property
    def composition(self) -> str:
        """Return the composition in use now: ``encoders`` or ``paper``."""
        return "encoders" if self._by_joints else "paper"

    @property
    def sees_joints(self) -> bool:
        """Return whether the poses now come from joint angles that an encoder measured."""
        return self._by_joints and not self._computed

    @property
    def counts(self) -> dict[str, int]:
        """Return how many samples had each outcome so far; zeros are left out.

        ``composed``; for dropped gimbal samples: ``invalid``, ``repeated``, ``unused`` (of the
        topic that is not in use), ``no_heading``, and ``body_`` or ``autopilot_`` with the name
        of a Miss; ``went_back`` for gimbal stamps that cleared the waiting samples;
        ``body_invalid``, ``body_went_back``, ``autopilot_invalid``, ``autopilot_went_back`` for
        the other inputs; ``joints_computed``, the joints that no encoder measured;
        ``joints_steady`` and ``joints_silent``, how often ``auto`` changed to joints and back;
        ``north_used``, ``north_refused`` and ``north_reset`` for the measurements of the north.
        """
        counts = dict(self._counts) | {
            "north_used": self._north.updates,
            "north_refused": self._north.refused,
            "north_reset": self._north.resets,
            "body_invalid": self._bodies.invalid,
            "body_went_back": self._bodies.went_back,
            "autopilot_went_back": self._autopilot.went_back,
        }
        return {name: number for name, number in sorted(counts.items()) if number}

    @property
    def north(self) -> YawBias:
        """Return the bias of the gimbal's north at the newest sample.

        It is subtracted from reported attitudes (``paper``) and from joints computed from them.
        """
        return YawBias(self._north.bias_rad, self._north.variance)

    def body_at(self, stamp_ns: int) -> BodyPose | Miss:
        """Return the body pose from which the newest camera pose, of this stamp, was composed."""
        return self._bodies.at(stamp_ns)

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the diagnostics: the counts, and the north bias if it may be used.

        ``joints`` is present if the joints are computed; ``body_invalid_because`` is the reason
        why the newest refused body pose is not valid.
        """
        values = {name: str(number) for name, number in self.counts.items()}
        if self._bodies.fault:
            values["body_invalid_because"] = self._bodies.fault
        if self._computed:
            values["joints"] = "computed from the reported attitude"
        if self._choice != "encoders" or self._computed:
            values["north_bias_deg"] = f"{math.degrees(self.north.bias_rad):.3f}"
            values["north_sigma_deg"] = f"{math.degrees(math.sqrt(self.north.variance)):.3f}"
        return values

    def add_body(self, pose: BodyPose) -> list[CameraPose]:
        """Add a body pose and return the camera poses that became possible."""
        if not self._bodies.add(pose):
            return []
        self._check_joint_silence(pose.stamp_ns)
        return self._resolve()

    def add_autopilot(self, stamp_ns: int, q_nb: Array) -> list[CameraPose]:
        """Add the autopilot's attitude (4,), which the composition ``paper`` needs."""
        if self._choice == "encoders":
            return []
        if not usable_attitude(q_nb):
            self._counts["autopilot_invalid"] += 1
            return []
        self._autopilot.put(stamp_ns, q_nb)
        waits = self._waiting and isinstance(self._waiting[0], CameraAttitudeSample)
        return self._resolve() if waits else []

    def add_joints(self, sample: JointSample) -> list[CameraPose]:
        """Add joint angles; the yaw zero is subtracted from angles that an encoder measured."""
        angles = (sample.yaw_rad, sample.roll_rad, sample.pitch_rad)
        if joints_fault(angles):
            self._counts["invalid"] += 1
            return []
        if not sample.computed:
            sample = replace(sample, yaw_rad=sample.yaw_rad - self._yaw_zero_rad)
        self._computed = sample.computed
        self._counts["joints_computed"] += sample.computed
        if self._choice == "auto":
            if not sample.computed:
                self._joints.put(sample.stamp_ns, camera_turn(sample, self._mount.joint_order))
            if self._presence.add(sample.stamp_ns):
                self._switch(to_joints=True)
        return self._take(sample, in_use=self._by_joints)

    def add_attitude(self, sample: CameraAttitudeSample) -> list[CameraPose]:
        """Add the camera attitude that the flight controller reports."""
        if not usable_attitude(sample.q_ng):
            self._counts["invalid"] += 1
            return []
        self._check_joint_silence(sample.stamp_ns)
        return self._take(sample, in_use=not self._by_joints)

    def _check_joint_silence(self, stamp_ns: int) -> None:
        if self._choice == "auto" and self._presence.gone(stamp_ns):
            self._switch(to_joints=False)

    def _switch(self, *, to_joints: bool) -> None:
        """Switch to the other stream, from the newest stamp of the present stream onwards."""
        self._by_joints = to_joints
        self._counts["joints_steady" if to_joints else "joints_silent"] += 1
        self._handover_ns = self._newest_ns

    def _take(
        self, sample: JointSample | CameraAttitudeSample, *, in_use: bool
    ) -> list[CameraPose]:
        stamp_ns = sample.stamp_ns
        if self._handover_ns is not None and in_use:
            # The previous stream has given, or will give, the poses up to the handover.
            in_use = not 0 <= self._handover_ns - stamp_ns <= self._max_wait_ns
            self._handover_ns = None if in_use else self._handover_ns
        if not in_use:
            self._counts["unused"] += 1
            return []
        if stamp_ns == self._newest_ns:
            self._counts["repeated"] += 1
            return []
        if self._newest_ns is not None and stamp_ns < self._newest_ns:
            self._counts["went_back"] += 1
            self._waiting.clear()
        self._newest_ns = stamp_ns
        self._waiting.append(sample)
        return self._resolve()

    def _resolve(self) -> list[CameraPose]:
        poses = []
        while self._waiting:
            sample = self._waiting[0]
            composed = self._compose(sample)
            if isinstance(composed, CameraPose):
                poses.append(composed)
                why = "composed"
            else:
                why, miss = composed
                newest_ns = max(self._newest_ns or 0, self._bodies.newest_ns or 0, sample.stamp_ns)
                if miss in _MAY_COME and newest_ns - sample.stamp_ns <= self._max_wait_ns:
                    break
            self._counts[why] += 1
            self._read_north(self._waiting.popleft())
        return poses

    def _read_north(self, sample: JointSample | CameraAttitudeSample) -> None:
        if isinstance(sample, JointSample):
            # If the gimbal is centred, computed joints measure the bias: the heading cancels.
            use = sample.computed and self._centred
            body = self._bodies.at(sample.stamp_ns) if use else Miss.EMPTY
            if not isinstance(body, Miss):
                q_ng = quat_multiply(body.q_nb, camera_turn(sample))
                self._readings.read(self._north, sample.stamp_ns, q_ng, body.q_nb, None)
            return
        joints = self._joints.around(sample.stamp_ns)
        if isinstance(joints, Miss) and not self._centred:
            return
        autopilot = self._autopilot.around(sample.stamp_ns)
        if isinstance(autopilot, Miss):
            return
        q_bg = None if isinstance(joints, Miss) else slerp(*joints)
        self._readings.read(self._north, sample.stamp_ns, sample.q_ng, slerp(*autopilot), q_bg)

    def _compose(
        self, sample: JointSample | CameraAttitudeSample
    ) -> CameraPose | tuple[str, Miss | None]:
        """Return the camera's pose, or the reason as named in ``counts``, with its Miss if any."""
        body = self._bodies.at(sample.stamp_ns)
        if isinstance(body, Miss):
            return f"body_{body.value}", body
        if isinstance(sample, JointSample):
            if not sample.computed:
                return from_joints(self._mount, body, sample)
            self._north.advance(sample.stamp_ns)
            return from_computed(self._mount, body, sample, self.north)
        autopilot = self._autopilot.around(sample.stamp_ns)
        if isinstance(autopilot, Miss):
            return f"autopilot_{autopilot.value}", autopilot
        self._north.advance(sample.stamp_ns)
        pose = from_reported(self._mount, body, slerp(*autopilot), sample, self.north)
        return pose or ("no_heading", None)

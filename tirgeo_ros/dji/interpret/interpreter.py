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
"""Convert readings of the aircraft to the core's samples."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import numpy as np

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.frames.rotations import (
    canonical,
    heading_of,
    quat_conjugate,
    quat_multiply,
    rotation_of,
)
from tirgeo_ros.core.gimbal.camera_pose import joint_angles
from tirgeo_ros.core.gimbal.pose_buffer import Miss
from tirgeo_ros.core.navigation.ins.strapdown import matrix
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, JointSample, NavigationInput
from tirgeo_ros.dji.interpret.gnss_samples import NOT_SET, GpsInterpreter, RtkInterpreter
from tirgeo_ros.dji.interpret.imu_samples import AutopilotAttitudes, ImuInterpreter, Sequence
from tirgeo_ros.dji.sources.readings import (
    AttitudeReading,
    GimbalReading,
    GpsReading,
    ImuReading,
    Quaternion,
    Reading,
    RtkReading,
)

#: A gimbal reading waits at most this long for a later attitude: the longest gap between two.
_WAIT_NS = 250_000_000
_FOREVER_NS = 1 << 63
#: Stamps of two streams of one gimbal may overlap by this. A stamp that goes back further belongs
#: to another clock.
_CLOCK_NS = 1_000_000_000
#: Limit of an angle, which may have counted many turns.
_LARGEST_RAD = 1e3
#: Roll beyond 84 deg: an error of 0.001 in an angle becomes 0.01 in yaw.
_SINGULAR_COSINE = 0.1

GimbalSample = CameraAttitudeSample | JointSample


class GimbalInterpreter:
    """Convert gimbal readings to samples, using the body's attitude at each reading's instant.

    A reading waits at most 0.25 s for that attitude. Without it, the reading is published without
    joint angles; if yaw counts from the nose, the reading is dropped. Counted: ``gimbal_refused``
    (not finite, or too large for an angle), ``gimbal_out_of_order``, ``gimbal_without_joints``,
    ``gimbal_without_heading`` (dropped) and ``joints_near_singularity``.
    """

    def __init__(
        self, config: DjiConfig, attitudes: AutopilotAttitudes, counts: Counter[str]
    ) -> None:
        self._from_nose = config.gimbal_reference == "body"
        self.configure(config)
        self._attitudes, self._counts = attitudes, counts
        self.waiting: deque[GimbalReading] = deque()  # for an attitude
        self._newest_ns: int | None = None
        self._cameras, self._joints = Sequence(), Sequence()

    def configure(self, config: DjiConfig) -> None:
        """Take the delays, at the start or changed in flight."""
        self._delay_ns = round(config.delay.gimbal_s * 1e9)
        self._attitude_delay_ns = round(config.delay.imu_s * 1e9)

    def take(self, reading: GimbalReading) -> list[GimbalSample]:
        """Take a reading; if it is of another clock, return the samples of those before it."""
        if not all(abs(angle) < _LARGEST_RAD for angle in reading[1:]):
            self._counts["gimbal_refused"] += 1
            return []
        reading = reading._replace(stamp_ns=reading.stamp_ns - self._delay_ns)
        newest_ns, before = self._newest_ns, []
        if newest_ns is not None and reading.stamp_ns <= newest_ns:
            if newest_ns - reading.stamp_ns < _CLOCK_NS:
                self._counts["gimbal_out_of_order"] += 1
                return []
            before = self.flush()
        self._newest_ns = reading.stamp_ns
        self.waiting.append(reading)
        return before

    def resolve(self, now_ns: int) -> list[GimbalSample]:
        """Return the samples of the readings that need not wait longer for an attitude.

        ``now_ns``: the newest stamp of any reading, before its delay is subtracted.
        """
        now_ns -= self._attitude_delay_ns
        samples: list[GimbalSample] = []
        while self.waiting:
            stamp_ns = self.waiting[0].stamp_ns
            q_nb = self._attitudes.at(stamp_ns)
            waits = isinstance(q_nb, Miss) and q_nb in {Miss.EMPTY, Miss.TOO_NEW}
            if waits and now_ns - stamp_ns <= _WAIT_NS:
                break
            samples += self._samples(self.waiting.popleft(), q_nb)
        return samples

    def flush(self) -> list[GimbalSample]:
        """Return the samples of all waiting readings, at the end of the data."""
        return self.resolve(_FOREVER_NS)

    def _samples(self, reading: GimbalReading, q_nb: Array | Miss) -> list[GimbalSample]:
        stamp_ns, roll, pitch, yaw = reading
        if isinstance(q_nb, Miss):
            if self._from_nose:
                self._counts["gimbal_without_heading"] += 1
                return []
            self._counts["gimbal_without_joints"] += 1
            return [self._camera(stamp_ns, _camera_attitude(roll, pitch, yaw))]
        yaw += heading_of(q_nb) if self._from_nose else 0.0
        q_ng = _camera_attitude(roll, pitch, yaw)
        q_bg = quat_multiply(tuple(quat_conjugate(q_nb).tolist()), q_ng)
        joint_yaw, joint_roll, joint_pitch = joint_angles(matrix(rotation_of(q_bg))).tolist()
        if math.cos(joint_roll) < _SINGULAR_COSINE:
            self._counts["joints_near_singularity"] += 1
        angles = joint_yaw, joint_roll, joint_pitch
        joints = JointSample(self._joints.after(stamp_ns), *angles, computed=True)
        return [self._camera(stamp_ns, q_ng), joints]

    def _camera(self, stamp_ns: int, q_ng: Quaternion) -> CameraAttitudeSample:
        return CameraAttitudeSample(self._cameras.after(stamp_ns), canonical(np.array(q_ng)))


def _camera_attitude(roll_rad: float, pitch_rad: float, yaw_rad: float) -> Quaternion:
    """Return ``q_ng`` (wxyz) of yaw, then pitch, then roll (rad), by scalars for speed."""
    yaw = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
    pitch = (math.cos(pitch_rad / 2), 0.0, math.sin(pitch_rad / 2), 0.0)
    roll = (math.cos(roll_rad / 2), math.sin(roll_rad / 2), 0.0, 0.0)
    return quat_multiply(quat_multiply(yaw, pitch), roll)


Sample = NavigationInput | JointSample | CameraAttitudeSample


class Interpreter:
    """Convert readings to samples by the parameters; count all dropped readings.

    A sample's stamp is the reading's minus the ``delay`` of its kind. The stamps of a stream
    increase, unless the aircraft's clock goes back by a second or more: the filter judges that.
    """

    def __init__(self, config: DjiConfig) -> None:
        self._counts: Counter[str] = Counter()
        self._undulation_m = config.geoid_undulation_m
        self._one_antenna = not config.aircraft.second_antenna_m
        undulation_m = 0.0 if math.isnan(self._undulation_m) else self._undulation_m
        attitudes = AutopilotAttitudes(self._counts)
        self._imu = ImuInterpreter(config, attitudes, self._counts)
        self._rtk = RtkInterpreter(config, undulation_m, self._counts)
        self._gps = GpsInterpreter(config, undulation_m, self._counts)
        self._gimbal = GimbalInterpreter(config, attitudes, self._counts)
        self._takers: dict[type, Callable[[Any], list[Any]]] = {
            ImuReading: self._imu.take,
            AttitudeReading: self._imu.take_attitude,
            GpsReading: self._gps.take,
            RtkReading: self._rtk.take,
            GimbalReading: self._gimbal.take,
        }

    def configure(self, config: DjiConfig) -> None:
        """Take changed sigmas and delays in flight; no other parameter may change."""
        for part in (self._imu, self._rtk, self._gps, self._gimbal):
            part.configure(config)

    def take(self, reading: Reading) -> list[Sample]:
        """Return the samples of a reading, and of earlier ones that waited for it."""
        samples: list[Sample] = self._takers[type(reading)](reading)
        if self._gimbal.waiting:
            samples = [*samples, *self._gimbal.resolve(reading.stamp_ns)]
        return samples

    def flush(self) -> list[Sample]:
        """Return the samples of waiting readings, at the end of a recording."""
        return [*self._imu.flush(), *self._gimbal.flush()]

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of readings without a sample or with an unusual one."""
        return dict(sorted(self._counts.items()))

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return streams, units, flags and undulation that are in use, for people."""
        unset = math.isnan(self._undulation_m)
        return {
            **self._imu.diagnostics,
            **self._rtk.diagnostics,
            "geoid_undulation_m": "0 (not set)" if unset else f"{self._undulation_m:g}",
        }

    @property
    def warnings(self) -> list[str]:
        """Return the warnings about settings that a person should correct."""
        warnings = self._imu.warnings
        if self._one_antenna:
            warnings.append(NOT_SET)
        if math.isnan(self._undulation_m):
            warnings.append(
                "geoid_undulation_m is not set: heights above sea level are published as "
                "ellipsoidal, wrong by up to 100 m; set the geoid's height in the area of flight"
            )
        return [warning for warning in warnings if warning]

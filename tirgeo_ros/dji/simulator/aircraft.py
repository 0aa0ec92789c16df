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
"""Simulate the aircraft: convert samples of a flight to frames with their times."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.config import AircraftConfig, SimulatedAircraftConfig
from tirgeo_ros.core.frames.rotations import euler_from_quat, quat_multiply, slerp
from tirgeo_ros.core.gimbal.camera_pose import camera_turn
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.streams.sanity_checks import fault_of, usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    ImuSample,
    JointSample,
    NavigationInput,
    PressureSample,
    SetHeading,
)
from tirgeo_ros.dji.link.framing import encode_frame
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import Broadcast, Gimbal, encode_broadcast
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, Push, encode_push
from tirgeo_ros.dji.simulator.pushed_parts import PARTS, TOPICS, Instant, Receivers

#: Highest rate of a part. Beside packages, which contain the same data at up to 400 Hz, it is
#: lower: both would not fit into 921600 baud.
_HIGHEST_HZ, _BESIDE_PACKAGES_HZ = 400, 100
_BROADCAST, _PUSH = b"\x02\x00", b"\x02\x05"
#: The gimbal is interpolated between its samples, so a frame is made this long after its time.
_AHEAD_S = 0.25
_AHEAD_NS = round(_AHEAD_S * 1e9)
#: A sample of the IMU may be early by this much, or by half of its step, and still be due.
_EARLY_NS = 2_500_000
#: There is no interpolation between two IMU samples that are further apart than this.
_LONGEST_STEP_NS = 100_000_000
#: A stamp that goes back by more belongs to another flight: the aircraft is switched on again.
_RESTART_NS = 1_000_000_000
_SECOND_NS = 1_000_000_000

Sample = NavigationInput | JointSample | CameraAttitudeSample


class SimulatedGimbalAngles:
    """Interpolate the recorded gimbal attitudes, without extrapolation.

    By joints, the camera's attitude is computed from the aircraft's attitude and the encoders'
    angles, which the protocol cannot contain. Otherwise, or without encoder angles, it is the
    recorded attitude.
    """

    def __init__(self, config: SimulatedAircraftConfig) -> None:
        self._by_joints, self._order = config.gimbal == "joints", config.joint_order
        self._joints: StampedBuffer[Array] = StampedBuffer(max_gap_s=_AHEAD_S)  # q_bg
        self._reported: StampedBuffer[Array] = StampedBuffer(max_gap_s=_AHEAD_S)  # q_ng

    def take(self, sample: JointSample | CameraAttitudeSample) -> bool:
        """Take a sample, which may be later than the frames; return whether it is valid."""
        if isinstance(sample, CameraAttitudeSample):
            is_valid = usable_attitude(sample.q_ng)
            if is_valid:
                self._reported.put(sample.stamp_ns, sample.q_ng)
            return is_valid
        is_valid = math.isfinite(sample.yaw_rad + sample.roll_rad + sample.pitch_rad)
        if is_valid:
            self._joints.put(sample.stamp_ns, camera_turn(sample, self._order))
        return is_valid

    def at(self, stamp_ns: int, q_nb: Array | None) -> Gimbal | None:
        """Return the camera's angles at an instant, None if they are not known.

        ``q_nb`` (4,) is the aircraft's own attitude, None if it is not known.
        """
        joints = self._joints.around(stamp_ns)
        reported = self._reported.around(stamp_ns)
        if self._by_joints and q_nb is not None and not isinstance(joints, Miss):
            q_ng = quat_multiply(q_nb, slerp(*joints))
        elif not isinstance(reported, Miss):
            q_ng = slerp(*reported)
        else:
            return None
        return Gimbal(*np.degrees(euler_from_quat(q_ng)).tolist())


class Outgoing(NamedTuple):
    """Hold a frame and the time when it leaves the aircraft, in the samples' arrival time."""

    time_ns: int
    data: bytes


class Aircraft:
    """Send a recorded flight as an A3 or M600 would.

    Samples are taken in the order of their arrival. Each IMU sample gives a broadcast with the
    parts that are due, which repeats the receivers' data until there is new data. Packages are
    pushed at their own rates, with inertial values interpolated between two samples. Frames have
    their true times, but are returned a quarter of a second of the flight after their samples.
    """

    def __init__(self, config: SimulatedAircraftConfig, places: AircraftConfig) -> None:
        """Take the settings, and ``places``, the antennas' positions."""
        self._config, self._places = config, places
        self._packages = USUAL_PACKAGES if self._config.pushes else ()
        #: ``broadcasts``, ``pushes``; dropped: ``invalid``, ``imu_not_later``
        self.counts: Counter[str] = Counter()
        self._waiting: deque[tuple[int, NavigationInput]] = deque()
        self._sequence = 0
        self._switch_on()

    def _switch_on(self) -> None:
        self._receivers = Receivers(self._config, self._places)
        self._gimbal = SimulatedGimbalAngles(self._config)
        self._first_ns = 0  # stamp of the first sample of the IMU
        self._imu: ImuSample | None = None  # the newest sample that was sent
        self._sent_ns = 0
        self._slots: dict[str, int] = {}  # part -> period in which it was last sent

    def take(self, arrival_ns: int, sample: Sample) -> list[Outgoing]:
        """Take a sample; return the frames that are ready, in the order of their times."""
        if isinstance(sample, JointSample | CameraAttitudeSample):
            if not self._gimbal.take(sample):
                self.counts["invalid"] += 1
        # a receiver without a solution may send any position
        elif getattr(sample, "status", None) is FixStatus.NONE or not fault_of(sample):
            self._waiting.append((arrival_ns, sample))
        else:
            self.counts["invalid"] += 1
        return self._until(arrival_ns - _AHEAD_NS)

    def flush(self) -> list[Outgoing]:
        """Return the frames that wait for later samples; for the end of a flight."""
        return self._until(self._waiting[-1][0]) if self._waiting else []

    def _until(self, arrival_ns: int) -> list[Outgoing]:
        frames: list[Outgoing] = []
        while self._waiting and self._waiting[0][0] <= arrival_ns:
            together_ns = self._waiting[0][0]
            imu = []
            while self._waiting and self._waiting[0][0] == together_ns:
                _, sample = self._waiting.popleft()
                if isinstance(sample, ImuSample):
                    imu.append(sample)
                elif not isinstance(sample, PressureSample | SetHeading):  # DJI sends none
                    self._receivers.take(sample)
            for sample in imu:
                frames += self._frames(sample, together_ns)
        return frames

    def _frames(self, imu: ImuSample, arrival_ns: int) -> list[Outgoing]:
        """Return the frames of one IMU sample and of the interval before it."""
        if self._imu is not None and imu.stamp_ns <= self._imu.stamp_ns:
            if self._imu.stamp_ns - imu.stamp_ns < _RESTART_NS:
                self.counts["imu_not_later"] += 1
                return []
            self._switch_on()
        if self._imu is None:
            self._first_ns = imu.stamp_ns
        frames = self._pushes(imu, arrival_ns - imu.stamp_ns) + self._broadcast(imu, arrival_ns)
        self._imu = imu
        outgoing = []
        for time_ns, data in frames:
            self._sent_ns = max(self._sent_ns, time_ns)  # the link keeps the order
            outgoing.append(Outgoing(self._sent_ns, data))
        return outgoing

    def _broadcast(self, imu: ImuSample, arrival_ns: int) -> list[Outgoing]:
        """Return the broadcast with the parts that are due."""
        instant = self._instant(imu)
        step_ns = imu.stamp_ns - (self._imu.stamp_ns if self._imu else self._first_ns)
        since_ns = imu.stamp_ns - self._first_ns + min(_EARLY_NS, step_ns // 2)
        highest_hz = _BESIDE_PACKAGES_HZ if self._packages else _HIGHEST_HZ
        due = {}
        for name, (rate_hz, make) in PARTS.items():
            slot = since_ns * min(rate_hz, highest_hz) // _SECOND_NS
            if self._slots.get(name) != slot:
                self._slots[name] = slot
                due[name] = make(instant)
        broadcast = Broadcast(**due)
        if not broadcast.mask:
            return []
        self.counts["broadcasts"] += 1
        return [Outgoing(arrival_ns, self._framed(_BROADCAST + encode_broadcast(broadcast)))]

    def _pushes(self, imu: ImuSample, latency_ns: int) -> list[Outgoing]:
        """Return the pushes due between two IMU samples, if all topics of a package have data."""
        before = self._imu
        start_ns = imu.stamp_ns - 1 if before is None else before.stamp_ns
        if imu.stamp_ns - start_ns > _LONGEST_STEP_NS:
            start_ns = imu.stamp_ns - 1
        due = sorted(
            (stamp_ns, package)
            for package in self._packages
            for stamp_ns in _grid(self._first_ns, start_ns, imu.stamp_ns, package.rate_hz)
        )
        frames = []
        for stamp_ns, package in due:
            at = imu if before is None else _between(before, imu, stamp_ns)
            instant = self._instant(at)
            values = {topic.name: TOPICS[topic.name](instant) for topic in package.topics}
            if None not in values.values():
                data = _PUSH + encode_push(Push(package, *instant.counters[:2], values))
                frames.append(Outgoing(stamp_ns + latency_ns, self._framed(data)))
        self.counts["pushes"] += len(frames)
        return frames

    def _instant(self, imu: ImuSample) -> Instant:
        since_ns = imu.stamp_ns - self._first_ns
        since_ns += round(since_ns * self._config.clock_drift_ppm * 1e-6)
        if not usable_attitude(imu.autopilot_q_nb):
            imu = ImuSample(imu.stamp_ns, imu.specific_force_b, imu.angular_rate_b)
        time_ns = since_ns + self._config.clock_start_ms * 1_000_000
        gimbal = self._gimbal.at(imu.stamp_ns, imu.autopilot_q_nb)
        return Instant(time_ns, since_ns, imu, gimbal, self._receivers)

    def _framed(self, data: bytes) -> bytes:
        self._sequence = (self._sequence + 1) & 0xFFFF
        return encode_frame(data, sequence=self._sequence)


def frames_of(aircraft: Aircraft, samples: Iterable[tuple[int, Sample]]) -> Iterator[Outgoing]:
    """Yield all frames of a flight from its samples, each with its arrival time."""
    for arrival_ns, sample in samples:
        yield from aircraft.take(arrival_ns, sample)
    yield from aircraft.flush()


def _grid(first_ns: int, after_ns: int, until_ns: int, rate_hz: int) -> Iterator[int]:
    """Yield the times of a rate, counted from ``first_ns``, that lie in (after, until]."""
    number = (after_ns - first_ns) * rate_hz // _SECOND_NS
    while (stamp_ns := first_ns + -(-number * _SECOND_NS // rate_hz)) <= until_ns:
        if stamp_ns > after_ns:
            yield stamp_ns
        number += 1


def _between(before: ImuSample, after: ImuSample, stamp_ns: int) -> ImuSample:
    """Interpolate the inertial values linearly between two samples."""
    if stamp_ns == after.stamp_ns:
        return after
    fraction = (stamp_ns - before.stamp_ns) / (after.stamp_ns - before.stamp_ns)
    q, p = before.autopilot_q_nb, after.autopilot_q_nb
    return ImuSample(
        stamp_ns,
        before.specific_force_b + fraction * (after.specific_force_b - before.specific_force_b),
        before.angular_rate_b + fraction * (after.angular_rate_b - before.angular_rate_b),
        None if q is None or p is None else slerp(q, p, fraction),
    )

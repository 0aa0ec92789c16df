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
"""Convert the topics that a person names, of any bag, to the topics of the contract."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.rotations import (
    flu_from_frd,
    matrix_from_quat,
    quat_conjugate,
    quat_from_matrix,
    quat_multiply,
)
from tirgeo_ros.core.navigation.timeline.imu_checks import in_body_axes
from tirgeo_ros.core.streams.sanity_checks import fault_of, usable_attitude
from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample, Source, VelocitySample
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.bags.ros1_bag import Ros1Bag, any_bag
from tirgeo_ros.io.messages import SENSED_SAMPLES, TOPIC_TYPES, SensedSample, stamp_ns
from tirgeo_ros.io.messages.cdr import header_stamp_ns
from tirgeo_ros.io.messages.topics import CAMERA_INFO, PICTURES, resolved
from tirgeo_ros.tools.convert.import_sink import ImportSink, TopicCount
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.presentation.results import listed

#: Topic of the contract -> words: a bag's topic with a fitting type and one of them is suggested.
_SUGGESTED: Mapping[str, tuple[str, ...]] = {
    "imu/data": ("",),
    "rtk/fix": ("rtk",),
    "rtk/vel": ("rtk",),
    "rtk/heading": ("heading",),
    "gps/fix": ("",),
    "gps/vel": ("gps", "gnss", "fix"),
    "baro/pressure": ("",),
    "gimbal/joint_states": ("gimbal", "mount"),
    "gimbal/attitude": ("gimbal", "mount"),
    **dict.fromkeys((*PICTURES, CAMERA_INFO), ("",)),
}

#: Returns the sample of a message that was recorded at a time (ns).
Converter = Callable[[Any, int], SensedSample]
_NED_ENU = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
#: Type -> what a person should know of the way in which its messages are read.
_REMARKS = {
    "geometry_msgs/msg/TwistStamped": "it has no covariance, and is taken as east, north, up",
    "nav_msgs/msg/Odometry": (
        "its velocity is rotated by its orientation, whose frame is taken as east, north, up: "
        "do not map wheel odometry, which begins with heading 0"
    ),
    "std_msgs/msg/Float64": (
        "degrees, clockwise from north, stamped when recorded; do not map an autopilot's compass, "
        "which is no heading of two antennas"
    ),
}
#: Gravity is the mean force for so long at the start: an aircraft stands or flies steadily then.
_GRAVITY_NS = 2_000_000_000
_LEAST_SAMPLES, _MOST_SAMPLES = 20, 2000
#: No aircraft stands or flies steadily so steep; wrong axes turn gravity by 90 deg.
_STEEP_RAD = math.radians(45)
_FIX = "sensor_msgs/msg/NavSatFix"
#: The lowest status of NavSatFix with which rtk/fix is used.
_LEAST_RTK = 1


def _twist(source: Source, msg: Any, _: int) -> VelocitySample:
    """Convert ``geometry_msgs/TwistStamped``, ENU; its covariance is unknown."""
    linear = msg.twist.linear
    velocity_n = np.array([linear.y, linear.x, -linear.z])
    return VelocitySample(stamp_ns(msg), source, velocity_n, np.zeros((3, 3)))


def _odometry(source: Source, msg: Any, _: int) -> VelocitySample:
    """Convert ``nav_msgs/Odometry``: its twist is in the body's axes, its pose in ENU."""
    q, linear = msg.pose.pose.orientation, msg.twist.twist.linear
    attitude = np.array([q.w, q.x, q.y, q.z])
    if not usable_attitude(attitude):
        raise MessageError("its orientation is not a unit quaternion")
    turn = _NED_ENU @ matrix_from_quat(attitude)
    velocity_n = turn @ np.array([linear.x, linear.y, linear.z])
    covariance = np.reshape(msg.twist.covariance, (6, 6))[:3, :3]
    return VelocitySample(stamp_ns(msg), source, velocity_n, turn @ covariance @ turn.T)


def _compass(msg: Any, log_time_ns: int) -> HeadingSample:
    """Convert ``std_msgs/Float64``: degrees, clockwise from north, without a time of its own."""
    return HeadingSample(log_time_ns, math.radians(float(msg.data) % 360.0), 0.0)


#: Topic -> other type than its own that fits -> converter of its messages.
CONVERTERS: Mapping[str, Mapping[str, Converter]] = {
    **{
        source.topic: {
            "geometry_msgs/msg/TwistStamped": partial(_twist, source),
            "nav_msgs/msg/Odometry": partial(_odometry, source),
        }
        for source in (Source.RTK_VELOCITY, Source.GPS_VELOCITY)
    },
    Source.RTK_HEADING.topic: {"std_msgs/msg/Float64": _compass},
}


def types_of(topic: str) -> tuple[str, ...]:
    """Return the types that fit a topic of the contract, its own first."""
    return TOPIC_TYPES[topic], *CONVERTERS.get(topic, ())


def asked_topics(
    pairs: Iterable[tuple[str, str]], there: Mapping[str, str], where: str
) -> dict[str, list[str]]:
    """Return the bag's topic -> topics of the contract, for pairs (topic, topic of the contract).

    ``there`` has the bag's topics with their types. Raise BagError for a topic that is absent or
    does not fit, and for two topics mapped to one.
    """
    by_name = {name.strip("/"): name for name in there}
    mapped: dict[str, list[str]] = {}
    for asked, topic in pairs:
        name, types = by_name.get(asked.strip("/")), types_of(topic)
        if name is None or there[name] not in types:
            kind = "not in the bag" if name is None else f"of type {there[name]}"
            fitting = ", ".join(own for own, typename in there.items() if typename in types)
            raise BagError(
                f"{where}: {asked} is {kind}; {topic} takes {' or '.join(types)}, "
                f"the type of {fitting or 'no topic of the bag'}"
            )
        if any(topic in topics for topics in mapped.values()):
            raise BagError(f"{where}: two topics for {topic}: give one")
        mapped.setdefault(name, []).append(topic)
    return mapped


def suggested(there: Mapping[str, str]) -> str:
    """Return options that map a bag's topics, as types and names suggest; "" without any.

    A topic of the contract gets the bag's topic with its name, or the first of a fitting type.
    """
    left, options = dict(there), []
    for topic, words in _SUGGESTED.items():
        named = {name: kind for name, kind in left.items() if any(w in name for w in words)}
        fitting = [name for name, kind in named.items() if kind in types_of(topic)]
        best = min(fitting, key=lambda name: (not name.endswith(topic), name), default=None)
        if best is not None:
            options.append(f"--map-topic {best}={topic}")
            del left[best]
    return " ".join(options)


class ImuMounting:
    """Rotate an IMU's samples to ``base_link``, and check where gravity is at the beginning.

    ``rpy_deg`` turns the IMU's axes as ``aircraft.imu_rpy_deg`` does: roll, pitch, yaw about
    forward, left, up. ``aircraft`` has the flight's parameters of the aircraft.
    """

    def __init__(self, rpy_deg: tuple[float, ...], aircraft: AircraftConfig) -> None:
        self._rotation_bi = AircraftConfig(imu_rpy_deg=rpy_deg).rotation_bi
        self._later_bi = aircraft.rotation_bi
        self._begun_ns = 0
        self._forces_i: list[Array] = []

    def turned(self, sample: ImuSample) -> ImuSample:
        """Return the sample in the axes of ``base_link``, its attitude included.

        The attitude of ``sensor_msgs/Imu`` is that of the IMU.
        """
        self._begun_ns = self._begun_ns or sample.stamp_ns
        early = sample.stamp_ns - self._begun_ns <= _GRAVITY_NS
        if early and len(self._forces_i) < _MOST_SAMPLES and not fault_of(sample):
            self._forces_i.append(sample.specific_force_b)
        if self._rotation_bi is None:
            return sample
        sample = in_body_axes(sample, self._rotation_bi)
        if sample.autopilot_q_nb is None:
            return sample
        q_ib = quat_conjugate(quat_from_matrix(self._rotation_bi))
        return replace(sample, autopilot_q_nb=quat_multiply(sample.autopilot_q_nb, q_ib))

    @property
    def doubt(self) -> str:
        """Return a line that says where gravity is if not on +z, else an empty string."""
        if len(self._forces_i) < _LEAST_SAMPLES:
            return ""
        force_i = force_b = np.mean(self._forces_i, axis=0)
        for rotation in (self._rotation_bi, self._later_bi):
            force_b = force_b if rotation is None else rotation @ force_b
        size = float(np.linalg.norm(force_b))
        if size == 0 or -force_b[2] > size * math.cos(_STEEP_RAD):
            return ""
        place = flu_from_frd(force_b)
        axis = int(np.abs(place).argmax())
        up = flu_from_frd(force_i)
        roll = round(math.degrees(math.atan2(up[1], up[2])))
        pitch = round(math.degrees(math.atan2(-up[0], math.hypot(up[1], up[2]))))
        return (
            f"imu/data: gravity is on {'+' if place[axis] > 0 else '-'}{'xyz'[axis]} at the "
            "beginning, not on +z: the IMU's axes are not those of base_link: give --imu-rpy "
            f"{roll} {pitch} YAW (gravity does not show YAW)"
        )


class MappedTopics(NamedTuple):
    """Hold the options of ``--map-topic`` for a bag."""

    pairs: tuple[tuple[str, str], ...] = ()  # (its topic, topic of the contract)
    imu_rpy_deg: tuple[float, ...] = (0.0, 0.0, 0.0)  # of the IMU's axes against base_link
    undulation_m: float | None = None  # to add to altitudes: they are above mean sea level


@dataclass
class _Stream(TopicCount):
    """Count a topic's messages, with their lags and fixes."""

    without_stamp: int = 0
    lags_ns: array[int] = field(default_factory=partial(array, "q"))  # stamp to log time
    best_status: int | None = None  # of NavSatFix

    @property
    def lag_s(self) -> float:
        """Return the median time from stamp to log time."""
        return median(self.lags_ns) * 1e-9 if self.lags_ns else 0.0

    def stamped(self, stamp_ns: int, log_time_ns: int) -> None:
        """Take a message's stamp."""
        if stamp_ns:
            self.lags_ns.append(log_time_ns - stamp_ns)
        else:
            self.without_stamp += 1

    def result(self) -> dict[str, object]:
        """Return the row of the summary."""
        return super().result() | {"because": self.reason or None, "lag_s": self.lag_s}

    def notes(self, undulation_m: float | None) -> Iterator[str]:
        """Yield how messages are read where they leave it open."""
        if remark := _REMARKS.get(self.typename):
            yield f"{self.topic}: {remark}"
        if self.without_stamp:
            yield f"{self.topic}: {self.without_stamp} messages have no stamp: taken at log time"
        if self.best_status is not None and undulation_m is None:
            yield (
                f"{self.topic}: altitudes are taken as above the ellipsoid, as the message is "
                "defined; if they are above the sea, give --geoid-undulation M"
            )

    def warnings(self) -> Iterator[str]:
        """Yield a line for each fault of the topic."""
        if self.complaint:
            yield self.complaint
        if not self.messages:
            yield f"{self.topic}: no message"
        if jumps := lone_stamps(self.lags_ns).sum():
            yield f"{self.topic}: {jumps} stamps are outliers: the filter leaves them out"
        best = _LEAST_RTK if self.best_status is None else self.best_status
        if self.feeds[0] == Source.RTK_POSITION.topic and best < _LEAST_RTK:
            yield (
                f"{self.topic}: no message has status 1 (float) or 2 (fixed), which rtk/fix "
                "needs: map it to gps/fix"
            )


class _Import:
    """Convert a bag's messages and pass them to a sink."""

    def __init__(
        self,
        bag: BagReader | Ros1Bag,
        sink: ImportSink,
        mapped: MappedTopics,
        aircraft: AircraftConfig,
    ) -> None:
        types = bag.topics()
        names = asked_topics(mapped.pairs, types, str(bag.path))
        self.by_topic = {
            topic: [_Stream(topic, types[topic], (contract,)) for contract in contracts]
            for topic, contracts in names.items()
        }
        self.streams = [stream for streams in self.by_topic.values() for stream in streams]
        self.mounting = ImuMounting(mapped.imu_rpy_deg, aircraft)
        self._bag, self._sink, self._undulation_m = bag, sink, mapped.undulation_m
        self._cdr = Cdr()

    def run(self, progress: Report) -> None:
        """Read the whole bag."""
        begun_ns, ended_ns = self._bag.span_ns
        for message in self._bag.messages(set(self.by_topic)):
            progress((message.log_time_ns - begun_ns) * 1e-9, (ended_ns - begun_ns) * 1e-9)
            for stream in self.by_topic[message.topic]:
                stream.messages += 1
                try:
                    self._pass(message, stream)
                except MessageError as error:
                    stream.refuse(error)

    def _pass(self, message: BagMessage, stream: _Stream) -> None:
        """Write a message to its topic of the contract. Raise MessageError."""
        data, log_time_ns, (contract,) = self._bag.cdr(message), message.log_time_ns, stream.feeds
        convert = CONVERTERS.get(contract, {}).get(stream.typename)
        if convert is None and contract not in SENSED_SAMPLES:  # a picture
            stream.stamped(header_stamp_ns(data), log_time_ns)
            self._sink.pass_on(log_time_ns, contract, data)
            return
        decoded = self._cdr.deserialize(data, stream.typename, stream.topic)
        own = None
        if convert is not None:
            sample = convert(decoded, log_time_ns)
        else:
            sample = own = SENSED_SAMPLES[contract](decoded)
        if isinstance(sample, ImuSample):
            sample = self.mounting.turned(sample)
        stream.stamped(sample.stamp_ns, log_time_ns)
        if stream.typename == _FIX:
            stream.best_status = max(decoded.status.status, stream.best_status or -1)
            if self._undulation_m is not None:
                decoded.altitude += self._undulation_m
                data = decoded
        if sample is own:  # not converted
            self._sink.pass_on(log_time_ns, contract, data)
        else:
            self._sink.write(sample, log_time_ns)

    def warnings(self) -> Iterator[str]:
        """Yield a line for each fault."""
        for stream in self.streams:
            yield from stream.warnings()
        far = [f"{s.topic} {-s.lag_s:+.1f} s" for s in self.streams if abs(s.lag_s) > 1.0]
        if far:
            yield (
                f"stamps are far from the times of recording ({', '.join(far)}) and are kept: "
                "topics with different numbers have different clocks"
            )
        if self.mounting.doubt:
            yield self.mounting.doubt


def import_mapped(
    path: Path,
    sink: ImportSink,
    mapped: MappedTopics,
    aircraft: AircraftConfig,
    progress: Report,
) -> dict[str, Any]:
    """Import the topics of ``mapped``; return what to report of them. Raise BagError."""
    bag = any_bag(path)
    run = _Import(bag, sink, mapped, aircraft)
    run.run(progress)
    warnings = list(run.warnings())
    if all(stream.messages == stream.refused for stream in run.streams):
        raise BagError(f"{path}: nothing to import: {'; '.join(warnings)}")
    return {
        "kind": "mapped",
        "topics": [stream.result() for stream in run.streams],
        "not_read": {t: kind for t, kind in bag.topics().items() if t not in run.by_topic},
        "notes": [line for stream in run.streams for line in stream.notes(mapped.undulation_m)],
        "warnings": warnings,
        "error": None if bag.damage is None else f"{path}: {bag.damage}",
    }


def what_can_be_mapped(path: Path, namespace: str) -> str:
    """Return what to do with a bag without --map-topic: the options, or why there are none.

    Raise BagError if it cannot be read.
    """
    topics = any_bag(path).topics()
    if topics.get(resolved(Source.IMU.topic, namespace)) == TOPIC_TYPES[Source.IMU.topic]:
        return "it needs no import: give it to tirgeo process"
    options = suggested(topics)
    if options:
        return f"name its topics, for example {options}"
    named = [f"{topic} ({kind})" for topic, kind in topics.items()]
    return f"nothing to import: no topic has a type that tirgeo takes; it has {listed(named)}"

"""Convert the topics that a person names, of any bag, to the topics of the contract."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.rotations import quat_conjugate, quat_from_matrix, quat_multiply
from tirgeo_ros.core.navigation.timeline.imu_checks import in_body_axes
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.streams.stamps import lone_stamps
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import BagError, MessageError
from tirgeo_ros.core.types.measurements import ImuSample, Source
from tirgeo_ros.io.bags.bag import BagMessage, BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.io.bags.ros1_bag import Ros1Bag, Ros1Message, any_bag
from tirgeo_ros.io.messages import SENSED_SAMPLES, TOPIC_TYPES
from tirgeo_ros.tools.convert.import_sink import ImportSink
from tirgeo_ros.tools.convert.topic_types import (
    CONVERTERS,
    asked_topics,
    remark_on,
    suggested,
)
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.flight_topics import resolved

#: Gravity is seen in the mean of the first seconds: an aircraft begins at rest, or flies steadily.
_SEEN_NS = 2_000_000_000
_LEAST_SAMPLES, _MOST_SAMPLES = 20, 2000
#: No aircraft stands or flies steadily as steep; wrong axes turn it by 90 deg.
_STEEP_RAD = math.radians(45)


class ImuMounting:
    """Turn an IMU's samples to ``base_link``, and watch where gravity is at the beginning.

    ``rpy_deg`` turns the IMU's axes as ``aircraft.imu_rpy_deg`` does: roll, pitch, yaw about
    forward, left, up. ``aircraft`` is what the flight's parameters say of the aircraft.
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
        self._watch(sample)
        if self._rotation_bi is None:
            return sample
        sample = in_body_axes(sample, self._rotation_bi)
        if sample.autopilot_q_nb is None:
            return sample
        q_ib = quat_conjugate(quat_from_matrix(self._rotation_bi))
        return replace(sample, autopilot_q_nb=quat_multiply(sample.autopilot_q_nb, q_ib))

    def _watch(self, sample: ImuSample) -> None:
        self._begun_ns = self._begun_ns or sample.stamp_ns
        early = sample.stamp_ns - self._begun_ns <= _SEEN_NS
        if early and len(self._forces_i) < _MOST_SAMPLES and not fault_of(sample):
            self._forces_i.append(sample.specific_force_b)

    @property
    def doubt(self) -> str:
        """Return in one line where gravity is, if it is not on +z; else an empty string."""
        if len(self._forces_i) < _LEAST_SAMPLES:
            return ""
        force_i = force_b = np.mean(self._forces_i, axis=0)
        for rotation in (self._rotation_bi, self._later_bi):
            force_b = force_b if rotation is None else rotation @ force_b
        size = float(np.linalg.norm(force_b))
        if size == 0 or -force_b[2] > size * math.cos(_STEEP_RAD):
            return ""
        x, y, z = (flu_from_frd(force_b) + 0.0).tolist()  # no -0
        axis = max(zip(map(abs, (x, y, z)), "xyz", (x, y, z), strict=True))
        up = flu_from_frd(force_i) / size
        roll = round(math.degrees(math.atan2(up[1], up[2])))
        pitch = round(math.degrees(math.atan2(-up[0], math.hypot(up[1], up[2]))))
        return (
            f"imu/data: gravity is on {'+' if axis[2] > 0 else '-'}{axis[1]} at the beginning, "
            f"({x:+.1f}, {y:+.1f}, {z:+.1f}) m/s2, not on +z: the IMU's axes are not those of "
            f"base_link: give --imu-rpy {roll} {pitch} YAW (gravity does not show YAW)"
        )


_FIX = "sensor_msgs/msg/NavSatFix"
#: Stamps further from the times of recording belong to another clock.
_FAR_S = 1.0
#: Status of NavSatFix from which on rtk/fix is used.
_LEAST_RTK = 1
_MOST_NAMED = 5


class MappedTopics(NamedTuple):
    """Hold what a person says of a bag."""

    pairs: tuple[tuple[str, str], ...] = ()  # (its topic, topic of the contract)
    imu_rpy_deg: tuple[float, ...] = (0.0, 0.0, 0.0)  # of the IMU's axes against base_link
    undulation_m: float | None = None  # to add to altitudes: they are above mean sea level


@dataclass
class _Stream:
    """Count the messages of a topic that become those of one of the contract."""

    topic: str
    typename: str
    contract: str
    messages: int = 0
    refused: int = 0
    reason: str = ""  # of the first refused message
    without_stamp: int = 0
    lags_ns: array[int] = field(default_factory=partial(array, "q"))  # stamp to log time
    statuses: Counter[tuple[int, int]] = field(default_factory=Counter)  # status, covariance type

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

    def refuse(self, reason: str) -> None:
        """Count a message that cannot be used."""
        self.refused += 1
        self.reason = self.reason or reason

    def result(self) -> dict[str, object]:
        """Return the row of the summary."""
        return {
            "topic": self.topic,
            "type": self.typename,
            "messages": self.messages,
            "refused": self.refused,
            "because": self.reason or None,
            "to": [self.contract],
            "lag_s": self.lag_s,
        }

    def notes(self, undulation_m: float | None) -> Iterator[str]:
        """Yield what the messages leave open, and how they are taken."""
        remark = remark_on(self.typename)
        if remark:
            yield f"{self.topic}: {remark}"
        if self.without_stamp:
            yield f"{self.topic}: {self.without_stamp} messages have no stamp: taken at log time"
        if self.typename == _FIX and self.statuses:
            counts = ", ".join(
                f"{number} of status {status} and covariance type {kind}"
                for (status, kind), number in sorted(self.statuses.items())
            )
            height = (
                "altitudes are taken as above the ellipsoid, as the message is defined (above the "
                "sea: --geoid-undulation M)"
                if undulation_m is None
                else f"{undulation_m:g} m are added to altitudes"
            )
            yield f"{self.topic}: {counts}; {height}"

    def warnings(self) -> Iterator[str]:
        """Yield what is wrong."""
        if self.refused:
            yield f"{self.topic}: {self.refused} of {self.messages} refused ({self.reason})"
        if not self.messages:
            yield f"{self.topic}: no message"
        if jumps := lone_stamps(self.lags_ns).sum():
            yield f"{self.topic}: {jumps} stamps jump alone: the filter leaves them out"
        best = max((status for status, _ in self.statuses), default=_LEAST_RTK)
        if self.contract == Source.RTK_POSITION.topic and best < _LEAST_RTK:
            yield (
                f"{self.topic}: no message has status 1 (float) or 2 (fixed), from which on "
                "rtk/fix is used: map it to gps/fix"
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
        self.streams = {
            topic: [_Stream(topic, types[topic], contract) for contract in contracts]
            for topic, contracts in names.items()
        }
        self.mounting = ImuMounting(mapped.imu_rpy_deg, aircraft)
        self._bag, self._sink, self._undulation_m = bag, sink, mapped.undulation_m
        self._cdr = Cdr()

    def run(self, progress: Report) -> None:
        """Read the whole bag."""
        begun_ns, ended_ns = self._bag.span_ns
        for message in self._bag.messages(set(self.streams)):
            progress((message.log_time_ns - begun_ns) * 1e-9, (ended_ns - begun_ns) * 1e-9)
            for stream in self.streams[message.topic]:
                stream.messages += 1
                try:
                    self._pass(message, stream)
                except MessageError as error:
                    stream.refuse(str(error).removeprefix(f"{message.topic}: "))

    def _pass(self, message: BagMessage | Ros1Message, stream: _Stream) -> None:
        """Write a message to its topic of the contract. Raise MessageError."""
        data, log_time_ns = self._bag.cdr(message), message.log_time_ns
        convert = CONVERTERS.get(stream.contract, {}).get(stream.typename)
        if convert is None and stream.contract not in SENSED_SAMPLES:  # a picture
            stream.stamped(header_stamp_ns(data), log_time_ns)
            self._sink.pass_on(log_time_ns, stream.contract, data)
            return
        decoded = self._cdr.deserialize(data, stream.typename, stream.topic)
        if convert is not None:
            sample = convert(decoded, log_time_ns)
            stream.stamped(sample.stamp_ns, log_time_ns)
            self._sink.write(sample, log_time_ns)
            return
        sample = SENSED_SAMPLES[stream.contract](decoded)
        stream.stamped(sample.stamp_ns, log_time_ns)
        if isinstance(sample, ImuSample):
            turned = self.mounting.turned(sample)
            if turned is not sample:
                self._sink.write(turned, log_time_ns)
                return
        elif stream.typename == _FIX:
            data = self._fix(decoded, data, stream)
        self._sink.pass_on(log_time_ns, stream.contract, data)

    def _fix(self, message: Any, data: bytes, stream: _Stream) -> Any:
        """Count a fix; return it with another altitude, or its data where that is ellipsoidal."""
        stream.statuses[int(message.status.status), int(message.position_covariance_type)] += 1
        if self._undulation_m is None:
            return data
        message.altitude += self._undulation_m
        return message

    def far_stamps(self) -> str:
        """Return in one line which topics are stamped far from their times of recording."""
        found = [one for streams in self.streams.values() for one in streams]
        far = [f"{one.topic} {-one.lag_s:+.1f} s" for one in found if abs(one.lag_s) > _FAR_S]
        if not far:
            return ""
        return (
            f"stamps are far from the times of recording ({', '.join(far)}) and are kept: topics "
            "whose numbers differ have different clocks"
        )


def import_mapped(
    path: Path,
    sink: ImportSink,
    mapped: MappedTopics,
    aircraft: AircraftConfig,
    progress: Report,
) -> dict[str, object]:
    """Import the topics that are named; return what to report of them. Raise BagError."""
    bag = any_bag(path)
    run = _Import(bag, sink, mapped, aircraft)
    run.run(progress)
    streams = [one for streams in run.streams.values() for one in streams]
    warnings = [line for one in streams for line in one.warnings()]
    if all(one.messages == one.refused for one in streams):
        raise BagError(f"{path}: nothing to import: {'; '.join(warnings)}")
    warnings += filter(None, (run.far_stamps(), run.mounting.doubt))
    return {
        "kind": "mapped",
        "topics": [one.result() for one in streams],
        "not_read": {t: kind for t, kind in bag.topics().items() if t not in run.streams},
        "notes": [line for one in streams for line in one.notes(mapped.undulation_m)],
        "warnings": warnings,
        "error": None if bag.damage is None else f"{path}: {bag.damage}",
    }


def what_can_be_mapped(path: Path, namespace: str) -> str:
    """Return what to do with a bag without named topics: options, or why there are none.

    Raise BagError if it cannot be read.
    """
    topics = any_bag(path).topics()
    if topics.get(resolved(Source.IMU.topic, namespace)) == TOPIC_TYPES[Source.IMU.topic]:
        return "it needs no import: give it to tirgeo process"
    options = suggested(topics)
    if options:
        return f"say what its topics are, as {options}"
    named = [f"{topic} ({kind})" for topic, kind in topics.items()]
    more = f" and {len(named) - _MOST_NAMED} more" if len(named) > _MOST_NAMED else ""
    return (
        "nothing to import: no topic has a type that tirgeo takes; it has "
        f"{', '.join(named[:_MOST_NAMED])}{more}"
    )

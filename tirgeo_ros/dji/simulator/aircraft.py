"""Simulate the aircraft: samples of a flight in, timed frames out, host requests answered."""

from __future__ import annotations

import math
import struct
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Sequence
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
from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame, encode_frame
from tirgeo_ros.dji.protocol.broadcast import Layout, encode_broadcast
from tirgeo_ros.dji.protocol.broadcast_parts import Gimbal
from tirgeo_ros.dji.protocol.commands import (
    NOT_ACTIVATED,
    Opcode,
    Request,
    decode_request,
    encode_code,
    encode_version_ack,
)
from tirgeo_ros.dji.protocol.subscription import (
    BY_UID,
    USUAL_PACKAGES,
    Package,
    PackageTable,
    Push,
    encode_push,
)
from tirgeo_ros.dji.simulator.pushed_parts import (
    TOLD_TOPICS,
    Instant,
    Satellites,
    between,
    broadcast_of,
    topic_values,
)

A3_NAME = "SDK-v1.0 BETA PM820V3PRO-3.2.41.13"
_LEGACY_NAME = "SDK-v1.0 BETA PM820V3PRO-3.2.15.62"
_SERIAL = "0670XXXXXXXXXX"
_KEEP_RATE, _HIGHEST_RATE = 5, 7
#: Usual rate codes of such an aircraft: attitude, force and rate as often as they are measured, 50
#: Hz for what is used to fly, 10 Hz for the rest; neither device nor compass.
USUAL_RATES = (7, 7, 7, 3, 7, 3, 3, 3, 2, 3, 3, 3, 2, 2, 0, 0)
#: Rates beside packages, which hold the same data at up to 400 Hz: both would not fit 921600 baud.
RATES_BESIDE_PACKAGES = (4, 4, 4, 3, 4, *USUAL_RATES[5:])
#: Codes of the subscription's answers.
_EXISTS, _UNKNOWN_PACKAGE, _UNKNOWN_TOPIC, _DENIED = 0x04, 0x05, 0x22, 0x23


class CommandDesk:
    """Read the host's frames, answer them, and keep the settings."""

    def __init__(self, layout: Layout = Layout.MODERN, packages: Sequence[Package] = ()) -> None:
        self.rates: tuple[int, ...] = RATES_BESIDE_PACKAGES if packages else USUAL_RATES
        self.packages = PackageTable(packages)
        self.activated = False
        self._name = _LEGACY_NAME if layout is Layout.LEGACY else A3_NAME
        self._reader = FrameReader()
        self._answered: tuple[tuple[int, int, bytes], bytes] | None = None

    def answer(self, data: bytes) -> bytes:
        """Return the acks to the host's bytes, cut in any way."""
        return b"".join(map(self._answer, self._reader.feed(data)))

    def _answer(self, frame: ProtocolFrame) -> bytes:
        asked = (frame.session, frame.sequence, frame.data)
        if self._answered is None or self._answered[0] != asked:
            request = None if frame.is_ack else decode_request(frame.data)
            value, ack = b"" if request is None else self._done(request), b""
            if value and frame.session:
                session, sequence = frame.session, frame.sequence
                ack = encode_frame(value, session=session, sequence=sequence, is_ack=True)
            self._answered = (asked, ack)
        return self._answered[1]  # a repeated request, whose ack was lost, gets the same ack

    def _done(self, request: Request) -> bytes:
        if request.opcode is Opcode.GET_VERSION:
            return encode_version_ack(0 if self.activated else NOT_ACTIVATED, _SERIAL, self._name)
        return encode_code(request, self.do(request))

    def do(self, request: Request) -> int:
        """Do what a request asks for; return the code of its ack."""
        code, value = 0, request.value
        match request.opcode:
            case Opcode.ACTIVATE:
                self.activated = True
            case Opcode.SET_RATES if max(value) > _HIGHEST_RATE:
                code = 1
            case Opcode.SET_RATES:
                kept = zip(value, self.rates, strict=True)
                self.rates = tuple(old if new == _KEEP_RATE else new for new, old in kept)
            case _ if not self.activated:
                code = _DENIED
            case Opcode.ADD_PACKAGE:
                code = self._add(value)
            case Opcode.REMOVE_PACKAGE:
                code = 0 if self.packages.pop(value[0], None) else _UNKNOWN_PACKAGE
            case Opcode.RESET_PACKAGES:
                self.packages.clear()
        return code

    def _add(self, value: bytes) -> int:
        number, rate_hz, with_timestamp, count = struct.unpack_from("<BHBB", value)
        if number in self.packages:
            return _EXISTS
        uids = struct.unpack_from(f"<{count}I", value, 5)
        topics = tuple(BY_UID[uid] for uid in uids if uid in BY_UID)
        if sum(topic.name in TOLD_TOPICS for topic in topics) < count:
            return _UNKNOWN_TOPIC
        self.packages[number] = Package(number, rate_hz, bool(with_timestamp), topics)
        return 0


Sample = NavigationInput | JointSample | CameraAttitudeSample

_BROADCAST, _PUSH = b"\x02\x00", b"\x02\x05"
#: Hz of the codes 0 to 7. Code 5 keeps the present rate, so it is never stored.
_CODE_HZ = (0, 1, 10, 50, 100, 0, 200, 400)
#: The gimbal is interpolated between its samples, so a frame is made this long after its time.
_AHEAD_S = 0.25
_AHEAD_NS = round(_AHEAD_S * 1e9)
#: A sample of the IMU may be early by this much, or by half of its step, and still be due.
_EARLY_NS = 2_500_000
#: Nothing is interpolated between two IMU samples that are further apart than this.
_LONGEST_STEP_NS = 100_000_000
#: A stamp that goes back by more belongs to another flight: the aircraft is switched on again.
_RESTART_NS = 1_000_000_000
_SECOND_NS = 1_000_000_000


class Outgoing(NamedTuple):
    """Hold a frame and the time when it leaves the aircraft, in the samples' arrival time."""

    time_ns: int
    data: bytes


class Aircraft:
    """Send a recorded flight as an A3 or M600 would.

    Samples are taken in the order of their arrival. Each IMU sample gives a broadcast with the
    parts that are due; it repeats the receivers' newest data until they have new data. Packages
    are pushed at their own rates, with inertial values interpolated between two samples. Frames
    are returned a quarter of a second of the flight later than the samples that they are made of,
    with their true times.
    """

    def __init__(
        self,
        config: SimulatedAircraftConfig | None = None,
        places: AircraftConfig | None = None,
    ) -> None:
        """Take ``places``, the antennas' positions."""
        self._config = config = config or SimulatedAircraftConfig()
        self._places = places or AircraftConfig()
        self._layout = Layout.LEGACY if config.layout == "legacy" else Layout.MODERN
        self.desk = CommandDesk(self._layout, USUAL_PACKAGES if config.pushes else ())
        #: ``broadcasts``, ``pushes``; dropped: ``invalid``, ``imu_not_later``
        self.counts: Counter[str] = Counter()
        self._waiting: deque[tuple[int, NavigationInput]] = deque()
        self._sequence = 0
        self._switch_on()

    def _switch_on(self) -> None:
        self._satellites = Satellites(self._config, self._places)
        self._gimbal = SimulatedGimbalAngles(
            joints=self._config.gimbal == "joints",
            order=self._config.joint_order,
            max_gap_s=_AHEAD_S,
        )
        self._first_ns: int | None = None
        self._imu: ImuSample | None = None  # the newest one that was sent
        self._told_ns = 0
        self._slots: dict[int, int] = {}  # bit of the mask -> period in which it was last sent

    def answer(self, data: bytes) -> bytes:
        """Return what the aircraft writes back to the host's bytes."""
        return self.desk.answer(data)

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
        """Return the frames that wait for later samples, at the end of a flight."""
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
                elif not isinstance(sample, PressureSample | SetHeading):  # not DJI's
                    self._satellites.take(sample)
            for sample in imu:
                frames += self._tell(sample, together_ns)
        return frames

    def _tell(self, imu: ImuSample, arrival_ns: int) -> list[Outgoing]:
        """Return the frames of one IMU sample and of the time before it."""
        before = self._imu
        if before is not None and imu.stamp_ns <= before.stamp_ns:
            if before.stamp_ns - imu.stamp_ns < _RESTART_NS:
                self.counts["imu_not_later"] += 1
                return []
            self._switch_on()
            before = None
        if self._first_ns is None:
            self._first_ns = imu.stamp_ns
        latency_ns = arrival_ns - imu.stamp_ns
        frames = self._pushes(before, imu, latency_ns)
        frames += self._broadcast(imu, arrival_ns)
        self._imu = imu
        outgoing = []
        for time_ns, data in frames:
            self._told_ns = max(self._told_ns, time_ns)  # the link keeps the order
            outgoing.append(Outgoing(self._told_ns, data))
        return outgoing

    def _broadcast(self, imu: ImuSample, arrival_ns: int) -> list[Outgoing]:
        due = {bit for bit, code in enumerate(self.desk.rates) if self._is_due(bit, code, imu)}
        broadcast = broadcast_of(self._instant(imu), self._layout, due)
        if not broadcast.mask:
            return []
        self.counts["broadcasts"] += 1
        return [Outgoing(arrival_ns, self._framed(_BROADCAST + encode_broadcast(broadcast)))]

    def _is_due(self, bit: int, code: int, imu: ImuSample) -> bool:
        assert self._first_ns is not None
        if not _CODE_HZ[code]:
            return False
        step_ns = imu.stamp_ns - (self._imu.stamp_ns if self._imu else self._first_ns)
        since_ns = imu.stamp_ns - self._first_ns + min(_EARLY_NS, step_ns // 2)
        slot = since_ns * _CODE_HZ[code] // _SECOND_NS
        if self._slots.get(bit) == slot:
            return False
        self._slots[bit] = slot
        return True

    def _pushes(self, before: ImuSample | None, imu: ImuSample, latency_ns: int) -> list[Outgoing]:
        assert self._first_ns is not None
        start_ns = imu.stamp_ns - 1 if before is None else before.stamp_ns
        if imu.stamp_ns - start_ns > _LONGEST_STEP_NS:
            start_ns = imu.stamp_ns - 1
        due = sorted(
            (stamp_ns, package)
            for package in self.desk.packages.values()
            for stamp_ns in _grid(self._first_ns, start_ns, imu.stamp_ns, package.rate_hz)
        )
        frames = []
        for stamp_ns, package in due:
            at = imu if before is None else between(before, imu, stamp_ns)
            instant = self._instant(at)
            values = topic_values(instant, tuple(topic.name for topic in package.topics))
            if values is not None:
                push = Push(package, instant.ms, instant.rest_ns, values)
                data = self._framed(_PUSH + encode_push(push))
                frames.append(Outgoing(stamp_ns + latency_ns, data))
        self.counts["pushes"] += len(frames)
        return frames

    def _instant(self, imu: ImuSample) -> Instant:
        assert self._first_ns is not None
        since_ns = imu.stamp_ns - self._first_ns
        since_ns += round(since_ns * self._config.clock_drift_ppm * 1e-6)
        q_nb = imu.autopilot_q_nb
        if not usable_attitude(q_nb):
            q_nb, imu = None, ImuSample(imu.stamp_ns, imu.specific_force_b, imu.angular_rate_b)
        time_ns = since_ns + self._config.clock_start_ms * 1_000_000
        gimbal = self._gimbal.at(imu.stamp_ns, q_nb)
        return Instant(time_ns, since_ns, imu, gimbal, self._satellites)

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


class SimulatedGimbalAngles:
    """Interpolate the recorded gimbal attitudes.

    ``joints``: combine the aircraft's attitude with the encoders' angles, so that encoder angles
    survive a protocol that has none. Without them, or if it is false, use the recorded attitude.
    Nothing is extrapolated.
    """

    def __init__(self, *, joints: bool, order: str, max_gap_s: float) -> None:
        self._by_joints, self._order = joints, order
        self._joints: StampedBuffer[Array] = StampedBuffer(max_gap_s=max_gap_s)  # q_bg
        self._reported: StampedBuffer[Array] = StampedBuffer(max_gap_s=max_gap_s)  # q_ng

    def take(self, sample: JointSample | CameraAttitudeSample) -> bool:
        """Take a sample, which may be of the future; return whether it is valid."""
        if isinstance(sample, CameraAttitudeSample):
            sound = usable_attitude(sample.q_ng)
            if sound:
                self._reported.put(sample.stamp_ns, sample.q_ng)
            return sound
        sound = math.isfinite(sample.yaw_rad + sample.roll_rad + sample.pitch_rad)
        if sound:
            self._joints.put(sample.stamp_ns, camera_turn(sample, self._order))
        return sound

    def at(self, stamp_ns: int, q_nb: Array | None) -> Gimbal | None:
        """Return the camera's angles at an instant, None if they are not known.

        ``q_nb`` (4,) is the aircraft's own attitude, None if it is not known.
        """
        q_ng = self._attitude(stamp_ns, q_nb)
        if q_ng is None:
            return None
        roll_deg, pitch_deg, yaw_deg = np.degrees(euler_from_quat(q_ng)).tolist()
        return Gimbal(roll_deg, pitch_deg, yaw_deg)

    def _attitude(self, stamp_ns: int, q_nb: Array | None) -> Array | None:
        if self._by_joints and q_nb is not None:
            joints = self._joints.around(stamp_ns)
            if not isinstance(joints, Miss):
                return quat_multiply(q_nb, slerp(*joints))
        reported = self._reported.around(stamp_ns)
        return None if isinstance(reported, Miss) else slerp(*reported)

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
"""Readings from frames and bytes of the serial link: units, axes, times, messages."""

from __future__ import annotations

import math
import struct

import pytest

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.link.serial_link import LinkState, LinkWatch, Totals
from tirgeo_ros.dji.protocol import rtk_gps_imu_broadcast as parts
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import Broadcast, Layout, Time, encode_broadcast
from tirgeo_ros.dji.protocol.subscription import (
    USUAL_PACKAGES,
    Package,
    PackageTable,
    Push,
    encode_push,
)
from tirgeo_ros.dji.sources.readings import (
    AccelerationUnit,
    AttitudeReading,
    GeodeticPlace,
    GimbalReading,
    GpsReading,
    ImuOrigin,
    ImuReading,
    RtkReading,
)
from tirgeo_ros.dji.sources.serial import Clocks, SerialDecoder, Telemetry

ARRIVAL_NS = 77_000_000_000
BERN = (46.948, 7.4474)  # lat, lon in deg: far enough apart to tell them from each other
Q = (0.5, 0.5, -0.5, 0.5)  # these are kept exactly by 32 bits, as all numbers below
ACCELERATION, RATE = (0.25, -0.5, -1.0), (0.125, 0.0, -0.0625)
DETAIL = parts.GpsDetail(90.0, 150.0, 3.0, 1500.0, 750.0, 25.0, 9, 5, 14, 1)


class Ticks:
    """Return the counter in ns as the stamp, and record the arrivals."""

    def __init__(self, tick_ns):
        self.tick_ns = tick_ns
        self.arrivals = []

    def stamp_ns(self, ticks, arrival_ns, extra_ns=0):
        self.arrivals.append(arrival_ns)
        return ticks * self.tick_ns + extra_ns


@pytest.fixture
def clocks():
    return Clocks(Ticks(1_000_000), Ticks(1_000_000), Ticks(2_500_000))


@pytest.fixture
def telemetry(clocks):
    return Telemetry(clocks, PackageTable())


def frame_of(cmd_set, cmd_id, value, **more):
    (frame,) = FrameReader().feed(encode_frame(bytes([cmd_set, cmd_id]) + value, **more))
    return frame


def read(telemetry, broadcast):
    return telemetry.read(frame_of(2, 0, encode_broadcast(broadcast)), ARRIVAL_NS)


def push(telemetry, number, **values):
    package = next(item for item in USUAL_PACKAGES if item.id == number)
    empty = {topic.name: topic.make(_zeros(topic)) for topic in package.topics}
    stamp = (5000, 0) if package.with_timestamp else (None, None)
    value = encode_push(Push(package, *stamp, empty | values))
    return telemetry.read(frame_of(2, 5, value), ARRIVAL_NS)


def _zeros(topic):
    form = struct.Struct(f"<{topic.form}")
    return form.unpack(bytes(form.size))


def test_broadcast_of_an_imu_sample(telemetry):
    broadcast = Broadcast(
        time=parts.Time(1234, 0, 0, 0, 0),
        quaternion_wxyz=Q,
        acceleration_as_packed=ACCELERATION,
        angular_rate_radps=RATE,
    )
    origin, unit = ImuOrigin.BROADCAST, AccelerationUnit.UNKNOWN
    expected = ImuReading(1_234_000_000, origin, ACCELERATION, unit, RATE, Q)
    assert read(telemetry, broadcast) == [expected]


def test_a_broadcast_without_time_is_stamped_at_arrival_and_counted(telemetry):
    assert read(telemetry, Broadcast(quaternion_wxyz=Q)) == [AttitudeReading(ARRIVAL_NS, Q)]
    assert telemetry.counts["untimed"] == 1
    assert read(telemetry, Broadcast()) == []
    assert telemetry.counts["untimed"] == 1  # it contains nothing to stamp


@pytest.mark.parametrize("layout", [Layout.MODERN, Layout.LEGACY])
def test_broadcast_of_satellites_and_gimbal(telemetry, layout):
    modern = layout is Layout.MODERN
    time = parts.Time(20, 0, 0, 0, 0) if modern else parts.Time(20, 0)
    gps = parts.Gps(20260101, 1, 74474000, 469480000, 512345, (100.0, -50.0, 25.0))
    rtk = parts.Rtk(20260101, 1, BERN[1], BERN[0], 512.5, (-200.0, 300.0, -50.0), -77, 50, 49)
    broadcast = Broadcast(
        layout=layout,
        time=time,
        gps=gps._replace(detail=DETAIL) if modern else gps,
        rtk=rtk,
        gimbal=parts.Gimbal(1.0, -30.0, 170.0, 0),
    )
    got_gps, got_rtk, gimbal = read(telemetry, broadcast)
    place = GeodeticPlace(*map(math.radians, BERN), 512.345)
    quality = (3, 0.75, 1.5, 0.25) if modern else (None, None, None, None)
    assert got_gps.place == pytest.approx(place, rel=1e-15)
    assert got_gps == GpsReading(20_000_000, got_gps.place, (1.0, -0.5, 0.25), *quality)
    place = GeodeticPlace(*map(math.radians, BERN), 512.5)
    assert got_rtk == RtkReading(20_000_000, place, 50, (-2.0, 3.0, -0.5), -77, 49)
    assert gimbal == GimbalReading(20_000_000, *map(math.radians, (1.0, -30.0, 170.0)))


def test_hard_sync_is_timed_by_its_ticks(telemetry, clocks):
    tick = parts.HardSync(400, 12_345, 0, 0, 0, Q, ACCELERATION, RATE)
    stamp_ns, origin = 400 * 2_500_000 + 12_345, ImuOrigin.HARD_SYNC
    expected = ImuReading(stamp_ns, origin, ACCELERATION, AccelerationUnit.G, RATE, Q)
    assert push(telemetry, 3, HARD_SYNC=tick) == [expected]
    assert clocks.hard_sync.arrivals == [ARRIVAL_NS]
    assert clocks.subscription.arrivals == [ARRIVAL_NS]


def test_subscribed_satellites_and_gimbal(telemetry):
    values = {
        "GPS_POSITION": parts.GpsPosition(74474000, 469480000, 512345),
        "GPS_VELOCITY": (100.0, -50.0, 25.0),
        "GPS_DETAILS": DETAIL,
        "RTK_POSITION": parts.RtkPosition(BERN[1], BERN[0], 512.5),
        "RTK_VELOCITY": (-200.0, 300.0, -50.0),
        "RTK_YAW": -77,
        "RTK_POSITION_INFO": 50,
        "RTK_YAW_INFO": 48,
    }
    rtk, gps = push(telemetry, 0, **values)
    place = GeodeticPlace(*map(math.radians, BERN), 512.5)
    assert rtk == RtkReading(5_000_000_000, place, 50, (-2.0, 3.0, -0.5), -77, 48)
    assert gps.place == pytest.approx(GeodeticPlace(*map(math.radians, BERN), 512.345), rel=1e-15)
    assert gps[2:] == ((1.0, -0.5, 0.25), 3, 0.75, 1.5, 0.25)
    (gimbal,) = push(telemetry, 1, GIMBAL_ANGLES=parts.GimbalAngles(-30.0, 1.0, 170.0))
    assert gimbal == GimbalReading(5_000_000_000, *map(math.radians, (1.0, -30.0, 170.0)))


GPS_ALONE = Package.of(4, 5, with_timestamp=True, names=("GPS_POSITION",))


@pytest.mark.parametrize("evidence", ["GPS_FUSED", "broadcast", "the poles"])
def test_a_gps_position_with_its_latitude_first_is_recognised(clocks, evidence):
    telemetry = Telemetry(clocks, PackageTable([*USUAL_PACKAGES, GPS_ALONE]))
    raw, (latitude, longitude) = parts.GpsPosition(469480000, 74474000, 0), BERN
    if evidence == "GPS_FUSED":
        push(telemetry, 1, GPS_FUSED=parts.GpsFused(math.radians(7.4), math.radians(46.9), 0.0, 9))
    elif evidence == "broadcast":
        there = parts.Position(math.radians(46.9), math.radians(7.4), 0.0, 0.0, 5)
        beside = parts.RelativePosition(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0)
        time = parts.Time(1, 0, 0, 0, 0)
        read(telemetry, Broadcast(time=time, position=there, relative_position=beside))
    else:  # 100 deg cannot be a latitude
        raw, latitude, longitude = parts.GpsPosition(469480000, 1000000000, 0), 46.948, 100.0
    value = encode_push(Push(GPS_ALONE, 5000, 0, {"GPS_POSITION": raw}))
    (gps,) = telemetry.read(frame_of(2, 5, value), ARRIVAL_NS)
    result = gps.place.latitude_rad, gps.place.longitude_rad
    assert result == pytest.approx((math.radians(latitude), math.radians(longitude)), abs=1e-9)
    assert telemetry.counts["axes_swapped"] == 1


KEY = bytes(range(32))
NOW_NS = 1_800_000_000_000_000_000


def frame(time_ms, key=None):
    parts = Broadcast(time=Time(time_ms, 0, 0, 0, 0), quaternion_wxyz=Q)
    return encode_frame(b"\x02\x00" + encode_broadcast(parts), key=key)


@pytest.fixture
def decoder():
    return SerialDecoder(DjiConfig(), PackageTable())


def test_bytes_become_readings_at_the_aircrafts_pace(decoder):
    # Sent every 10 ms, read in pairs: the first of a pair was sent 10 ms before its arrival.
    stamps = []
    for k in range(2, 200, 2):
        arrival_ns = NOW_NS + k * 10_000_000
        pair = frame(10 * (k - 1)) + frame(10 * k)
        readings = decoder.take(pair, arrival_ns, k * 0.01)
        assert [type(reading) for reading in readings] == [AttitudeReading] * 2
        stamps += [reading.stamp_ns for reading in readings]
    last = NOW_NS + 198 * 10_000_000
    assert stamps[-2:] == pytest.approx([last - 10_000_000, last], abs=100_000)
    assert decoder.frames.counts["frames"] == 198
    assert decoder.frames.counts["bytes"] == 198 * len(frame(0))


def test_each_frame_of_a_batch_has_the_time_at_which_its_bytes_were_complete():
    decoder = SerialDecoder(DjiConfig(baud=921600), PackageTable())
    parts = encode_broadcast(Broadcast(quaternion_wxyz=Q))  # without a time
    untimed = encode_frame(b"\x02\x00" + parts)
    decoder.take(untimed[:7], NOW_NS - 10_000_000, 0.9)  # earlier bytes do not count
    readings = decoder.take(untimed[7:] + untimed * 2, NOW_NS, 1.0, 3_000_000)
    byte_ns = 10e9 / 921600
    ends = [NOW_NS - 3_000_000 + (k * len(untimed) - 7) * byte_ns for k in (1, 2, 3)]
    # the time of a byte in whole ns, over 102 bytes
    assert [reading.stamp_ns for reading in readings] == pytest.approx(ends, rel=0, abs=102)
    late = decoder.take(untimed * 200, NOW_NS, 1.1, 3_000_000)
    assert late[-1].stamp_ns == NOW_NS  # it cannot have come after it was read


def test_a_cut_frame_is_dropped_after_a_pause(decoder):
    whole = frame(10)
    promising = encode_frame(bytes(600))[:20]  # its header promises 618 bytes
    assert decoder.take(promising + whole, NOW_NS, 1.0) == []
    assert decoder.take(b"", NOW_NS, 1.04) == []
    (reading,) = decoder.take(b"", NOW_NS, 1.06)
    assert reading.q_nb == Q
    assert decoder.take(b"", NOW_NS, 2.0) == []


@pytest.mark.parametrize(
    ("key", "words"), [(bytes(32).hex(), "key is not the aircraft's"), ("", "key is not set")]
)
def test_a_wrong_key_is_named(key, words):
    """Frames with meaningless data do not count as received, although their check sums are right.

    Ten seconds at 50 frames a second, including acks of the aircraft.
    """
    decoder = SerialDecoder(DjiConfig(key=key), PackageTable())
    watch = LinkWatch("/dev/ttyUSB0", 230400, has_key=bool(key))
    reports = []
    for k in range(1, 500):
        data = frame(20 * k, KEY)
        if k % 50 == 0:
            data += encode_frame(bytes(2), is_ack=True, session=2, key=KEY)
        now_s = k * 0.02
        decoder.take(data, NOW_NS + k * 20_000_000, now_s)
        counts = decoder.frames.counts["bytes"], decoder.frames.counts["frames"], decoder.locked
        report = watch.look(LinkState.OPEN, "", Totals(now_s, *counts))
        reports += [report.condition] if report else []
    assert reports == ["waiting", "wrong_key"]
    assert watch.report.level is Severity.STOP
    assert words in watch.report.message
    assert "/dev/ttyUSB0" in watch.report.message

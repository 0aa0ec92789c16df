"""Bytes of the serial link to readings, with what the host says."""

from __future__ import annotations

import pytest

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.dji.link.framing import encode_frame
from tirgeo_ros.dji.link.link_watch import LinkLevel, LinkWatch
from tirgeo_ros.dji.link.serial_link import LinkState
from tirgeo_ros.dji.protocol.broadcast import Broadcast, encode_broadcast
from tirgeo_ros.dji.protocol.broadcast_parts import Time
from tirgeo_ros.dji.protocol.subscription import PackageTable
from tirgeo_ros.dji.sources.readings import AttitudeReading
from tirgeo_ros.dji.sources.serial import SerialDecoder

Q = (0.5, 0.5, -0.5, 0.5)
KEY = bytes(range(32))
NOW_NS = 1_800_000_000_000_000_000


def frame(time_ms, key=None):
    parts = Broadcast(time=Time(time_ms, 0, 0, 0, 0), quaternion_wxyz=Q)
    return encode_frame(b"\x02\x00" + encode_broadcast(parts), key=key)


@pytest.fixture
def road():
    return SerialDecoder(DjiConfig(), PackageTable())


def test_bytes_become_readings_at_the_aircrafts_pace(road):
    # Sent every 10 ms, read in pairs: the first of a pair is 10 ms older than its arrival tells.
    stamps = []
    for k in range(2, 200, 2):
        arrival_ns = NOW_NS + k * 10_000_000
        pair = frame(10 * (k - 1)) + frame(10 * k)
        readings = road.take(pair, arrival_ns, k * 0.01)
        assert [type(reading) for reading in readings] == [AttitudeReading] * 2
        stamps += [reading.stamp_ns for reading in readings]
    last = NOW_NS + 198 * 10_000_000
    assert stamps[-2:] == pytest.approx([last - 10_000_000, last], abs=100_000)
    assert road.counts["frames"] == 198
    assert road.counts["bytes"] == 198 * len(frame(0))


def test_each_frame_of_a_batch_has_the_time_at_which_the_line_had_brought_it():
    road = SerialDecoder(DjiConfig(baud=921600), PackageTable())
    parts = encode_broadcast(Broadcast(quaternion_wxyz=Q))  # no time of its own: of its arrival
    untimed = encode_frame(b"\x02\x00" + parts)
    road.take(untimed[:7], NOW_NS - 10_000_000, 0.9)  # bytes that were there before count no more
    readings = road.take(untimed[7:] + untimed * 2, NOW_NS, 1.0, 3_000_000)
    byte_ns = 10e9 / 921600
    ends = [NOW_NS - 3_000_000 + (k * len(untimed) - 7) * byte_ns for k in (1, 2, 3)]
    # the time of a byte in whole ns, over 102 bytes
    assert [reading.stamp_ns for reading in readings] == pytest.approx(ends, rel=0, abs=102)
    late = road.take(untimed * 200, NOW_NS, 1.1, 3_000_000)
    assert late[-1].stamp_ns == NOW_NS  # it cannot have come after it was read


def test_a_frame_whose_rest_does_not_come_is_given_up_after_a_pause(road):
    whole = frame(10)
    promising = encode_frame(bytes(600))[:20]  # its header promises 618 bytes
    assert road.take(promising + whole, NOW_NS, 1.0) == []
    assert road.take(b"", NOW_NS, 1.04) == []
    (reading,) = road.take(b"", NOW_NS, 1.06)
    assert reading.q_nb == Q
    assert road.take(b"", NOW_NS, 2.0) == []


def conditions(key, sent_with):
    """What the watch says in ten seconds at 50 frames a second, the aircraft's acks among them."""
    road = SerialDecoder(DjiConfig(key=key), PackageTable())
    watch = LinkWatch("/dev/ttyUSB0", 230400, has_key=bool(key))
    told = []
    for k in range(1, 500):
        data = frame(20 * k, sent_with)
        if k % 50 == 0:
            data += encode_frame(bytes(2), is_ack=True, session=2, key=sent_with)
        now_s = k * 0.02
        road.take(data, NOW_NS + k * 20_000_000, now_s)
        counts = road.counts["bytes"], road.counts["frames"], road.locked
        report = watch.look(now_s, LinkState.OPEN, "", *counts)
        told += [report] if report else []
    return [report.condition for report in told], watch.report


@pytest.mark.parametrize(
    ("key", "words"), [(bytes(32).hex(), "key is not the aircraft's"), ("", "key is not set")]
)
def test_a_wrong_key_is_named(key, words):
    """Frames whose data makes no sense are not received, whatever their check sums say."""
    told, report = conditions(key, KEY)
    assert told == ["waiting", "wrong_key"]
    assert report.level is LinkLevel.ERROR
    assert words in report.message
    assert "/dev/ttyUSB0" in report.message

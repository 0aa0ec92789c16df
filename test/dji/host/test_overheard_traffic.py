"""What is learned from a capture that holds both directions."""

from __future__ import annotations

import pytest

from tirgeo_ros.dji.host.overheard_traffic import HostTraffic
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.protocol.commands import (
    GetVersion,
    RemovePackage,
    ResetPackages,
    encode_request,
)
from tirgeo_ros.dji.protocol.subscription import Package, PackageTable

YAW = Package.of(1, 5, with_timestamp=False, names=("RTK_YAW",))


def frame(data, **options):
    (found,) = FrameReader().feed(encode_frame(data, **options))
    return found


def asked(request, session=2, sequence=7):
    return frame(encode_request(request), session=session, sequence=sequence)


def answered(code, session=2, sequence=7):
    return frame(bytes([code]), session=session, sequence=sequence, is_ack=True)


@pytest.fixture
def table():
    return PackageTable()


@pytest.fixture
def traffic(table):
    return HostTraffic(table)


@pytest.mark.parametrize("request_", [YAW.request, RemovePackage(1), ResetPackages()])
def test_a_refused_request_has_changed_nothing(table, traffic, request_):
    before = dict(table)
    traffic.take(asked(request_))
    assert table != before
    assert traffic.take(answered(0x24)) == request_
    assert table == before


def test_a_request_sent_again_is_one_request(table, traffic):
    before = dict(table)
    for _ in range(3):
        traffic.take(asked(YAW.request))
    traffic.take(answered(0x06))
    assert table == before


def test_what_another_request_has_learned_stays(table, traffic):
    gps = Package.of(0, 5, with_timestamp=True, names=("GPS_DATE",))
    traffic.take(asked(YAW.request, sequence=1))
    traffic.take(asked(gps.request, sequence=2))
    traffic.take(answered(0x06, sequence=1))
    assert table.get(0) == gps
    assert table.get(1) == PackageTable().get(1)


def test_an_answer_belongs_to_its_session_and_sequence(table, traffic):
    traffic.take(asked(YAW.request))
    assert traffic.take(answered(0x06, sequence=8)) is None
    assert traffic.take(answered(0x06, session=3)) is None
    assert table.get(1) == YAW


def test_what_is_open_is_bounded(table, traffic):
    for sequence in range(1000):
        traffic.take(asked(GetVersion(), sequence=sequence))
    assert traffic.take(answered(0, sequence=0)) is None
    assert traffic.take(answered(0, sequence=999)) == GetVersion()


def test_pushes_and_damaged_requests_say_nothing(table, traffic):
    before = dict(table)
    assert traffic.take(frame(b"\x02\x05\x01\x02")) is None
    assert traffic.take(frame(b"\x0b\x01\x01\x05\x00")) is None
    assert traffic.take(frame(b"\x0b\x03")) is None
    assert table == before

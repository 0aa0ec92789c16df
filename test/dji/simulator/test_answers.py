"""How the simulated aircraft answers a host."""

from __future__ import annotations

import pytest
from aircraft_on_port import hovering

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.config.dji import DjiHostConfig
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.protocol.broadcast import decode_broadcast
from tirgeo_ros.dji.protocol.commands import (
    GET_VERSION,
    activate,
    decode_code,
    set_rates,
)
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, PackageTable
from tirgeo_ros.dji.simulator import Aircraft, frames_of
from tirgeo_ros.dji.sources.serial import SerialDecoder

SECOND = 1_000_000_000


class Host:
    """Asks an aircraft, in frames of reliable sessions."""

    def __init__(self, aircraft):
        self.aircraft = aircraft
        self.sequence = 0

    def ask(self, request, session=2):
        self.sequence += 1
        asked = encode_frame(request.data, session=session, sequence=self.sequence)
        frames = FrameReader().feed(self.aircraft.answer(asked))
        assert all(
            (f.is_ack, f.session, f.sequence) == (True, session, self.sequence) for f in frames
        )
        return frames[0].data if frames else b""

    def code(self, request):
        return decode_code(request, self.ask(request))


@pytest.fixture
def host():
    return Host(Aircraft(activation=(3, 0)))


def test_requests_come_in_pieces_twice_and_without_a_wish_for_an_answer(host):
    asked = encode_frame(activate(1, (3, 2, 41, 13)).data, session=2, sequence=9)
    assert host.aircraft.answer(asked[:7]) == b""
    ack = host.aircraft.answer(asked[7:])
    assert ack
    assert host.aircraft.answer(asked) == ack  # asked again: the same answer, not the next
    assert host.ask(GET_VERSION, session=0) == b""
    assert host.aircraft.answer(encode_frame(b"\x07\x07\x01", session=2)) == b""  # never heard of


def test_rates_are_set_by_their_codes():
    aircraft = Aircraft()
    host = Host(aircraft)
    assert host.code(set_rates((9,) * 16)) == 1
    assert host.code(set_rates((2, 5, 2) + (0,) * 13)) == 0
    frames = list(frames_of(aircraft, hovering(1.0)))
    said = [decode_broadcast(f.value) for f in FrameReader().feed(b"".join(f[1] for f in frames))]
    assert [k for k, part in enumerate(said) if part.time is not None] == list(range(0, 100, 10))
    assert all(part.quaternion_wxyz is not None for part in said)
    assert all(part.angular_rate_radps is part.rtk is part.gimbal is None for part in said)
    assert host.code(set_rates((0,) * 16)) == 0
    assert list(frames_of(aircraft, hovering(1.0, SECOND))) == []


def test_dji_nodes_own_host_gets_what_it_asks_for():
    """Activation, rates and packages, over a link that brings and takes at once."""
    host = DjiHostConfig(app_id=7, broadcast_rates=(4, 4, 4, 0, 4) + (0,) * 11, subscribe=True)
    aircraft, road = Aircraft(), SerialDecoder(DjiConfig(host=host), PackageTable())
    for time_ns, data in frames_of(aircraft, hovering(8.0)):
        now_s = time_ns * 1e-9
        road.take(data, time_ns, now_s)
        road.take(aircraft.answer(road.host.due(now_s)), time_ns, now_s)
    assert aircraft.desk.activated
    assert aircraft.desk.rates[:5] == (4, 4, 4, 0, 4)
    assert list(aircraft.desk.packages.values()) == list(USUAL_PACKAGES)
    assert road.diagnostics["host state"] == "ready"
    assert int(road.diagnostics["telemetry subscription"]) > 400
    assert aircraft.counts["pushes"] > 400

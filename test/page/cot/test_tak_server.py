"""Cursor-on-Target over a real TAK server, as another member of the team receives it."""

from __future__ import annotations

import math

import pytest
from cot_objects import flying, sharing, target
from project import wait_until
from tak_server import Member, TakServer

from tirgeo_ros.page.cot import link as link_module
from tirgeo_ros.page.cot.link import aircraft_uid


@pytest.fixture
def secure(tmp_path):
    taky = TakServer(tmp_path, tls=True)
    taky.start()
    yield taky
    taky.kill()


def of(uid):
    return lambda event: event.get("uid") == uid


def deletion_of(uid):
    return lambda event: event.get("type") == "t-x-d-d" and event.find(".//link").get("uid") == uid


def place(event):
    point = event.find("point").attrib
    return [float(point[key]) for key in ("lat", "lon", "hae", "ce", "le")]


#: taky passes on six decimals of a degree and one of a metre.
DEGREES, METRES = 6e-7, 0.06


def test_targets_aircraft_and_sight_arrive_and_what_waited_for_a_dead_server(server, monkeypatch):
    monkeypatch.setattr(link_module, "_AGAIN_S", 5.0)
    first, second = target(1), target(2, "hut")
    with sharing(server.address) as link:
        member = Member.of(server)
        link.targets([first, second])
        arrived = member.got(of("tirgeo-" + first.id))
        assert place(arrived)[:2] == pytest.approx([48.20817425, 16.37381885], abs=DEGREES)
        assert place(arrived)[2:] == pytest.approx([211.25, 4.292, 0.822], abs=METRES)

        link.targets([target(1, "found"), second])
        edited = member.got(of("tirgeo-" + first.id))
        assert edited.get("time") > arrived.get("time")
        assert edited.find(".//contact").get("callsign") == "1 found"

        state = flying()
        link.aircraft("", state)
        aircraft = member.got(of(aircraft_uid("")))
        check_aircraft(aircraft, member.got(of(aircraft_uid("") + "-looks-at")), state)

        wait_until(lambda: not link.status.queued)
        server.kill()
        wait_until(lambda: not link.status.connected)
        link.targets([first])  # an edit and a deletion
        wait_until(lambda: "is the TAK server running" in link.status.error)
        assert link.status.queued == 3  # the second one is withdrawn too
        server.start()
        member = Member.of(server)
        assert (
            member.got(of("tirgeo-" + first.id)).find(".//contact").get("callsign") == "1 person"
        )
        member.got(deletion_of("tirgeo-" + second.id))
        wait_until(lambda: link.status.connected and not link.status.queued)
        assert link.status.error == ""


def check_aircraft(aircraft, looks_at, state):
    assert place(aircraft)[:2] == pytest.approx([48.2, 16.37], abs=DEGREES)
    assert place(aircraft)[2:] == pytest.approx([350.0, 0.1, 0.2], abs=METRES)
    track = aircraft.find(".//track").attrib
    assert [float(track[key]) for key in ("course", "speed")] == [225.0, 8.5]
    sensor = {key: float(text) for key, text in aircraft.find(".//sensor").attrib.items()}
    roll, elevation, azimuth = map(math.degrees, state.view.sight_rpy)
    wide, high = map(math.degrees, state.view.fields_of_view)
    expected = {"azimuth": azimuth % 360, "elevation": elevation, "roll": roll}
    expected |= {"fov": wide, "vfov": high}
    expected["range"] = state.view.slant_range_m * math.cos(math.radians(elevation))
    assert sensor == pytest.approx(expected, abs=1e-3)
    latitude, longitude, height_m = state.view.centre
    assert place(looks_at)[:2] == pytest.approx(
        [math.degrees(latitude), math.degrees(longitude)], abs=DEGREES
    )
    errors = [height_m, state.view.ce90_m, state.view.le90_m]
    assert place(looks_at)[2:] == pytest.approx(errors, abs=METRES)
    assert looks_at.find(".//link").get("uid") == aircraft.get("uid")


@pytest.mark.slow
def test_tls_with_a_clients_certificate_and_none_without(secure, tmp_path):
    mine = secure.client("aircraft")
    member = Member.of(secure, secure.client("member"))
    with sharing(secure.address, certificate=str(mine), ca=secure.ca) as link:
        link.targets([target(1)])
        arrived = member.got(of("tirgeo-" + target(1).id))
        assert place(arrived)[:2] == pytest.approx([48.20817425, 16.37381885], abs=DEGREES)

    other = tmp_path / "other"
    other.mkdir()
    theirs = str(TakServer(other, tls=True).client("stranger"))
    with sharing(secure.address, certificate=theirs, ca=secure.ca) as link:
        wait_until(lambda: "look at cot_ca, cot_certificate" in link.status.error)
        assert not link.status.connected

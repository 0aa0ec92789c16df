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
"""Cursor-on-Target over a real TAK server, as another member of the team receives it."""

from __future__ import annotations

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
        assert place(aircraft)[:2] == pytest.approx([48.2, 16.37], abs=DEGREES)
        assert place(aircraft)[2:] == pytest.approx([350.0, 0.1, 0.2], abs=METRES)
        looks_at = member.got(of(aircraft_uid("") + "-looks-at"))
        assert place(looks_at)[2] == pytest.approx(state.view.centre[2], abs=METRES)
        assert looks_at.find(".//link").get("uid") == aircraft.get("uid")

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


@pytest.mark.slow
def test_tls_with_a_clients_certificate_and_none_without(secure, tmp_path):
    mine = secure.client("aircraft")
    member = Member.of(secure, secure.client("member"))
    with sharing(secure.address, cot_certificate=str(mine), cot_ca=secure.ca) as link:
        link.targets([target(1)])
        arrived = member.got(of("tirgeo-" + target(1).id))
        assert place(arrived)[:2] == pytest.approx([48.20817425, 16.37381885], abs=DEGREES)

    other = tmp_path / "other"
    other.mkdir()
    theirs = str(TakServer(other, tls=True).client("stranger"))
    with sharing(secure.address, cot_certificate=theirs, cot_ca=secure.ca) as link:
        wait_until(lambda: "check cot_ca, cot_certificate" in link.status.error)
        assert not link.status.connected

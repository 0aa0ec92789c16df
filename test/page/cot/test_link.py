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
"""The link to the team: on and off, events that wait and are sent again, its end."""

from __future__ import annotations

import dataclasses
import math
import time

from cot_objects import flying, sharing, target
from project import free_port, wait_until
from tak_server import Member

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.page.cot import link as link_module
from tirgeo_ros.page.cot.link import CotLink, Outbox, aircraft_uid

GROUP = "239.2.3.1"


def uid(number):
    return "tirgeo-" + target(number).id


def flush(outbox):
    """Send all that waits; return the uids."""
    uids = []
    while (entry := outbox.first()) is not None:
        uids.append(entry[1](0).get("uid"))
        outbox.sent(*entry)
    return uids


def test_the_newest_of_each_waits_and_kept_ones_wait_again():
    outbox = Outbox()
    old, new = object(), object()
    outbox.put("a", old, keep=True)
    outbox.put("b", old, keep=False)
    entry = outbox.first()
    assert entry == ("a", old)
    outbox.put("a", new, keep=True)
    outbox.sent(*entry)  # of the old one: the new one still waits, behind b
    assert [outbox.first(), len(outbox)] == [("b", old), 2]
    outbox.sent(*outbox.first())
    outbox.sent(*outbox.first())
    assert outbox.first() is None
    outbox.all_again()
    assert [outbox.first(), len(outbox)] == [("a", new), 1]


def test_the_outbox_is_bounded_and_counts_what_it_drops(monkeypatch):
    monkeypatch.setattr(link_module, "_MOST", 3)
    outbox = Outbox()
    for number in range(5):
        outbox.put(str(number), object(), keep=False)
    assert (len(outbox), outbox.dropped, outbox.first()[0]) == (3, 2, "2")


def test_a_target_that_never_went_out_needs_no_deletion_and_an_undone_one_none():
    outbox = Outbox()
    outbox.targets([target(1)])
    assert flush(outbox) == [uid(1)]
    outbox.targets([target(1), target(2)])
    outbox.targets([])
    assert flush(outbox) == [uid(1), uid(1) + "-deleted"]
    outbox.all_again()
    assert flush(outbox) == [uid(1) + "-deleted"]
    outbox.targets([target(1)])  # the deletion is undone
    outbox.all_again()
    assert flush(outbox) == [uid(1)]


def test_a_target_that_is_deleted_while_it_is_sent_is_taken_back():
    outbox = Outbox()
    outbox.targets([])
    outbox.targets([target(1)])
    entry = outbox.first()  # it is on its way; whether it arrives is not known
    outbox.targets([])
    outbox.sent(*entry)
    assert flush(outbox) == [uid(1), uid(1) + "-deleted"]


def test_targets_of_an_earlier_run_are_deleted_too():
    outbox = Outbox()
    outbox.targets([target(1)])
    outbox.targets([])
    assert flush(outbox) == [uid(1), uid(1) + "-deleted"]


def test_old_deletions_are_not_sent_for_ever(monkeypatch):
    monkeypatch.setattr(link_module, "_DELETIONS_KEPT", 2)
    outbox = Outbox()
    outbox.targets([target(number) for number in range(4)])
    flush(outbox)
    outbox.targets([])
    assert len(flush(outbox)) == 8  # each goes once
    outbox.all_again()
    assert len(flush(outbox)) == 2


def test_an_aircraft_is_sent_once_a_second_with_its_own_time_and_only_with_a_place():
    outbox = Outbox()
    outbox.aircraft("lost", dataclasses.replace(flying(), latitude_deg=math.nan))
    assert len(outbox) == 0
    before = utc(time.time_ns())
    for _ in range(20):
        outbox.aircraft("uav1", flying())
    after = utc(time.time_ns())
    event = outbox.first()[1](time.time_ns() + 10**12)  # sent much later
    assert before <= event.get("time") <= after
    assert flush(outbox) == [aircraft_uid("uav1"), aircraft_uid("uav1") + "-looks-at"]
    assert aircraft_uid("uav1") != aircraft_uid("uav2")


def test_nothing_goes_out_while_it_is_off():
    member = Member.of_group(GROUP)
    with sharing(f"udp://{GROUP}:{member.port}?interface=127.0.0.1") as link:
        link.targets([target(1), target(2)])
        member.got(lambda event: event.get("uid") == uid(2))
        wait_until(lambda: not link.status.queued)
        assert "stays" in link.share(on=False)
        link.targets([target(3)])
        link.aircraft("", flying())
        assert link._outbox.first() is None  # also before the connection has ended
        link.targets([target(2), target(4)])  # 1 is deleted, 3 was never seen
        assert (link.status.connected, link.status.queued) == (False, 0)
        link.share(on=True)
        missing = {uid(2), uid(4), uid(1) + "-deleted"}
        while missing:
            missing.remove(member.got(lambda event: event.get("uid") in missing).get("uid"))
        gone = {event.get("uid") for event in member.events}
        assert uid(3) not in gone
        assert aircraft_uid("") not in gone


def test_an_impossible_event_is_counted_and_delays_nothing():
    member = Member.of_group(GROUP)
    with sharing(f"udp://{GROUP}:{member.port}?interface=127.0.0.1") as link:
        apart = (target(1).clicks[0], target(1, latitude_deg=-48.0).clicks[0])
        link.targets([dataclasses.replace(target(1), clicks=apart), target(2)])
        member.got(lambda event: event.get("uid") == uid(2))
        assert link.status.error == "1 events could not be sent"


def test_changes_are_logged_once_but_no_attempts_and_the_link_ends_at_once():
    reports = []
    CotLink(ViewerConfig(cot="tcp://127.0.0.1"), reports.append).stop()  # never started
    link = CotLink(ViewerConfig(cot=f"tcp://127.0.0.1:{free_port()}"), reports.append)
    link.start()
    link.share(on=True)
    wait_until(lambda: link.status.error)
    time.sleep(2.5)  # one or two attempts more
    assert len(reports) == 1
    assert "is the TAK server running" in reports[0]
    link.stop()
    assert not link._thread.is_alive()

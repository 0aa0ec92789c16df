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
"""viewer_node in a real graph: a page's clicks become targets that are drawn in the pictures."""

from __future__ import annotations

import asyncio
import math
import os
import re
import signal
import socket
from concurrent.futures import ThreadPoolExecutor

import av
import numpy as np
import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

import dataclasses
import threading
import time

from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import KeptLog, await_words
from klv_reader import live_packet
from overlay_flight import MESSAGES, Flight, write_map
from overlays import PLANE, SQUARE_N, pose_at
from page_clients import Page, next_picture
from project import child_of, free_port
from sensor_msgs.msg import Image
from std_msgs.msg import String
from visualization_msgs.msg import MarkerArray

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Located, Refusal
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages import targets_of
from tirgeo_ros.io.messages.pictures import image_pixels
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.nodes import recordings
from tirgeo_ros.nodes.graph_node import latched
from tirgeo_ros.nodes.recordings import Recordings
from tirgeo_ros.nodes.viewer_node import PageBackend, lost_clicks, taken_ns
from tirgeo_ros.page.actions import Click

pytestmark = pytest.mark.graph

NORTH = {"uav1": 0.0, "uav2": -7.0}  # where each stands, m
APART_N = np.array([NORTH["uav2"] - NORTH["uav1"], 0.0, 0.0])
MARKER_BGR = (255, 80, 255)
MARKED_PX = 6  # half the diamond, and the brush


@pytest.fixture
def start(spawn, tmp_path):
    """Start the page of both aircraft; return its process and address."""

    def page(**more):
        values = more | {"namespaces": "uav1,uav2", "listen": "127.0.0.1:0"}
        values |= {"targets": tmp_path / "targets.gpkg", "record_to": tmp_path / "recordings"}
        words = [word for name, value in values.items() for word in ("-p", f"{name}:={value}")]
        node = spawn("viewer_node", *words)
        await_words(node, "ready")
        outcome = re.search(r"the page is at (http://\S+)/", node.text())
        assert outcome, node.text()
        return node, outcome[1]

    return page


@pytest.mark.parametrize(("late_s", "own"), [(0.04, True), (59, True), (-0.5, False), (61, False)])
def test_a_stamp_of_another_clock_is_no_age(late_s, own):
    """A camera's clock ahead of this one gave pictures that came before they were taken."""
    now_ns = 1_700_000_000_000_000_000
    stamp_ns = now_ns - round(late_s * 1e9)
    assert taken_ns(stamp_ns, now_ns) == (stamp_ns if own else now_ns)


class Fleet:
    """Two cameras that stand still, and a page that looks at both.

    ``overlay`` starts an aircraft's overlay_node, a process.
    """

    def __init__(self, stranger, overlay) -> None:
        self.stranger = stranger
        self.overlays = {name: overlay(name) for name in NORTH}
        self.overlay = overlay
        self.flights = {name: Flight(stranger, f"{name}/", north) for name, north in NORTH.items()}
        self._pool = ThreadPoolExecutor(1)

    def until(self, done) -> None:
        def stepped() -> bool:
            for flight in self.flights.values():
                flight.step()
            return done()

        self.stranger.spin_until(stepped)

    def browse(self, url, browsing):
        """Return what ``browsing(page, states)`` returns while the flights go on."""

        async def browse():
            async with Page(url) as page, page.state() as states:
                return await browsing(page, states)

        result = self._pool.submit(asyncio.run, browse())
        self.until(result.done)
        return result.result()

    def pictures(self, name) -> list[Image]:
        return self.stranger.received[f"{name}/tirgeo/overlay/image"]


@pytest.fixture
def fleet(spawn, meet, tmp_path, request):
    write_map(tmp_path / "map.geojson", SQUARE_N)
    given = ["-p", f"map:={tmp_path / 'map.geojson'}", "-p", "ground_height_m:=25.0"]
    given += [word for item in getattr(request, "param", ()) for word in ("-p", item)]

    def overlay(name):
        node = spawn("overlay_node", *given, "-r", f"__ns:=/{name}")
        await_words(node, "ready")
        return node

    topics = {f"{name}/tirgeo/overlay/image": Image for name in NORTH}
    stranger = meet(**topics, **{"/diagnostics": DiagnosticArray})
    # Latched, as they are published: a list that came before the nodes had met comes too.
    for topic, kind in {"targets/markers": MarkerArray, "targets": String}.items():
        name = f"uav2/tirgeo/{topic}"
        stranger.node.create_subscription(kind, name, stranger.received[name].append, latched(10))
    return Fleet(stranger, overlay)


def pixel_of(point_n, name):
    """Where a point (3,), NED, is in an aircraft's picture."""
    pose = pose_at(0, NORTH[name])
    return XT2.project((point_n - pose.position_n)[None] @ matrix_from_quat(pose.q_nc))[0][0]


async def clicked(page, states, name, uv, **more):
    """The answer to a click on a picture that shows the map; a busy machine may need a second."""
    async with page.session.ws_connect(f"{page.url}/video/{name}") as video:
        while True:
            stamp_ns, _ = await next_picture(video)
            answer = await states.click(stamp_ns, *map(float, uv), aircraft=name, **more)
            if answer["ok"] or not re.search(_NOT_YET, answer.get("reason", "")):
                return answer


#: Also overlay_node's subscription may be found after its pictures.
_NOT_YET = "pose|did not answer|does not run"


def off_m(target, point_n) -> float:
    """How far a target is from a point, as a multiple of its 95 % ellipse's radius there."""
    place = math.radians(target["latitude_deg"]), math.radians(target["longitude_deg"])
    north, east, _ = PLANE.ned_from_geodetic(*place, target["height_m"]) - point_n
    ellipse = target["ellipse"]
    azimuth = math.radians(ellipse["azimuth_deg"])
    along = north * math.cos(azimuth) + east * math.sin(azimuth)
    across = east * math.cos(azimuth) - north * math.sin(azimuth)
    return math.hypot(along / ellipse["major_m"], across / ellipse["minor_m"])


def marked(picture: Image, uv) -> bool:
    """Whether a marker is drawn there."""
    near = np.abs(image_pixels(picture).astype(int) - MARKER_BGR).max(axis=2) < 40
    v, u = np.nonzero(near)
    return len(u) > 0 and np.hypot(u - uv[0], v - uv[1]).min() < MARKED_PX


def test_clicks_on_two_aircraft_become_targets_in_every_picture(fleet, start):
    node, url = start()
    corner_n = SQUARE_N[0]
    fleet.until(lambda: fleet.stranger.node.count_publishers("uav2/tirgeo/targets"))
    first = fleet.browse(url, lambda p, s: clicked(p, s, "uav1", pixel_of(corner_n, "uav1")))
    assert first["ok"], first
    assert off_m(first["target"], corner_n) < 1
    assert (first["target"]["aircraft"], first["target"]["number"]) == ("uav1", 1)
    # Drawn from now on, by both aircraft, each where it is in its own picture.
    for name in NORTH:
        uv = pixel_of(corner_n, name)
        fleet.until(lambda name=name, uv=uv: any(marked(p, uv) for p in fleet.pictures(name)[-1:]))
    what_others_read_of_a_target(fleet, first["target"])
    # The same pixel of the other aircraft is another place.
    uv = pixel_of(corner_n, "uav1")
    other = fleet.browse(url, lambda p, s: clicked(p, s, "uav2", uv))["target"]
    there_n = corner_n + APART_N
    assert off_m(other, there_n) < 1 < off_m(other, corner_n)
    refused = fleet.browse(url, lambda p, s: clicked(p, s, "uav1", (-5.0, 3.0)))
    assert refused["reason"] == "the pixel is outside the picture"
    the_map_shows_where_a_target_is(fleet, url, first["target"])
    an_aircrafts_state_is_its_own(fleet, url)
    an_overlay_that_begins_again_draws_the_targets(fleet)
    a_killed_node_has_all_targets_when_it_is_back(fleet, node, start, first["target"], other)


def what_others_read_of_a_target(fleet, target):
    """RViz markers, and programs JSON; both of the newest list."""
    marks, texts = (
        fleet.stranger.received[f"uav2/tirgeo/targets{end}"] for end in ("/markers", "")
    )
    fleet.until(lambda: marks and len(marks[-1].markers) == 3)
    fleet.until(lambda: texts and targets_of(texts[-1]))
    (sent,) = targets_of(texts[-1])
    assert (sent.id, sent.label) == (target["id"], marks[-1].markers[1].text)
    assert sent.place.latitude_deg == target["latitude_deg"]


def the_map_shows_where_a_target_is(fleet, url, target):
    async def where(_, states):
        place = {name: target[name] for name in ("latitude_deg", "longitude_deg")}
        while True:  # the first footprint comes within a second
            outcome = await states.ask("where", aircraft="uav2", **place)
            if outcome["ok"]:
                return outcome

    outcome = fleet.browse(url, where)
    np.testing.assert_allclose(
        [outcome["u"], outcome["v"]], pixel_of(SQUARE_N[0], "uav2"), atol=0.5
    )


def an_aircrafts_state_is_its_own(fleet, url):
    async def state(_, states):
        return await states.until("state", lambda s: s["aircraft"] == "uav2" and whole(s))

    def whole(said):  # once a second: whether there is a map, and the rate of the second before
        return said["footprint"] and said["no_map"] is not None and said["video_hz"] > 0

    reports = fleet.browse(url, state)
    assert reports["navigation"] == {"state": "waiting", "reason": "ekf_node does not report"}
    assert reports["no_map"] == ""
    assert reports["position"] is None
    assert reports["recording"] is False
    place = np.radians(np.mean(reports["footprint"], axis=0))
    middle_n = PLANE.ned_from_geodetic(*place, PLANE.height_m)
    assert abs(middle_n[1]) < 10  # to the north of the aircraft, which looks there
    assert middle_n[0] > 0


def an_overlay_that_begins_again_draws_the_targets(fleet):
    fleet.overlays["uav2"].signal(signal.SIGKILL)
    fleet.overlays["uav2"].wait(5)
    fleet.overlay("uav2")
    fleet.pictures("uav2").clear()
    uv = pixel_of(SQUARE_N[0], "uav2")
    fleet.until(lambda: fleet.pictures("uav2") and marked(fleet.pictures("uav2")[-1], uv))


def a_killed_node_has_all_targets_when_it_is_back(fleet, node, start, first, second):
    node.signal(signal.SIGKILL)
    node.wait(5)
    fleet.pictures("uav1").clear()
    uv = pixel_of(SQUARE_N[0], "uav1")
    # overlay_node keeps them; on a busy machine a picture may have no pose, and so no marks
    fleet.until(lambda: fleet.pictures("uav1") and marked(fleet.pictures("uav1")[-1], uv))
    _, url = start()

    async def delete(_, states):
        reports = await states.until("targets")
        assert [item["id"] for item in reports["targets"]] == [first["id"], second["id"]]
        was = {key: first[key] for key in ("name", "kind", "note")}
        return await states.ask("delete", id=first["id"], was=was)

    assert fleet.browse(url, delete)["ok"]
    fleet.until(lambda: not marked(fleet.pictures("uav1")[-1], uv))
    # In a new plane the other one is where it was.
    moved = TangentPlane(PLANE.latitude_rad + 5e-7, PLANE.longitude_rad, PLANE.height_m)
    offset_n = PLANE.ned_from_geodetic(moved.latitude_rad, moved.longitude_rad, moved.height_m)
    fleet.flights["uav1"].origin.publish(MESSAGES.origin(moved, 0))
    there_n = SQUARE_N[0] + APART_N - offset_n
    fleet.until(lambda: marked(fleet.pictures("uav1")[-1], pixel_of(there_n, "uav1")))


@pytest.mark.slow
def test_recordings_that_are_killed_can_be_read(fleet, start, tmp_path):
    """The recorder alone, then the whole node: then its children complete their files."""
    node, url = start()

    async def record(_, states):
        answer = await states.ask("record", aircraft="uav1", on=True)
        await states.until("state", lambda s: s["aircraft"] == "uav1" and s["recording"])
        return answer

    async def ended(_, states):
        reports = await states.until(
            "state", lambda s: s["aircraft"] == "uav1" and not s["recording"]
        )
        return reports["findings"]

    assert fleet.browse(url, record)["text"].startswith("recording to ")
    (first,) = (tmp_path / "recordings").glob("uav1-*.mcap")
    video = first.with_suffix(".ts")
    fleet.until(lambda: video.exists() and video.stat().st_size > 0 and first.stat().st_size > 1e6)
    os.kill(child_of(node.pid, "'recorder'"), signal.SIGKILL)
    (finding,) = fleet.browse(url, ended)
    assert "recorder ended (exit code -9)" in finding["evidence"]
    assert "the file ends early" in BagReader(first).damage
    assert len(list(BagReader(first).messages(["/uav1/tirgeo/overlay/image/compressed"]))) > 5
    with av.open(str(video)) as film:
        assert len(list(film.decode(video=0))) > 0
    fleet.browse(url, record)
    second = max((tmp_path / "recordings").glob("uav1-*.mcap"))
    assert second != first
    fleet.until(lambda: second.stat().st_size > 1e5)
    node.signal(signal.SIGKILL)
    fleet.until(lambda: BagReader(second).damage is None)
    assert "/uav1/tirgeo/camera_pose" in BagReader(second).topics()


def recording_findings(state) -> list[str]:
    return [item["evidence"] for item in state["findings"] if item["subject"] == "recording"]


@pytest.mark.slow
def test_a_killed_node_goes_on_as_it_was_and_a_stopped_one_begins_anew(fleet, start, tmp_path):
    corner = pixel_of(SQUARE_N[0], "uav1")

    async def switch_on(page, states):
        answer = await clicked(page, states, "uav1", corner)
        assert answer["ok"], answer
        await states.ask("record", aircraft="uav1", on=True)
        await states.ask("share", on=True)
        return answer["target"]

    def state(url, good=lambda _: True):
        async def until(_, states):
            is_ours = {"type": "state", "aircraft": "uav1"}.items()
            reports = await states.until("state", lambda s: is_ours <= s.items() and good(s))
            return reports, (await states.until("targets"))["targets"]

        return fleet.browse(url, until)

    def bags():
        return sorted((tmp_path / "recordings").glob("uav1-*.mcap"))

    with socket.create_server(("127.0.0.1", 0)) as team:
        cot = f"tcp://127.0.0.1:{team.getsockname()[1]}"
        node, url = start(cot=cot)
        target = fleet.browse(url, switch_on)
        links = [team.accept()[0]]
        for number in (1, 2):
            fleet.until(lambda n=number: len(bags()) == n and bags()[-1].stat().st_size > 1e5)
            node.signal(signal.SIGKILL)
            node.wait(5)
            node, url = start(cot=cot)
            on, targets = state(url, lambda s: s["recording"] and s["sharing"]["connected"])
            assert targets == [target]
            assert not recording_findings(on)
            links.append(team.accept()[0])
            assert target["id"].encode() in links[-1].recv(10_000)
        fleet.until(lambda: len(bags()) == 3 and bags()[-1].stat().st_size > 1e5)
        assert "/uav1/thermal/image_raw" in BagReader(bags()[-1]).topics()
        assert [BagReader(bag).damage for bag in bags()[:2]] == [None, None]
        node.signal(signal.SIGKILL)
        node, url = start(cot=cot, least_free_gb=1e4)
        off, _ = state(url, recording_findings)
        (evidence,) = recording_findings(off)
        ended = "the recording has failed: it ended when viewer_node was killed; "
        assert evidence.startswith(f"{ended}not recorded: ")
        assert "GB are free; make room on this disk" in evidence
        node.signal(signal.SIGINT)
        assert node.wait(30).exit_code == 0
    store = TargetStore(tmp_path / "targets.gpkg")
    assert (len(store.all()), store.switched_on()) == (1, [])
    store.close()


@pytest.mark.slow
@pytest.mark.parametrize("fleet", [["confidence.ground_sigma_m:=3.0"]], indirect=True)
def test_the_live_stream_says_where_a_click_in_its_middle_would_be(fleet, start):
    address = f"udp://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    _, url = start(stream=address)
    watched = ThreadPoolExecutor(1).submit(live_packet, address)
    fleet.until(watched.done)
    values = watched.result()
    middle = (XT2.width - 1) / 2, (XT2.height - 1) / 2
    target = fleet.browse(url, lambda p, s: clicked(p, s, "uav1", middle))["target"]
    centre = float(values[23]), float(values[24])
    # The step of 32 bits is 84e-9 deg at most.
    assert centre == pytest.approx((target["latitude_deg"], target["longitude_deg"]), abs=1e-7)
    assert 0 < float(values[45]) < 2 * target["ellipse"]["major_m"]
    # overlay_node's sigma of the ground, to half a step of 4095 m / 65535.
    assert float(values[46]) == pytest.approx(1.645 * 3.0, abs=0.032)
    assert values[10] == "uav1"


def test_lost_clicks_are_a_finding_with_the_targets_numbers():
    assert lost_clicks([]) == []
    (outcome,) = lost_clicks([4, 7])
    assert outcome.line.startswith("the file has lost clicks of targets 4, 7: viewer_node targets")


CLICK = Click("uav1", 7, 1.5, 2.5)
PLACE = (48.0, 16.0, 190.0, (1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0))


class Aircraft:
    """Counts clicks, and answers the ``after``-th from another thread, as the graph does."""

    def __init__(self, after=1, listens=True):
        self.after, self.listens, self.clicks = after, listens, []
        self.answer = lambda _: None

    def click(self, *click):
        self.clicks.append(click)
        if len(self.clicks) == self.after:
            threading.Thread(target=self.answer, args=(click,)).start()
        return self.listens


def backend_with(aircraft, *answers):
    backend = PageBackend({"uav1": aircraft, "uav2": aircraft}, None, None, None, None)

    def give(_):
        for name, answer in answers:
            backend.answered(name, answer)

    aircraft.answer = give
    return backend


def located(**fields):
    return dataclasses.replace(Located(7, *PLACE, uv=(1.5, 2.5)), **fields)


def test_a_click_gets_the_answer_of_its_stamp_pixel_and_aircraft():
    others = [
        ("uav2", located(latitude_deg=1.0)),
        ("uav1", located(stamp_ns=8, latitude_deg=2.0)),
        ("uav1", located(uv=(1.25, 2.5), latitude_deg=3.0)),
    ]
    backend = backend_with(Aircraft(), *others, ("uav1", located()))
    assert asyncio.run(backend.click(CLICK)) == located()


def test_a_click_that_is_lost_is_sent_again_once():
    aircraft = Aircraft(after=2)
    backend = backend_with(aircraft, ("uav1", located()))
    assert asyncio.run(backend.click(CLICK)) == located()
    assert aircraft.clicks == [(7, 1.5, 2.5)] * 2


def test_a_refusal_says_why():
    aircraft = Aircraft()
    refused = Refusal(7, (1.5, 2.5), Reason.OUTSIDE_PICTURE)
    words = asyncio.run(backend_with(aircraft, ("uav1", refused)).click(CLICK))
    assert words == "the pixel is outside the picture"
    silent = backend_with(Aircraft(after=9))
    assert "did not answer" in asyncio.run(silent.click(CLICK))
    absent = backend_with(Aircraft(after=9, listens=False))
    assert asyncio.run(absent.click(CLICK)) == "the overlay program does not run"


def test_two_who_click_the_same_get_the_same():
    backend = backend_with(Aircraft(after=2), ("uav1", located()))

    async def both():
        return await asyncio.gather(backend.click(CLICK), backend.click(CLICK))

    assert asyncio.run(both()) == [located()] * 2


def test_without_an_address_nothing_is_shared():
    assert "set the parameter cot" in asyncio.run(backend_with(Aircraft()).share(True))


def test_a_full_disk_takes_no_recording(tmp_path):
    node = KeptLog()
    config = ViewerConfig(record_to=str(tmp_path / "new"), least_free_gb=1e4)
    full = Recordings(node, config, {"": ""})
    words = full.begin("")
    assert words.startswith(f"not recorded: {tmp_path / 'new'}: only ")
    assert "make room on this disk" in words
    assert full.end("") == "nothing is being recorded"
    (tmp_path / "file").touch()
    config = ViewerConfig(record_to=str(tmp_path / "file" / "in"))
    blocked = Recordings(node, config, {"": ""})
    assert f"{tmp_path / 'file' / 'in'}: Not a directory" in blocked.begin("")


class Child:
    """A recorder or a video_writer that has begun."""

    fault = ""

    def __init__(self, *begun):
        _, name, values, _ = begun
        values["output"].write_text(f"of {name}")

    def end(self):
        return ""


def test_a_clock_that_was_set_back_costs_no_recording(tmp_path, monkeypatch):
    """As on a computer without a battery for its clock, which begins at the same time each day."""
    node = KeptLog()
    node.count_publishers = lambda _: 0
    monkeypatch.setattr(recordings, "ChildNode", Child)
    monkeypatch.setattr(recordings.time, "gmtime", lambda: time.struct_time((2026,) + (1,) * 8))
    config = ViewerConfig(record_to=str(tmp_path), least_free_gb=0.0)
    old = tmp_path / "uav1-2026-01-01T01-01-01Z.mcap"
    old.write_text("of the flight before")
    assert Recordings(node, config, {"uav1": "/uav1"}).begin("uav1").startswith("recording to ")
    assert old.read_text() == "of the flight before"
    (new,) = {*tmp_path.glob("*.mcap")} - {old}
    assert new.read_text() == "of recorder"

"""The page's questions, answered by way of a graph that is simulated here."""

from __future__ import annotations

import asyncio
import dataclasses
import threading

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import KeptLog

from tirgeo_ros.core.config import ViewerConfig
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Located, Refusal
from tirgeo_ros.nodes.recordings import Recordings
from tirgeo_ros.nodes.viewer_node import PageBackend
from tirgeo_ros.page.actions import Click

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
    recordings = Recordings(node, config, {"": ""})
    words = recordings.begin("")
    assert words.startswith(f"not recorded: {tmp_path / 'new'}: only ")
    assert "make room on this disk" in words
    assert recordings.end("") == "nothing is being recorded"
    (tmp_path / "file").touch()
    config = ViewerConfig(record_to=str(tmp_path / "file" / "in"))
    blocked = Recordings(node, config, {"": ""})
    assert f"{tmp_path / 'file' / 'in'}: Not a directory" in blocked.begin("")

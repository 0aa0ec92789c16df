"""The page of the real nodes while each is stopped: never GO, the cause named, one alarm."""

from __future__ import annotations

import asyncio
import os
import signal
import time

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from flown_page import FlownPage
from page_clients import Page
from project import child_of

pytestmark = [pytest.mark.graph]

#: A second of silence, a look each 0.2 s, a state each 0.2 s; and what a busy machine adds.
LIMIT_S = 1.5 + 1.5
STOPPED = {
    "overlay_node": ("picture", "overlay_node"),
    "gimbal_node": ("camera pose", "gimbal_node"),
    "ekf_node": ("position", "ekf_node"),
    "bag_player": ("position", "imu/data"),
}


@pytest.fixture
def demo(tmp_path):
    page = FlownPage(tmp_path, "demo", "--page", "127.0.0.1:0", "-o", tmp_path / "demo")
    yield page
    page.close()


async def said(states, condition):
    """The next state whose verdict meets a condition, and when it came."""
    while True:
        state = await states.until("state")
        if condition(state["verdict"]):
            return state, time.monotonic()


async def stopped(states, process, kind, cause):
    """Stop a process until its silence and the cause are said, then let it go on to GO."""
    await said(states, lambda verdict: verdict["word"] == "GO")
    begin_s = time.monotonic()
    os.kill(process, signal.SIGSTOP)
    try:
        first, end_s = await said(states, lambda verdict: verdict["word"] != "GO")
        assert (first["verdict"]["word"], first["verdict"]["kind"]) == ("NO DATA", kind)
        assert first["verdict"]["alarm"]
        assert end_s - begin_s < LIMIT_S
        named, _ = await said(states, lambda verdict: verdict["more"].startswith(cause))
        assert named["verdict"]["kind"] == kind  # else the alarm would begin anew
    finally:
        os.kill(process, signal.SIGCONT)


def test_a_stopped_node_ends_go_at_once_and_is_named(demo):
    """With overlay_node stopped for 9 s the verdict was GO, and nothing was found wrong."""
    url = demo.url.rstrip("/")

    async def browse():
        async with Page(url) as page, page.state() as states:
            for name, (kind, cause) in STOPPED.items():
                process = child_of(demo.pid, name)
                await stopped(states, process, kind, cause)

    asyncio.run(browse())

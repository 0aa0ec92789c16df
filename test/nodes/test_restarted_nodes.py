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
"""``tirgeo demo --page`` goes on, whichever of its nodes is killed or halted; its page says so."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import time
import urllib.request
from contextlib import suppress
from urllib.error import URLError

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from commands import Command
from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import Stranger
from page_clients import Page
from project import child_of, free_port

from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.tools.graph.node_graph import free_domain

pytestmark = pytest.mark.graph

NODES = ("viewer_node", "overlay_node", "gimbal_node", "ekf_node", "bag_player")
RECOVERS_S = 90.0  # a node's start, the filter's alignment, the rest of a round of the bag
HALT_S = 5.0
#: A second of silence, a look each 0.2 s, a state each 0.2 s are 1.5 s (test_aircraft_verdict.py
#: holds them). With what a busy machine adds it is half of the 9 s for which GO once stood.
LIMIT_S = 4.5
FLOWN_S = 10.0, 20.0  # of the sample's 30
STOPPED = {
    "overlay_node": ("picture", "overlay_node"),
    "gimbal_node": ("camera pose", "gimbal_node"),
    "ekf_node": ("position", "ekf_node"),
    "bag_player": ("position", "imu/data"),
}


@pytest.fixture
def demo(tmp_path):
    words = ("demo", "--page", f"127.0.0.1:{free_port()}", "-o", tmp_path / "demo")
    page = Command(tmp_path, *words, ROS_DOMAIN_ID=str(free_domain()))
    yield page
    page.close()


@pytest.fixture
def stranger(demo):
    assert demo.url
    domain = int(re.search(r"ROS_DOMAIN_ID=(\d+)", demo.log)[1])
    made = Stranger(domain, {"/diagnostics": DiagnosticArray})
    yield made
    made.close()


def await_map(stranger):
    """Wait until one overlay_node has drawn the map in more pictures from one item to the next."""
    heard = stranger.received["/diagnostics"]
    heard.clear()
    numbers = []

    def drawn():
        item = stranger.diagnostic("/overlay_node: overlay")
        heard.clear()
        if "drawn" in item:
            numbers.append(int(item["drawn"]))
        return len(numbers) > 1 and numbers[-1] > numbers[-2]

    stranger.spin_until(drawn, RECOVERS_S)
    stranger.spin_until(lambda: stranger.diagnostic("/overlay_node: set-up"))


def answers(url):
    with suppress(URLError), urllib.request.urlopen(url, timeout=30) as answer:
        return answer.status == 200


@pytest.mark.slow
@pytest.mark.parametrize("ends", [True, False])
def test_the_page_has_its_map_again_after_each_node_was_killed_or_halted(demo, stranger, ends):
    await_map(stranger)
    for name in NODES:
        before = child_of(demo.pid, f"'{name}'")
        os.kill(before, signal.SIGKILL if ends else signal.SIGSTOP)
        end_s = time.monotonic() + HALT_S
        stranger.spin_until(lambda end_s=end_s: time.monotonic() > end_s)
        if not ends:
            os.kill(before, signal.SIGCONT)
        await_map(stranger)
        assert (child_of(demo.pid, f"'{name}'") != before) is ends
        assert (f"{name} ended (exit code -9)" in demo.log) is ends
        stranger.spin_until(lambda: answers(demo.url), RECOVERS_S)
    # Of what came after its own start, once the last one's state has come.
    after = {"restarts_of_ekf_node", "restarts_of_gimbal_node"} if ends else set()

    def result():
        checks = stranger.diagnostic("/overlay_node: set-up")
        return {name for name in checks if name.startswith(("restarts_", "publishers_"))}

    stranger.spin_until(lambda: result() == after, RECOVERS_S)


async def text(states, condition):
    """The next state that meets a condition, and when it came."""
    while not condition(state := await states.until("state")):
        pass
    return state["verdict"], time.monotonic()


async def stopped(states, process, kind, cause, start_ns):
    """Stop a process until its silence and the cause are said, then let it go on to GO.

    In the middle of the flight: where it begins anew LOST or NO MAP may come first.
    """
    await text(
        states,
        lambda state: (
            state["verdict"]["word"] == "GO"
            and FLOWN_S[0] < (int(state["stamp_ns"]) - start_ns) * 1e-9 < FLOWN_S[1]
        ),
    )
    begin_s = time.monotonic()
    os.kill(process, signal.SIGSTOP)
    try:
        first, end_s = await text(states, lambda state: state["verdict"]["word"] != "GO")
        assert end_s - begin_s < LIMIT_S
        assert (first["word"], first["kind"], first["alarm"]) == ("NO DATA", kind, True)
        named, _ = await text(states, lambda state: state["verdict"]["more"].startswith(cause))
        assert named["kind"] == kind  # else the alarm would begin anew
    finally:
        os.kill(process, signal.SIGCONT)


@pytest.mark.slow  # test_aircraft_verdict.py holds the same verdicts in seconds, without the graph
def test_a_stopped_node_ends_go_at_once_and_is_named(demo, sample):
    """With overlay_node stopped for 9 s the verdict was GO, and nothing was found wrong."""
    url, (start_ns, _) = demo.url, BagReader(sample / "flight.mcap").span_ns

    async def browse():
        async with Page(url) as page, page.state() as states:
            for name, (kind, cause) in STOPPED.items():
                process = child_of(demo.pid, f"'{name}'")
                await stopped(states, process, kind, cause, start_ns)

    asyncio.run(browse())

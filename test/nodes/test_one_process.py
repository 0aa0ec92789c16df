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
"""``tirgeo run``: the whole graph in one process, as other processes see it."""

from __future__ import annotations

import asyncio
import os
import re
import signal
import socket
import time
from contextlib import closing, suppress
from itertools import takewhile

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from commands import Command
from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import deep_queues, stamps_of
from nav_msgs.msg import Odometry
from page_clients import Page
from project import child_of, free_port, reader_of
from sensor_msgs.msg import CompressedImage

from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.messages import stamp_ns
from tirgeo_ros.io.targets.store import TargetStore

pytestmark = pytest.mark.graph

#: Enough for the filter to align and for some pictures with the map.
PLAYED_NS = 5_000_000_000


@pytest.fixture
def start(tmp_path):
    runs = []

    def begin(*arguments: object) -> Command:
        runs.append(Command(tmp_path / f"run{len(runs)}", "run", *arguments))
        return runs[-1]

    yield begin
    for run in runs:
        run.process.kill()
        run.process.wait()


@pytest.fixture
def short_bag(sample, tmp_path):
    """The sample's first seconds, with pictures."""
    reader, path = BagReader(sample / "flight.mcap"), tmp_path / "short.mcap"
    end_ns = reader.span_ns[0] + PLAYED_NS
    with BagWriter(path) as writer:
        for item in takewhile(lambda one: one.log_time_ns < end_ns, reader.messages()):
            writer.write(item.topic, item.typename, item.data, item.log_time_ns)
    return path


def test_a_bag_goes_through_and_others_see_each_message_once(
    start, meet, sample, short_bag, tmp_path
):
    params = tmp_path / "params.yaml"
    params.write_text((sample / "params.yaml").read_text() + deep_queues())
    stranger = meet(
        tirgeo__overlay__image__compressed=CompressedImage,
        tirgeo__odometry=Odometry,
        **{"/diagnostics": DiagnosticArray},
    )
    run = start("--bag", short_bag, "--params", params, "--map", sample / "map.geojson")
    stranger.spin_until(lambda: run.process.poll() is not None, 120.0)
    assert run.ended() == 0, run.log
    # The stranger may have met the nodes late; from then on it misses none.
    poses = [stamp_ns(message) for message in stranger.received["tirgeo/odometry"]]
    assert poses
    assert poses == stamps_of(short_bag, "/imu/data")[-len(poses) :]
    # A frame may wait for its pose so long that a newer one replaces it, but none is lost.
    pictures = [stamp_ns(one) for one in stranger.received["tirgeo/overlay/image/compressed"]]
    frames = stamps_of(short_bag, "/thermal/image_raw/compressed")
    assert pictures == [stamp for stamp in frames if stamp in pictures] != []
    overlay = stranger.diagnostic("/overlay_node: overlay")
    assert overlay["frames_sent"] == str(len(frames))
    assert overlay["frames_missed"] == "0"
    # All nodes run by the bag's clock, though one alone listens to it.
    first_ns, last_ns = BagReader(short_bag).span_ns
    newest = {a.status[0].name: stamp_ns(a) for a in stranger.received["/diagnostics"]}
    nodes = {name.partition(":")[0] for name in newest}
    assert nodes == {"/ekf_node", "/gimbal_node", "/overlay_node", "/bag_player"}
    assert all(first_ns < stamp <= last_ns for stamp in newest.values())


@pytest.mark.slow
def test_a_page_that_is_killed_is_started_again_and_takes_nothing_along(start, meet):
    address = f"0.0.0.0:{free_port()}"
    stranger = meet(**{"/diagnostics": DiagnosticArray})
    run = start("--no-dji", "--page", address)
    run.await_ready()

    def reports_of_the_page() -> int:
        items = (one for array in stranger.received["/diagnostics"] for one in array.status)
        return sum(one.name == "/viewer_node: topics" for one in items)

    stranger.spin_until(lambda: reports_of_the_page() > 5)  # overlay_node has heard it too
    os.kill(child_of(run.process.pid, "'viewer_node'"), signal.SIGKILL)
    run.await_ready(5)
    first, second = re.findall(r"the page is at (\S+)", run.log)
    assert first == second  # with its token
    assert "viewer_node ended (exit code -9): started again in 2 s" in run.log
    run.process.send_signal(signal.SIGINT)
    assert run.ended() == 0, run.log


@pytest.mark.slow
def test_what_the_page_switched_on_goes_on_after_the_graph_is_killed(start, tmp_path):
    """The page's process then gets SIGTERM of the kernel, and completes its files."""
    targets, params = tmp_path / "targets.gpkg", tmp_path / "params.yaml"
    values = f"targets: {targets}, record_to: {tmp_path / 'bags'}"
    params.write_text(f"viewer_node: {{ros__parameters: {{{values}}}}}\n")

    async def switch_on(url):
        async with Page(url) as page, page.state() as states:
            await states.ask("record", aircraft="", on=True)
            await states.ask("share", on=True)
            await states.until("state", lambda state: state["sharing"]["connected"])

    def switched_on(run, number):
        page = child_of(run.process.pid, "'viewer_node'")
        run.process.send_signal(number)
        run.ended()
        await_end(page)
        with closing(TargetStore(targets)) as store:
            return sorted(store.switched_on())

    with socket.create_server(("127.0.0.1", 0)) as team:
        team.settimeout(60)
        cot = f"tcp://127.0.0.1:{team.getsockname()[1]}"
        words = ("--no-dji", "--page", "127.0.0.1:0", "--params", params, "--cot", cot)
        run = start(*words)
        run.await_ready()
        asyncio.run(switch_on(run.url))
        links = [team.accept()[0]]
        assert switched_on(run, signal.SIGKILL) == ["record ", "share"]
        run = start(*words)
        links.append(team.accept()[0])
        run.await_line(r"recording to (\S+\.mcap) and")
        assert switched_on(run, signal.SIGINT) == []
    assert len(list((tmp_path / "bags").glob("*.mcap"))) == 2


@pytest.mark.slow
def test_a_stop_signal_ends_all(start, sample):
    """SIGKILL too, which no process can answer: the reader of the map ends with its parent."""
    codes = {signal.SIGINT: 0, signal.SIGTERM: 0, signal.SIGKILL: -signal.SIGKILL}
    words = ("--no-dji", "--map", sample / "map.geojson", "--page", "127.0.0.1:0")
    runs = {number: start(*words, "--namespace", number.name.lower()) for number in codes}
    for number, run in runs.items():
        run.await_ready()
        processes = reader_of(run.process.pid), child_of(run.process.pid, "'viewer_node'")
        run.process.send_signal(number)
        assert run.ended() == codes[number], run.log
        assert "Traceback" not in run.log
        for process in processes:
            await_end(process)


def await_end(pid: int) -> None:
    """Wait until a process that is not a child of this one is gone."""
    end_s = time.monotonic() + 30
    with suppress(ProcessLookupError):
        while time.monotonic() < end_s:
            os.kill(pid, 0)
            time.sleep(0.05)
        pytest.fail(f"process {pid} runs on")


@pytest.mark.slow
def test_a_node_that_dies_ends_the_others(start, flight_bag, tmp_path):
    """At its start, or later: the player reads the damaged part of a bag after seconds."""
    damaged, wrong = tmp_path / "damaged.mcap", tmp_path / "wrong.yaml"
    data = flight_bag.read_bytes()
    damaged.write_bytes(data[: len(data) * 3 // 4])
    wrong.write_text("/**/gimbal_node: {ros__parameters: {composition: so_so}}")
    busy = socket.create_server(("127.0.0.1", 0))
    page = f"127.0.0.1:{busy.getsockname()[1]}"
    runs = {
        start("--bag", damaged): "damaged.mcap: ",
        start("--no-dji", "--params", wrong): "wrong.yaml: parameter composition: ",
    }
    taken = start("--no-dji", "--page", page)
    assert taken.ended() == 1
    assert f"viewer_node: listen: {page}: Address already in use" in taken.log
    busy.close()
    for run, reason in runs.items():
        assert run.ended() == 1
        last = run.log.splitlines()[-1]
        assert last.startswith("tirgeo run: ")
        assert reason in last

"""``tirgeo run``: the whole graph in one process, as other processes see it."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from itertools import takewhile
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from diagnostic_msgs.msg import DiagnosticArray
from graph_helpers import deep_queues, stamps_of
from nav_msgs.msg import Odometry
from project import child_of, reader_of
from sensor_msgs.msg import CompressedImage

from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.messages import stamp_ns

pytestmark = pytest.mark.graph

#: Enough for the filter to align and for some pictures with the map.
PLAYED_NS = 5_000_000_000


class Run:
    """The command as a process, with its output in a file."""

    def __init__(self, log: Path, *arguments: object) -> None:
        self.log = log
        command = [sys.executable, "-m", "tirgeo_ros.tools.cli.main", "run", *map(str, arguments)]
        folder = log.with_suffix("")  # for the page's targets
        folder.mkdir()
        with log.open("w") as file:
            self.process = subprocess.Popen(command, stdout=file, stderr=file, cwd=folder)

    def await_ready(self, nodes: int = 4) -> None:
        end_s = time.monotonic() + 60
        while self.log.read_text().count("]: ready") < nodes:
            assert self.process.poll() is None, self.log.read_text()
            assert time.monotonic() < end_s, self.log.read_text()
            time.sleep(0.05)

    def ended(self) -> int:
        return self.process.wait(60)


@pytest.fixture
def start(tmp_path):
    runs = []

    def begin(*arguments: object) -> Run:
        runs.append(Run(tmp_path / f"run{len(runs)}.log", *arguments))
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
    assert run.ended() == 0, run.log.read_text()
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
    assert nodes == {"/ekf_node", "/gimbal_node", "/overlay_node"}
    assert all(first_ns < stamp <= last_ns for stamp in newest.values())


def test_a_page_that_is_killed_is_started_again_and_takes_nothing_along(start, meet):
    with socket.create_server(("127.0.0.1", 0)) as free:
        address = f"0.0.0.0:{free.getsockname()[1]}"
    stranger = meet(**{"/diagnostics": DiagnosticArray})
    run = start("--no-dji", "--page", address)
    run.await_ready()

    def page_is_heard() -> bool:
        return bool(stranger.diagnostic("/viewer_node: topics"))

    stranger.spin_until(page_is_heard)
    os.kill(child_of(run.process.pid, "'viewer_node'"), signal.SIGKILL)
    run.await_ready(5)
    first, second = re.findall(r"the page is at (\S+)", run.log.read_text())
    assert first == second  # with its token
    assert "viewer_node ended (exit code -9): started again in 2 s" in run.log.read_text()
    check = "restarts_of_viewer_node"
    stranger.spin_until(lambda: check in stranger.diagnostic("/overlay_node: set-up"))
    line = stranger.diagnostic("/overlay_node: set-up")[check]
    assert line.startswith("CAUTION: viewer_node ended and was started again; restarts so far: 1")
    run.process.send_signal(signal.SIGINT)
    assert run.ended() == 0, run.log.read_text()


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
        assert run.ended() == codes[number], run.log.read_text()
        assert "Traceback" not in run.log.read_text()
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
    assert f"viewer_node: listen: {page}: Address already in use" in taken.log.read_text()
    busy.close()
    for run, reason in runs.items():
        assert run.ended() == 1
        last = run.log.read_text().splitlines()[-1]
        assert last.startswith("tirgeo run: ")
        assert reason in last

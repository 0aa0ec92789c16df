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
"""Nodes as processes: they start, refuse what is wrong in one line, and end without accident."""

from __future__ import annotations

import fcntl
import os
import random
import re
import signal
import subprocess
import sys
import time

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words, sockets
from launch_stand_ins import environment_of, launched, loaded, ros_arguments_of
from project import NODES, PROJECT

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.nodes.runner import remove_dead

#: The executor's half second, what DDS takes to say goodbye, and a machine that does other work.
STOP_S = 15.0
#: With the modules still to be loaded, a dozen nodes at a time.
START_AND_STOP_S = 60.0
#: What Fast DDS says where two processes start at the same moment: to learn whether the reader of
#: a port is dead, one takes the port's lock for an instant, and the other cannot make that port.
#: It takes the next one (``test_a_port_whose_lock_another_holds_is_passed_over``).
PORT_TAKEN = re.compile(r".*Failed init_port .*fastrtps_port\d+: open_and_lock_file failed.*\n")

#: What the checks of the set-up say, of errors of the map among others.
CAUTION = re.compile(r".*: CAUTION: .*\n")


@pytest.fixture
def hangs_up():
    """As in a terminal: under nohup SIGHUP is ignored, by what is started here as well."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def ended_cleanly(process, within_s: float = STOP_S) -> None:
    ended = process.wait(within_s)
    assert ended is not None, f"{process.name} runs on for {within_s:g} s"
    assert ended.exit_code == 0, process.log.read_text()
    message_text = CAUTION.sub("", PORT_TAKEN.sub("", process.log.read_text()))
    assert "Traceback" not in message_text
    assert "rror" not in message_text


@pytest.mark.graph
def test_running_nodes_are_reached_from_here_alone_and_stop_on_a_signal(start_idle, hangs_up):
    """The runner takes every signal of every node; each kind is sent to some."""
    processes = [start_idle(name) for name in NODE_CONFIGS]
    for process in processes:
        await_words(process, "ready")
        addresses = sockets(process.pid)
        assert addresses, f"{process.name}: no socket seen: is /proc read right?"
        assert all(item.is_loopback for item in addresses), f"{process.name}: {addresses}"
    halt(processes)
    numbers = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP] * len(processes)
    sent = list(zip(processes, numbers, strict=False))
    for process, number in sent:
        process.signal(number)
    for process, number in sent:
        ended_cleanly(process)
        # Who ended a node is worth knowing where several share a machine.
        assert process.said(f"stopped by {number.name} from process {os.getpid()}")


def halt(processes) -> None:
    """Stop nodes for a while, as by Ctrl-Z and fg or a computer that slept; they live on."""
    for number in (signal.SIGSTOP, signal.SIGCONT):
        for process in processes:
            process.signal(number)
        time.sleep(0.3)  # longer than a node looks away from its signals
    for process in processes:
        process.check_running()
        assert not process.said("stopped by")


@pytest.mark.slow
@pytest.mark.graph
def test_signals_at_any_moment_also_twice(start_idle):
    """Start-up takes about a second: the moments lie before, in and after it."""
    moments = random.Random(7)
    processes = []
    for name in ["ekf_node", "gimbal_node", "overlay_node", "bag_player"] * 3:
        process = start_idle(name)
        time.sleep(moments.uniform(0.0, 1.5))
        number = moments.choice([signal.SIGINT, signal.SIGTERM])
        process.signal(number)
        time.sleep(moments.uniform(0.005, 0.130))
        process.signal(number)
        processes.append(process)
    for process in processes:
        ended_cleanly(process, START_AND_STOP_S)


WRONG = [
    ("ekf_node", "-p publish_rate_hz:=-1.0", "publish_rate_hz: -1 Hz is outside"),
    ("ekf_node", "-p publsh_rate_hz:=1.0", "unknown parameter publsh_rate_hz"),
    ("ekf_node", "-p use_sim_time:=1", "use_sim_time"),
    ("ekf_node", "-p qos_overrides./imu/data.subscription.reliability:=so_so", "so_so"),
    ("ekf_node", "-p qos_overrides./imu/data.subscription.depht:=5", "subscription.depth?"),
    ("ekf_node", "--params-file /nowhere.yaml", "/nowhere.yaml: cannot be read"),
    ("gimbal_node", "-p aircraft.gimbal_pivot_m:=[1,2.0,3]", "with a decimal point"),
    ("overlay_node", "-p map:=a.geojson -p style:=/nowhere.yaml", "/nowhere.yaml"),
    ("bag_player", "", "parameter bag: no bag given"),
    ("bag_player", "-p bag:=/nowhere.mcap", "/nowhere.mcap: cannot be read"),
    ("recorder", "-p output:=/nowhere/a.mcap -p topics:=rtk/fix", "/nowhere/a.mcap"),
    ("recorder", "-p output:=a.mcap -p topics:=rtk/fx", "rtk/fx"),
    ("video_writer", "", "parameter output: nothing to write"),
    ("viewer_node", "-p listen:=here", "parameter listen: 'here' is not HOST:PORT"),
    ("viewer_node", "-p certificate:=a.pem", "https needs both certificate and key"),
    ("viewer_node", "-p targets:=/nowhere/a.gpkg", "/nowhere/a.gpkg"),
    ("viewer_node", "-p stream:=udp:7", "udp:7"),
]


@pytest.mark.slow
@pytest.mark.graph
def test_wrong_arguments_end_in_one_line(spawn):
    started = [(spawn(name, *words.split()), message) for name, words, message in WRONG]
    for process, message in started:
        ended = process.wait(START_AND_STOP_S)
        assert ended is not None, message
        assert ended.exit_code == 1, message
        assert message in process.last_line()
        assert process.last_line().startswith(f"{process.name}: ")
        assert "Traceback" not in process.log.read_text()


@pytest.mark.parametrize(
    ("node", "missing", "remedy"),
    [
        (
            "bag_player",
            "rclpy",
            'source ROS 2 Jazzy (/opt/ros/jazzy/setup.bash), or pip install "tirgeo[ros]"',
        ),
        (
            "bag_player",
            "std_msgs",
            'sudo apt install ros-jazzy-std-msgs, or pip install "tirgeo[ros]"',
        ),
        (
            "overlay_node",
            "cv2",
            "sudo apt install python3-opencv, or pip install opencv-python-headless",
        ),
    ],
)
@pytest.mark.graph
def test_a_node_names_the_package_that_is_missing(node, missing, remedy):
    program = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        f"from tirgeo_ros.nodes.start import start\nsys.exit(start({node!r}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 1
    assert done.stderr == f"{node}: the Python package {missing} is missing: {remedy}\n"


@pytest.mark.slow
@pytest.mark.graph
def test_the_recorder_leaves_a_whole_bag(spawn, tmp_path, flight_bag):
    output = tmp_path / "out.mcap"
    recorder = spawn(
        "recorder", "-p", f"output:={output}", "-p", "topics:=imu/data", "-p", "use_sim_time:=true"
    )
    await_words(recorder, "ready")
    player = spawn("bag_player", "-p", f"bag:={flight_bag}", "-p", "wait_for:=imu/data")
    assert player.wait(60.0).exit_code == 0, player.log.read_text()
    assert BagReader(
        output
    ).damage  # under its name from the start: a kill leaves what was written
    recorder.signal(signal.SIGINT)
    ended_cleanly(recorder)
    played = [m.data for m in BagReader(flight_bag).messages(["/imu/data"])]
    reader = BagReader(output)
    recorded = [m.data for m in reader.messages(["/imu/data"])]
    assert recorded == played[-len(recorded) :]
    # What comes before the first tick of the clock has no time to be written down with.
    assert len(recorded) >= len(played) - 3
    assert reader.damage is None


DEAD, LIVE = "fastrtps_0123456789abcdef", "fastrtps_fedcba9876543210"


def made(folder, *names, age_s=60.0):
    for name in names:
        (folder / name).touch()
        os.utime(folder / name, (time.time() - age_s,) * 2)


def left(folder):
    return sorted(path.name for path in folder.iterdir())


def test_only_a_segment_without_a_lock_goes(tmp_path):
    """Ports stay: the next process may take a dead port's name at any moment."""
    ports = ["fastrtps_port7411", "fastrtps_port7411_el", "sem.fastrtps_port7411_mutex"]
    others = ["fastrtps_0123", "fastrtps_porthole", "sem.other", "lttng-ust-wait-6"]
    held = [LIVE, f"{LIVE}_el"]
    made(tmp_path, DEAD, f"{DEAD}_el", *ports, *others, *held)
    with (tmp_path / f"{LIVE}_el").open() as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert remove_dead(tmp_path) == [DEAD]
        assert left(tmp_path) == sorted([*ports, *others, *held])


def test_a_segment_in_creation_stays(tmp_path):
    made(tmp_path, DEAD, age_s=0.0)
    made(tmp_path, f"{LIVE}_el", age_s=0.0)
    assert remove_dead(tmp_path) == []


def test_links_are_not_followed(tmp_path):
    made(tmp_path, DEAD, "target")
    (tmp_path / f"{DEAD}_el").symlink_to(tmp_path / "target")
    assert remove_dead(tmp_path) == []
    assert left(tmp_path) == sorted([DEAD, f"{DEAD}_el", "target"])


#: rviz2 is no part of the wheels; ``params`` is another word for ``params_file``.
UNTRIED = {"rviz", "params_file", "respawn"}
BY_LAUNCH = {
    "params": f"{PROJECT / 'config' / 'm300_h20t.yaml'},own.yaml",
    "dji": "true",
    "use_sim_time": "false",
    "localhost_only": "true",
    "image": "/flir/image_raw",
    "camera_info": "/flir/info",
    "remap": str(PROJECT / "config" / "mavros.yaml"),
}
ON_BAG = {"params": "own.yaml", "bag": "flight.mcap", "namespace": "uav1"}
BOTH = {
    "map": str(PROJECT / "bags" / "sample" / "map.geojson"),
    "frames": "uav1/",
    "page": "127.0.0.1:0",
    "log_level": "info",
}


@pytest.mark.parametrize("given", [BY_LAUNCH | BOTH, ON_BAG | BOTH])
@pytest.mark.graph
def test_nodes_run_and_end_with_every_launch_argument(
    given, spawn, flight_bag, tmp_path, monkeypatch
):
    own = f"/**/viewer_node: {{ros__parameters: {{targets: {tmp_path / 'targets.gpkg'}}}}}"
    (tmp_path / "own.yaml").write_text(own)
    (tmp_path / "flight.mcap").symlink_to(flight_bag)
    monkeypatch.chdir(tmp_path)
    launch_file = loaded(monkeypatch)
    assert set(launch_file["ARGUMENTS"]) == {*BY_LAUNCH, *ON_BAG, *BOTH, *UNTRIED}
    profiles = {n: v for n, v in environment_of(launch_file, **given).items() if v is not None}
    nodes = launched(launch_file, **given)
    assert set(nodes) == NODES - {"dji_node" if "bag" in given else "bag_player"}
    processes = {
        name: spawn(name, *ros_arguments_of(node, tmp_path), PYTHONFAULTHANDLER="1", **profiles)
        for name, node in nodes.items()
    }
    for name, process in processes.items():
        await_words(process, "played" if name == "bag_player" else "ready")
    for process in processes.values():
        process.signal(signal.SIGINT)
    for process in processes.values():
        ended = process.wait(60.0)
        if ended is None:
            process.signal(signal.SIGABRT)  # it says where its threads are
            process.wait(5.0)
        assert ended is not None, f"{process.name} runs on: {process.text()}"
        assert ended.exit_code == 0, process.text()

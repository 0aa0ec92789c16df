"""Nodes as processes: they start, refuse what is wrong in one line, and end without accident."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tirgeo_ros.io.bags.bag import BagReader

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words

pytestmark = pytest.mark.graph

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


def arguments_of(name: str, folder: Path, bag: Path) -> list[str]:
    return {
        "recorder": ["-p", f"output:={folder / 'out.mcap'}", "-p", "topics:=tirgeo/odometry"],
        "video_writer": ["-p", f"output:={folder / 'out.ts'}"],
        "viewer_node": ["-p", "listen:=127.0.0.1:0", "-p", f"targets:={folder / 'out.gpkg'}"],
        "bag_player": ["-p", f"bag:={bag}", "-p", "wait_timeout_s:=100.0"],
    }.get(name, [])


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
    said = CAUTION.sub("", PORT_TAKEN.sub("", process.log.read_text()))
    assert "Traceback" not in said
    assert "rror" not in said


NODES = [
    *("dji_node", "ekf_node", "gimbal_node", "overlay_node", "viewer_node", "bag_player"),
    *("recorder", "video_writer"),
]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_running_nodes_stop_on_a_signal(spawn, tmp_path, flight_bag, hangs_up, number):
    names = ["recorder"] if number is signal.SIGHUP else NODES
    processes = [spawn(name, *arguments_of(name, tmp_path, flight_bag)) for name in names]
    for process in processes:
        await_words(process, "ready")
    if number is signal.SIGTERM:
        halt(processes)
    for process in processes:
        process.signal(number)
    for process in processes:
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
def test_signals_at_any_moment_also_twice(spawn, tmp_path, flight_bag):
    """Start-up takes about a second: the moments lie before, in and after it."""
    moments = random.Random(7)
    processes = []
    for name in ["ekf_node", "gimbal_node", "overlay_node", "bag_player"] * 3:
        process = spawn(name, *arguments_of(name, tmp_path, flight_bag))
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
    ("missing", "distribution", "remedy"),
    [
        (
            "rclpy",
            "",
            "source ROS 2 Jazzy (/opt/ros/jazzy/setup.bash), or pip install 'tirgeo[ros]'",
        ),
        ("std_msgs", "jazzy", "sudo apt install ros-jazzy-std-msgs"),
        ("cv2", "jazzy", "sudo apt install python3-opencv, or pip install opencv-python-headless"),
        ("mcap", "jazzy", "pip install mcap"),
    ],
)
def test_a_node_names_the_package_that_is_missing(missing, distribution, remedy, monkeypatch):
    monkeypatch.setenv("ROS_DISTRO", distribution)
    program = (
        f"import sys; sys.modules[{missing!r}] = None\n"
        "from tirgeo_ros.nodes.start import start\nsys.exit(start('bag_player'))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 1
    assert done.stderr == f"bag_player: the Python package {missing} is missing: {remedy}\n"


@pytest.mark.slow
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

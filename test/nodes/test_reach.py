"""Who reaches the nodes of the demo: this machine, and no other."""

from __future__ import annotations

import subprocess
import sys
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words

from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.graph.localhost import PROFILES

pytestmark = pytest.mark.graph

#: A node without any setting of DDS, as `ros2 topic echo` is: hears a message, asks a service.
#: It asks again each second: ROS drops an answer where the server has not met the reader of it.
VISITOR = """
import time
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

rclpy.init()
node = rclpy.create_node("visitor")
heard, answers, asked_s = [], [], 0.0
node.create_subscription(DiagnosticArray, "/diagnostics", heard.append, 10)
client = node.create_client(Trigger, "/ekf_node/reset")
while not heard or not any(answer.done() for answer in answers):
    rclpy.spin_once(node, timeout_sec=0.1)
    if client.service_is_ready() and time.monotonic() > asked_s + 1.0:
        answers.append(client.call_async(Trigger.Request()))
        asked_s = time.monotonic()
answer = next(answer for answer in answers if answer.done())
print(type(heard[0]).__name__, answer.result().success)
"""


def sockets(pid: int) -> list[IPv4Address | IPv6Address]:
    """Local addresses of the UDP and TCP sockets of a process."""
    links = (str(link.readlink()) for link in Path(f"/proc/{pid}/fd").iterdir())
    inodes = {link[8:-1] for link in links if link.startswith("socket:[")}
    found = []
    for table in ("udp", "udp6", "tcp", "tcp6"):
        for line in Path(f"/proc/{pid}/net/{table}").read_text().splitlines()[1:]:
            words = line.split()
            if words[9] in inodes:
                found.append(address(words[1].partition(":")[0]))
    return found


def address(words: str) -> IPv4Address | IPv6Address:
    """Read an address as /proc/net has it: 32-bit words in the byte order of the machine."""
    parts = (int(words[i : i + 8], 16) for i in range(0, len(words), 8))
    return ip_address(b"".join(part.to_bytes(4, sys.byteorder) for part in parts))


def test_no_node_listens_beyond_this_machine(spawn, flight_bag, tmp_path):
    port = tmp_path / "aircraft"
    nodes = [
        spawn("ekf_node"),
        spawn("gimbal_node"),
        spawn("overlay_node"),
        spawn("dji_node", "-p", f"port:={port}"),
        spawn("recorder", "-p", f"output:={tmp_path}/out.mcap", "-p", "topics:=tirgeo/odometry"),
        spawn("bag_player", "-p", f"bag:={flight_bag}", "-p", "rate:=0.1"),
    ]
    for node in nodes:
        await_words(node, "ready")
    for node in nodes:
        found = sockets(node.pid)
        assert found, f"{node.name}: no socket seen: is /proc read right?"
        assert all(one.is_loopback for one in found), f"{node.name}: {sorted(map(str, found))}"


def test_a_visitor_on_this_machine_sees_them_without_any_setting(spawn, environment):
    await_words(spawn("ekf_node"), "ready")
    hidden = {*PROFILES, "ROS_AUTOMATIC_DISCOVERY_RANGE", "SKIP_DEFAULT_XML_FILE"}
    plain = {name: value for name, value in environment.items() if name not in hidden}
    visit = subprocess.run(
        [sys.executable, "-c", VISITOR],
        env=plain,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert visit.stdout.split() == ["DiagnosticArray", "True"]


def test_a_profile_in_the_working_directory_opens_nothing(spawn, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wide = find_resource("config/fastdds.xml").read_text()
    Path("DEFAULT_FASTRTPS_PROFILES.xml").write_text(wide.replace('"tirgeo"', '"another"'))
    node = spawn("ekf_node")
    await_words(node, "ready")
    assert all(one.is_loopback for one in sockets(node.pid))

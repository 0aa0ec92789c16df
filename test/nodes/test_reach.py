"""Who reaches the nodes of the demo: this machine, and no other."""

from __future__ import annotations

import sys
from ipaddress import IPv4Address, IPv6Address, ip_address
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words

from tirgeo_ros.tools.graph import find_resource

pytestmark = pytest.mark.graph


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
        spawn("viewer_node", "-p", "listen:=127.0.0.1:0", "-p", f"targets:={tmp_path}/a.gpkg"),
    ]
    for node in nodes:
        await_words(node, "ready")
    for node in nodes:
        found = sockets(node.pid)
        assert found, f"{node.name}: no socket seen: is /proc read right?"
        assert all(one.is_loopback for one in found), f"{node.name}: {sorted(map(str, found))}"


def test_a_profile_in_the_working_directory_opens_nothing(spawn, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wide = find_resource("config/fastdds.xml").read_text()
    Path("DEFAULT_FASTRTPS_PROFILES.xml").write_text(wide.replace('"tirgeo"', '"another"'))
    node = spawn("ekf_node")
    await_words(node, "ready")
    assert all(one.is_loopback for one in sockets(node.pid))

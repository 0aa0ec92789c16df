"""What a killed process leaves in shared memory goes with the next node, and nothing else does."""

from __future__ import annotations

import fcntl
import os
import signal
import time

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words

from dev.soak.run import held_by, shared_files
from tirgeo_ros.nodes.stale_shared_memory import remove_dead

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


def test_what_is_being_made_stays(tmp_path):
    made(tmp_path, DEAD, age_s=0.0)
    made(tmp_path, f"{LIVE}_el", age_s=0.0)
    assert remove_dead(tmp_path) == []


def test_links_are_not_followed(tmp_path):
    made(tmp_path, DEAD, "target")
    (tmp_path / f"{DEAD}_el").symlink_to(tmp_path / "target")
    assert remove_dead(tmp_path) == []
    assert left(tmp_path) == sorted([DEAD, f"{DEAD}_el", "target"])


@pytest.mark.graph
@pytest.mark.slow
def test_a_killed_node_leaves_its_memory_to_the_next_one_to_remove(spawn):
    before = set(shared_files())
    killed, stays = spawn("gimbal_node"), spawn("ekf_node")
    for node in (killed, stays):
        await_words(node, "ready")
    own = held_by(killed.pid) - before
    segments = {name for name in own if name + "_el" in own and "port" not in name}
    assert segments
    time.sleep(2.5)  # what is younger may be in the making
    killed.signal(signal.SIGKILL)
    killed.wait(5)
    assert segments & set(shared_files())
    kept = held_by(stays.pid) - own
    after = spawn("gimbal_node")
    await_words(after, "ready")
    assert not segments & set(shared_files())
    assert kept <= set(shared_files()) | before  # those of the living are still there
    for node in (after, stays):
        node.signal(signal.SIGINT)
        assert node.wait(15) is not None
    # The ports from 7000 on are shared by all domains: another program may have them by now.
    made = {name for name in own | kept if "port" not in name} - before
    assert made
    assert not made & set(shared_files())

"""The nodes as the launch file starts them, run for real: every argument once."""

from __future__ import annotations

import signal

import pytest

pytest.importorskip("rclpy", reason="needs ROS 2 or its wheels")

from graph_helpers import await_words
from launch_stand_ins import environment_of, launched, loaded, ros_arguments_of
from project import NODES, PROJECT

pytestmark = pytest.mark.graph

#: rviz2 is no part of the wheels; ``params`` is another word for ``params_file``.
UNTRIED = {"rviz", "params_file", "respawn"}
LIVE = {
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


@pytest.mark.parametrize("given", [LIVE | BOTH, ON_BAG | BOTH])
def test_nodes_run_and_end_with_every_launch_argument(
    given, spawn, flight_bag, tmp_path, monkeypatch
):
    own = f"/**/viewer_node: {{ros__parameters: {{targets: {tmp_path / 'targets.gpkg'}}}}}"
    (tmp_path / "own.yaml").write_text(own)
    (tmp_path / "flight.mcap").symlink_to(flight_bag)
    monkeypatch.chdir(tmp_path)
    launch_file = loaded(monkeypatch)
    assert set(launch_file["ARGUMENTS"]) == {*LIVE, *ON_BAG, *BOTH, *UNTRIED}
    profiles = {n: v for n, v in environment_of(launch_file, **given).items() if v is not None}
    nodes = launched(launch_file, **given)
    assert set(nodes) == NODES - {"dji_node" if "bag" in given else "bag_player"}
    processes = {
        name: spawn(name, *ros_arguments_of(node, tmp_path), **profiles)
        for name, node in nodes.items()
    }
    for name, process in processes.items():
        await_words(process, "played" if name == "bag_player" else "ready")
    for process in processes.values():
        process.signal(signal.SIGINT)
    for process in processes.values():
        ended = process.wait(60.0)
        assert ended is not None, f"{process.name} runs on"
        assert ended.exit_code == 0, process.text()

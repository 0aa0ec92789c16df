"""Code in the working directory is never run by a child that this program starts."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dev.real_flights_judged import judge_all
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.maps.map_process import MapProcess
from tirgeo_ros.tools.graph.node_process import NodeProcess

#: What the children import: of this package's requirements, and of Python's own.
NAMES = ("yaml", "numpy", "cv2", "pyproj", "random", "tempfile", "selectors", "tirgeo_ros")


@pytest.fixture
def traps(tmp_path, monkeypatch) -> Path:
    """A working directory of modules that leave a mark when they are run."""
    folder = tmp_path / "recordings"
    folder.mkdir()
    for name in NAMES:
        mark = tmp_path / f"{name}.mark"
        (folder / f"{name}.py").write_text(f"open({str(mark)!r}, 'w').close()\nraise SystemExit\n")
    monkeypatch.chdir(folder)
    # An empty entry is the working directory too: "export PYTHONPATH=$PYTHONPATH:/opt/x".
    paths = ["", *filter(None, os.environ.get("PYTHONPATH", "").split(os.pathsep))]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(paths))
    return tmp_path


def marks(folder: Path) -> list[str]:
    return [path.name for path in folder.glob("*.mark")]


def test_the_reader_of_maps_does_not(traps):
    path = traps / "map.geojson"
    path.write_text('{"type": "Point", "coordinates": [114.3, 30.5]}')
    child = MapProcess()
    try:
        contents = child.read(OverlayConfig(map=str(path), ground_height_m=30.0))
    finally:
        child.stop()
        assert marks(traps) == []
    assert contents.features == 1


def test_a_node_does_not(traps):
    """It ends for want of a bag, or of ROS: with its modules found where they should be."""
    process = NodeProcess("bag_player", [], os.environ, traps / "log")
    assert process.wait(60.0) is not None
    assert marks(traps) == []
    assert process.last_line().startswith("bag_player: "), process.text()


@pytest.mark.skipif(sys.version_info < (3, 11), reason="Python 3.10 cannot leave it out")
def test_workers_do_not(traps):
    with pytest.raises(TirgeoError, match=r"absent\.mcap"):
        judge_all([traps / "absent.mcap"], {})
    assert marks(traps) == []


def test_the_traps_would_be_run_by_a_plain_child(traps):
    subprocess.run([sys.executable, "-c", "import yaml"], check=True)
    assert marks(traps) == ["yaml.mark"]


def test_a_node_ends_with_the_process_that_started_it(tmp_path):
    """By SIGTERM, which it takes for a stop: it completes its files."""
    (tmp_path / "others").mkdir()
    (tmp_path / "others" / "waiting.py").write_text(
        "import signal\n"
        "from pathlib import Path\n"
        "def main():\n"
        f"    Path({str(tmp_path / 'ready')!r}).touch()\n"
        "    got = signal.sigwait({signal.SIGTERM})\n"
        f"    Path({str(tmp_path / 'told')!r}).write_text(got.name)\n"
        "    return 0\n"
    )
    program = (
        "import os, subprocess, sys, time\n"
        f"sys.path.append({str(tmp_path)!r})\n"
        "from tirgeo_ros.io.files.child_process import node_command\n"
        "command = node_command('waiting', [], 'others', ends_with=os.getpid())\n"
        "child = subprocess.Popen(command)\n"
        f"while child.poll() is None and not os.path.exists({str(tmp_path / 'ready')!r}):\n"
        "    time.sleep(0.05)\n"
        "os.kill(os.getpid(), 9)\n"
    )
    subprocess.run([sys.executable, "-c", program], check=False)
    told, end_s = tmp_path / "told", time.monotonic() + 30
    while not (told.exists() and told.read_text()):
        assert time.monotonic() < end_s, list(tmp_path.iterdir())
        time.sleep(0.05)
    assert told.read_text() == "SIGTERM"

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
"""Child processes: their answers and ends, and their modules."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from project import wait_until

from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.io.files.child_process import ChildEndedError, ChildProcess
from tirgeo_ros.io.maps.map_process import MapProcess
from tirgeo_ros.tools.graph.node_graph import NodeProcess

_ECHO = """
import pickle, sys
from tirgeo_ros.io.files.child_process import parent_pipes
with parent_pipes() as (tasks, answers):
    while True:
        task = pickle.load(tasks)
        print("said on stdout", flush=True)
        if task == "die":
            sys.exit("the last words")
        if task == "read":
            task = sys.stdin.read()
        pickle.dump(task, answers)
        answers.flush()
"""
_TIDY = """
import os, pickle, signal, sys, time
from tirgeo_ros.io.files.child_process import parent_pipes
signal.signal(signal.SIGTERM, lambda *_: sys.exit(0))
with parent_pipes(signal.SIGTERM) as (tasks, answers):
    try:
        pickle.dump(os.getpid(), answers)
        answers.flush()
        time.sleep(600)
    finally:
        time.sleep(0.3)
        sys.stderr.write("cleaned up")
"""
LARGE = bytes(range(256)) * 40_000  # ten times what a pipe holds


@pytest.fixture
def child():
    process = ChildProcess(_ECHO)
    yield process
    process.close()


def test_objects_come_back_and_printing_is_no_answer(child):
    for thing in ({"a": 1}, LARGE, "read", None):
        child.send(thing)
        assert child.receive() == ("" if thing == "read" else thing)
    child.close()
    assert child.said.splitlines() == 4 * ["said on stdout"]


def killed(child):
    child.kill()
    return child.receive()


@pytest.mark.parametrize(
    ("program", "work", "code", "last"),
    [
        (_ECHO, lambda child: (child.send("die"), child.receive()), 1, ": the last words"),
        (_ECHO, killed, -signal.SIGKILL, ""),
        ("raise SystemExit(3)", lambda child: child.send(LARGE), 3, ""),
    ],
)
def test_one_that_dies_leaves_its_code_and_its_last_line(program, work, code, last):
    child = ChildProcess(program)
    with pytest.raises(ChildEndedError) as ended:
        work(child)
    assert (ended.value.code, ended.value.last) == (code, last)
    child.close()
    child.close()  # again


def test_ctrl_c_is_the_parents(child):
    child.send(1)
    assert child.receive() == 1  # it has begun
    os.kill(child._process.pid, signal.SIGINT)
    child.send(2)
    assert child.receive() == 2


def test_an_answer_can_be_waited_for(child):
    assert not child.answers_within(0.0)
    child.send(7)
    assert child.answers_within(60.0)
    assert child.receive() == 7
    child.kill()
    assert child.answers_within(60.0)  # its end is one, which ``receive`` tells


@pytest.mark.parametrize(("patience_s", "text"), [(60.0, "cleaned up"), (0.0, "")])
def test_one_that_is_told_to_end_may_clean_up(patience_s, text):
    """With no patience it is killed at once: it sleeps meanwhile."""
    child = ChildProcess(_TIDY)
    child.send(None)
    assert child.receive() == child.number
    child.end(patience_s)
    assert child.said == text
    child.end(patience_s)  # again


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
    signalled = tmp_path / "told"
    wait_until(lambda: signalled.exists() and signalled.read_text(), 30)
    assert signalled.read_text() == "SIGTERM"

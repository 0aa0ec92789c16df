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
"""What ``tirgeo run`` becomes: the launch file's nodes, parameters and environment."""

from __future__ import annotations

import configparser
import json
import os
import shlex
import shutil
import signal
import subprocess
from pathlib import Path

import pytest
from project import NODES, PROJECT

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.files.dds_profiles import PROFILES
from tirgeo_ros.io.files.stop_signals import stop_signals
from tirgeo_ros.tools.cli import main as command
from tirgeo_ros.tools.cli.main import parser_of, verbs
from tirgeo_ros.tools.graph.whole_graph import WholeGraph, read_remaps
from tirgeo_ros.tools.replay.registration import INPUTS


class ReplacedError(Exception):
    """Report that this process would have been replaced."""


@pytest.fixture
def become(monkeypatch):
    """Run ``tirgeo run`` up to the call that replaces this process; return that call."""
    for name in [*PROFILES, "ROS_DOMAIN_ID", "ROS_AUTOMATIC_DISCOVERY_RANGE"]:
        monkeypatch.delenv(name, raising=False)
    calls = []

    def replace(*call: object) -> None:
        calls.append(call)
        raise ReplacedError

    monkeypatch.setattr(os, "execve", replace)
    before = signal.pthread_sigmask(signal.SIG_BLOCK, ())

    def run(*words: str) -> tuple[list[str], dict[str, str]]:
        with pytest.raises(ReplacedError):
            command.main(["run", *words])
        _, argv, environment = calls.pop()
        return argv[argv.index("--ros-args") :], environment

    yield run
    signal.pthread_sigmask(signal.SIG_SETMASK, before)


def test_the_unit_of_systemd_calls_the_command_as_it_is():
    path = PROJECT / "config" / "systemd" / "tirgeo.service"
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read(path)
    shell, option, line = shlex.split(unit["Service"]["ExecStart"])
    assert (shell, option) == ("/bin/bash", "-c")
    program, *words = shlex.split(line.rpartition("exec ")[2])
    assert program.endswith("/.venv/bin/tirgeo")
    parser_of(verbs()).parse_args(words)
    assert unit["Service"]["KillSignal"] == "SIGINT"
    if shutil.which("systemd-analyze"):
        done = subprocess.run(
            ["systemd-analyze", "verify", path], capture_output=True, text=True, check=False
        )
        assert (done.returncode, done.stderr) == (0, "")


def values_of(argv):
    """The parameters in the last file, which is in memory and names all nodes."""
    last = max(place for place, word in enumerate(argv) if word == "--params-file")
    (section,) = json.loads(Path(argv.pop(last + 1)).read_text()).items()
    assert argv.pop(last) == "--params-file"
    assert section[0] == "/**/*"
    return section[1]["ros__parameters"]


def test_live_is_the_launch_files_live(become):
    argv, environment = become()
    usual = ["--params-file", str(PROJECT / "config" / "m600_xt2.yaml")]
    assert argv == ["--ros-args", *usual, "--", *WholeGraph().nodes]
    assert set(WholeGraph().nodes) == NODES - {"bag_player", "viewer_node"}
    assert environment[PROFILES[0]] == str(PROJECT / "config" / "fastdds.xml")
    assert set(stop_signals()) <= signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_bag_brings_its_own_time_and_stays_on_this_machine(become, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name in ("flight.mcap", "7", "a.yaml", "b.yaml"):
        (tmp_path / name).touch()
    words = ["--map", "7", "--params", "a.yaml", "--params", "b.yaml", "--namespace", "/uav1/"]
    argv, environment = become("--bag", "flight.mcap", *words)
    # A map named 7 is no number.
    assert values_of(argv) == {"bag": "flight.mcap", "use_sim_time": True, "map": "7"}
    nodes = WholeGraph(Path("flight.mcap")).nodes
    files = ["--ros-args", "--params-file", "a.yaml", "--params-file", "b.yaml"]
    assert argv == [*files, *["-r", "__ns:=/uav1", "-r", "/clock:=clock", "--"], *nodes]
    assert set(nodes) == NODES - {"dji_node", "viewer_node"}
    assert environment[PROFILES[0]] == str(PROJECT / "config" / "fastdds_localhost.xml")


def test_inputs_of_other_names(become, tmp_path):
    path = tmp_path / "remap.yaml"
    path.write_text("imu/data: mavros/imu/data\ngps/fix: /gnss/fix\n")
    argv, _ = become("--no-dji", "--namespace", "uav1", "--remap", str(path))
    rules = ["-r", "imu/data:=mavros/imu/data", "-r", "gps/fix:=/gnss/fix", "--"]
    assert argv[argv.index("__ns:=/uav1") + 1 :][:5] == rules
    assert set(argv[argv.index("--") + 1 :]) == NODES - {"dji_node", "bag_player", "viewer_node"}


def test_the_page_comes_at_its_own_address_or_that_of_the_parameters(become, capsys):
    argv, _ = become("--page", "0.0.0.0:8081")
    assert values_of(argv) == {"listen": "0.0.0.0:8081"}
    assert set(argv[argv.index("--") + 1 :]) == NODES - {"bag_player"}
    argv, _ = become("--page")
    assert argv.count("--params-file") == 1
    assert "viewer_node" in argv
    with pytest.raises(SystemExit, match="2"):
        command.main(["run", "--page", "8080"])
    assert "'8080' is not HOST:PORT" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["run", "demo"])
def test_events_without_a_page_and_an_invalid_namespace_are_wrong_use(verb, become, capsys):
    with pytest.raises(SystemExit, match="2"):
        become("--namespace", "uav 1")
    assert "--namespace uav 1: use letters" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        command.main([verb, "--cot", "tcp://tak.example"])
    assert "--cot is for the operator's page: give --page too" in capsys.readouterr().err


def test_the_nodes_names_are_on_stdout_for_programs(become, capsys, monkeypatch):
    become("--json")
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    become()
    shown = capsys.readouterr()
    nodes = '["ekf_node", "gimbal_node", "overlay_node", "dji_node"]'
    assert shown.out == f'{{"nodes": {nodes}, "ros_domain_id": "0"}}\n'
    assert "ROS_DOMAIN_ID=7" in shown.err


@pytest.mark.parametrize("option", ["--bag", "--map", "--params", "--remap"])
def test_a_file_that_is_absent_is_named_before_anything_runs(option, capsys):
    assert command.main(["run", option, "none.in"]) == 1
    assert (
        capsys.readouterr().err == "tirgeo run: none.in: there is no such file; check its name\n"
    )


def test_the_file_of_other_names_for_mavros():
    pairs = read_remaps(PROJECT / "config" / "mavros.yaml")
    assert ("imu/data", "mavros/imu/data") in pairs
    assert {own for own, _ in pairs} <= {*INPUTS}


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "write lines as imu/data: mavros/imu/data"),
        ("/imu/data: a", "/imu/data: not an input of tirgeo: use imu/data, rtk/fix"),
        ("imu/data: 7", "imu/data: 7 is not the name of a topic"),
        ("imu/data: a b", "imu/data: 'a b' is not the name of a topic"),
        ("imu/data: a: b", "line 1"),
    ],
)
def test_an_invalid_remap_is_named(tmp_path, text, reason):
    path = tmp_path / "remap.yaml"
    path.write_text(text)
    with pytest.raises(ConfigError) as raised:
        read_remaps(path)
    assert str(raised.value).startswith(f"{path}: ")
    assert reason in str(raised.value)

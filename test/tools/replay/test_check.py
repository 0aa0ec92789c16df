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
"""tirgeo check, and the findings of process, locate and evaluate."""

from __future__ import annotations

import json
from collections import Counter

import pytest
from process_bags import located_or_evaluated, rewritten, same

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay import flight_checks as groups
from tirgeo_ros.tools.replay.check import check
from tirgeo_ros.tools.replay.process import process

STOP = Finding("gravity", Severity.STOP, "gravity is 1.0", "imu/data", "give m/s2")
CAUTION = Finding("late", Severity.CAUTION, "0.6 s late", "rtk.delay_s", "set it to 0.6")
NOTE = Finding("vibration", Severity.NOTE, "it shakes", "imu/data", "dampen it")


class Group:
    """Stands in for a group of checks: counts its calls and returns given findings."""

    def __init__(self, found=()):
        self.calls = Counter()
        self.stamps_ns = []
        self.found = list(found)

    def __getattr__(self, name):
        def call(*arguments):
            self.calls[name] += 1
            if name == "frame":
                self.stamps_ns.append(arguments[0])

        return call

    def findings(self):
        return self.found


@pytest.fixture
def stand_ins(monkeypatch):
    """The groups, by module."""
    made = {name: Group() for name in ("Navigation", "Gimbal", "Picture", "Map")}
    for name, group in made.items():
        monkeypatch.setattr(groups, f"{name}Checks", lambda *_, it=group: it)
    return made


def given(sample, *more):
    return [*("--params", str(sample / "params.yaml")), *map(str, more)]


def test_a_good_flight_has_the_verdict_go(sample, capsys):
    files = given(sample, "--map", sample / "map.geojson")
    assert main(["check", str(sample / "flight.mcap"), *files]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    reports = "checked over 30.0 s: 10 topics, filter ekf_heading running; --json has each"
    assert out == f"GO\n\n{reports}\n"
    assert main(["check", str(sample / "flight.mcap"), *files, "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)["checked"]
    imu = checked["topics"]["imu/data"]
    assert (round(imu["rate_hz"]), round(imu["longest_gap_s"], 3)) == (100, 0.01)
    assert checked["picture_size"] == [640, 512]


def test_findings_are_three_lines_each_and_the_worst_is_first(short, sample, stand_ins, capsys):
    stand_ins["Navigation"].found = [NOTE, CAUTION]
    stand_ins["Picture"].found = [STOP]
    assert main(["check", str(short), *given(sample)]) == 1
    out, err = capsys.readouterr()
    assert out.split("checked over")[0] == (
        "NO GO: 1 fault, 1 caution, 1 note\n\n"
        "STOP     gravity is 1.0\n         look at  imu/data\n         to mend  give m/s2\n\n"
        "CAUTION  0.6 s late\n         look at  rtk.delay_s\n         to mend  set it to 0.6\n\n"
        "NOTE     it shakes\n         look at  imu/data\n         to mend  dampen it\n\n"
    )
    assert err == "tirgeo check: NO GO: gravity is 1.0: imu/data (and 1 more)\n"


def test_the_datum_comes_before_the_ground_that_is_wrong_by_it(short, sample, stand_ins):
    datum = Finding("height_datum", Severity.CAUTION, "47 m apart", "rtk/fix, gps/fix", "shift it")
    ground = Finding("below_ground", Severity.STOP, "7 m below", "ground_height_m", "lower it")
    stand_ins["Navigation"].found, stand_ins["Picture"].found = [CAUTION, datum], [ground]
    found = check(short, params=sample / "params.yaml")["findings"]
    assert [(entry["check"], entry["severity"]) for entry in found] == [
        ("height_datum", "stop"),
        ("below_ground", "stop"),
        ("late", "caution"),
    ]


def test_a_caution_alone_may_fly(short, sample, stand_ins, capsys):
    stand_ins["Gimbal"].found = [CAUTION]
    assert main(["check", str(short), *given(sample), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["verdict"] == "GO: 1 caution"
    assert result["findings"] == [
        {
            "check": "late",
            "severity": "caution",
            "evidence": "0.6 s late",
            "parameter": "rtk.delay_s",
            "mend": "set it to 0.6",
        }
    ]
    assert result["error"] is None


def test_the_groups_see_all_of_a_flight(short, sample, stand_ins):
    numbers = check(short, params=sample / "params.yaml")["checked"]["topics"]
    navigation, gimbal, pictures, _ = stand_ins.values()
    sensed = sum(
        n["messages"] for topic, n in numbers.items() if topic[:3] in ("imu", "rtk", "gps")
    )
    assert navigation.calls["take"] == sensed
    assert gimbal.calls["joints"] == numbers["gimbal/joint_states"]["messages"]
    assert gimbal.calls["reported"] == numbers["gimbal/attitude"]["messages"]
    assert gimbal.calls["autopilot"] == numbers["imu/data"]["messages"]
    assert pictures.calls["frame"] == numbers["thermal/image_raw/compressed"]["messages"]
    assert pictures.calls["camera"] == numbers["thermal/camera_info"]["messages"]
    assert pictures.calls["plane"] == 1
    assert gimbal.calls["body"] > 0
    assert pictures.calls["pose"] > 0


def test_another_namespace(short, tmp_path, capsys):
    path = tmp_path / "uav1.mcap"
    rewritten(short, path, lambda item: (f"/uav1{item.topic}", item.data), seconds=2)
    assert main(["check", str(path)]) == 1
    out, err = capsys.readouterr()
    assert "did you mean --namespace uav1?" in out
    assert "no pose" not in out  # that follows from it
    assert err.startswith("tirgeo check: NO GO: no input topic under /; there are 10 in other")


def test_a_flight_without_a_pose_says_why(short, tmp_path):
    path, keep = tmp_path / "short.mcap", {"/imu/data", "/rtk/fix"}
    rewritten(short, path, lambda item: same(item) if item.topic in keep else None, seconds=1)
    found = {entry["check"]: entry for entry in check(path)["findings"]}
    assert found["no_pose"]["severity"] == "stop"
    assert "filter made no pose: " in found["no_pose"]["evidence"]


def test_a_damaged_bag_is_checked_as_far_as_it_goes(short, tmp_path):
    path = tmp_path / "cut.mcap"
    path.write_bytes(short.read_bytes()[: short.stat().st_size // 2])
    result = check(path)
    assert "damaged_bag" in [entry["check"] for entry in result["findings"]]
    assert result["checked"]["topics"]["imu/data"]["messages"] > 0


def test_process_reports_checks_and_writes_the_same(short, sample, stand_ins, tmp_path, capsys):
    outs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    text = []
    for out, found in zip(outs, ([], [STOP, CAUTION, NOTE]), strict=True):
        stand_ins["Navigation"].found = found
        arguments = ["process", str(short), "-o", str(out), *given(sample), "--no-images"]
        assert main(arguments) == (1 if found else 0)
        text.append(capsys.readouterr())
    assert outs[0].read_bytes() == outs[1].read_bytes()
    assert text[0].err == ""
    assert text[1].err == (
        "tirgeo process: STOP: gravity is 1.0: imu/data: give m/s2\n"
        "tirgeo process: CAUTION: 0.6 s late: rtk.delay_s: set it to 0.6\n"
        "tirgeo process: NO GO: gravity is 1.0: imu/data (and 1 more)\n"
    )
    assert "findings" not in text[1].out


@pytest.mark.parametrize("composition", ["auto", "encoders"])
def test_process_passes_unused_inputs_to_the_checks(
    composition, short, sample, stand_ins, tmp_path
):
    """The checks get some of 50 attitudes a second, and lens, pictures and map without drawing."""
    params = tmp_path / "more.yaml"
    params.write_text(f"/**/gimbal_node:\n  ros__parameters: {{composition: {composition}}}\n")
    files = {"params": [sample / "params.yaml", params], "map": sample / "map.geojson"}
    process(short, tmp_path / "a.mcap", **files, images=False)
    assert stand_ins["Gimbal"].calls["reported"] >= 20
    assert stand_ins["Picture"].calls["camera"] > 0
    assert stand_ins["Picture"].calls["passed"] == 54
    assert stand_ins["Map"].calls["map"] == 1


def test_a_fault_of_a_check_is_reported_and_changes_nothing(
    short, sample, stand_ins, tmp_path, monkeypatch
):
    files = {"params": sample / "params.yaml", "images": False}
    outs = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    assert process(short, outs[0], **files)["findings"] == []

    def broken(*_):
        raise BagError("no plane")  # an error of ours would count the sample as unreadable

    monkeypatch.setattr(stand_ins["Navigation"], "take", broken, raising=False)
    summary = process(short, outs[1], **files)
    assert outs[0].read_bytes() == outs[1].read_bytes()
    assert summary["unreadable"] == {}
    (finding,) = summary["findings"]
    assert (finding["check"], finding["severity"]) == ("check_failed", "caution")
    assert "times: BagError: no plane (test_check.py:" in finding["evidence"]


@pytest.mark.parametrize("verb", ["locate", pytest.param("evaluate", marks=pytest.mark.slow)])
def test_locate_and_evaluate_report_findings(verb, sample, stand_ins, tmp_path, capsys):
    stand_ins["Gimbal"].found = [STOP, CAUTION, NOTE]
    words = located_or_evaluated(verb, sample, tmp_path)
    arguments = [*map(str, words), *given(sample), "--json"]
    assert main(arguments) == 1
    out, err = capsys.readouterr()
    checks = [entry["check"] for entry in json.loads(out)["findings"]]
    assert checks == ["gravity", "late", "vibration"]
    written = "points.geojson" if verb == "locate" else "evaluation/report.html"
    assert (tmp_path / written).exists()
    assert f"tirgeo {verb}: CAUTION: 0.6 s late: rtk.delay_s: set it to 0.6\n" in err
    assert "it shakes" not in err
    navigation, gimbal, pictures, _ = stand_ins.values()
    assert 0 < gimbal.calls["body"] < navigation.calls["take"]
    assert pictures.calls["passed"] == 270  # the stand-in follows none
    assert pictures.calls["frame"] == 0

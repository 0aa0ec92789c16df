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
"""docs/reproduction.md: it is of the present template, and its commands are the program's own."""

from __future__ import annotations

import re

import pytest
from project import PROJECT

import dev.reproduction.__main__ as reproduction
from dev.reproduction.__main__ import TEMPLATE, carried_out, commands, main, parsed
from dev.reproduction.paper import (
    TABLE_2_M,
    TABLE_6_AVERAGE_M,
    TABLE_8_DEG,
    TABLE_9,
)
from tirgeo_ros.core.types.errors import BagError, CalibrationError


@pytest.fixture(scope="module")
def written():
    return (PROJECT / "docs" / "reproduction.md").read_text(encoding="utf-8")


@pytest.fixture
def project(monkeypatch):
    monkeypatch.chdir(PROJECT)


def section(text, title):
    return text.partition(f"## {title}")[2].partition("\n## ")[0]


def skeleton(text):
    """What must not change with the amounts: the words, and the heads of tables."""
    text = re.sub(r" --start \d+ --duration \d+", "", re.sub(r"\s*\\\n\s*", " ", text))
    text = re.sub(r"\(none\)|\(((gyro|accel) [xyz](, )?)+\)", "(axes)", text)
    lines = text.splitlines()
    heads = {k for k, line in enumerate(lines[1:]) if re.fullmatch(r"[|: -]+", line)}
    kept = (
        re.sub(r" +", " ", line) for k, line in enumerate(lines) if line[:1] != "|" or k in heads
    )
    joined = " ".join(" ".join(kept).split())
    return re.sub(r"-?\d+([. ]\d+)*(e-\d+)?", "#", joined).replace("gimbal_north # ± # deg, ", "")


@pytest.mark.parametrize(
    ("title", "numbers"),
    [
        ("Table 2", TABLE_2_M.values()),
        ("Table 8", TABLE_8_DEG.values()),
        ("Table 9", TABLE_9.values()),
    ],
)
def test_the_paper_s_numbers_are_there(written, title, numbers):
    for number in numbers:
        assert f" {number:.4f}" in section(written, f"{title}:")


def test_the_page_s_commands_are_the_template_s_and_parse(written):
    shown = re.findall(r"```sh\n(.*?)^```", written, re.DOTALL | re.MULTILINE)
    given = re.findall(r"```sh (.*?)\n(.*?)^```", TEMPLATE.read_text(), re.DOTALL | re.MULTILINE)
    assert shown == [block for _, block in given]
    result = [
        item for names, block in given for item in commands(block, names.split(", ")).values()
    ]
    assert len(result) > 30
    for words in result:
        assert callable(parsed(words).verb_module.run)  # SystemExit where they are wrong


def test_the_ways_of_the_methods_come_out(written):
    """The requirement's figures, of the numbers that the page tells."""
    reports = written.partition("`composition: encoders`\n\n|")[2].partition("\n\n")[0]
    here = {
        m: float(value) for m, value in re.findall(r"`(\w+)` +\|[^|]*\|[^|]*\| *([\d.]+)", reports)
    }
    assert here["raw"] > here["rtk"] > here["ekf"] > here["ekf_heading"]
    assert here["ekf_heading"] <= 0.8
    assert here["calibrated"] <= 0.3


def test_what_is_askew_matters_and_is_found(written):
    reports = section(written, "Table 6 again, with the camera askew")
    askew = dict(re.findall(r"^\| `(\w+)` .*\| +([\d.]+) \|$", reports, re.MULTILINE))
    assert float(askew["ekf_heading"]) > TABLE_6_AVERAGE_M["ekf_heading"]
    assert float(askew["calibrated"]) <= 0.3
    result = re.findall(r"^\| (\w+), (deg|ms) .*?\| +(\S+) \| +(\S+) \|", reports, re.MULTILINE)
    assert [name for name, *_ in result][:4] == ["roll", "pitch", "yaw", "latency"]
    for _, unit, planted, value in result:
        assert abs(float(value) - float(planted)) <= (10.0 if unit == "ms" else 0.1)


@pytest.mark.slow
@pytest.mark.long
def test_the_page_is_of_the_present_template(written, tmp_path, project, capsys):
    """Little of everything makes the same words."""
    made = tmp_path / "page.md"
    assert main(["--quick", "--work", str(tmp_path / "work"), "-o", str(made)]) == 0
    assert skeleton(made.read_text(encoding="utf-8")) == skeleton(written)


def test_a_command_that_fails_and_a_result_with_an_error_are_told(tmp_path, project, monkeypatch):
    template = "```sh x\ntirgeo check reproduction/none.mcap\n```\n"
    with pytest.raises(BagError, match=r"none\.mcap"):
        carried_out(template, tmp_path)
    module = type("Module", (), {"run": staticmethod(lambda _args: {"error": "half a bag"})})
    args = type("Args", (), {"verb_module": module})
    monkeypatch.setattr(reproduction, "parsed", lambda _words: args)
    with pytest.raises(CalibrationError, match="half a bag"):
        carried_out(template, tmp_path)


def test_loops_are_unrolled_and_files_written_below_the_folder(tmp_path):
    block = (
        "cat > reproduction/a.yaml <<'END'\na: 1\nEND\nfor seed in 1 2; do\n  x \\\n $seed\ndone\n"
    )
    assert commands(block, ["x $seed"]) == {"x 1": ["x", "1"], "x 2": ["x", "2"]}
    carried_out(f"```sh \n{block.partition('for')[0]}```\n", tmp_path)
    assert (tmp_path / "a.yaml").read_text() == "a: 1\n"

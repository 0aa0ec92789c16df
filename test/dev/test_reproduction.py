"""docs/reproduction.md: it is of the present script, and its commands are the program's own."""

from __future__ import annotations

import re
import shlex

import pytest
from project import PROJECT

from dev.paper_tables import (
    TABLE_1,
    TABLE_2_M,
    TABLE_6_AVERAGE_M,
    TABLE_6_M,
    TABLE_8_DEG,
    TABLE_9,
)
from dev.reproduction.__main__ import main
from dev.reproduction.markdown import p_value, spread, table, words
from dev.reproduction.page import HEAD, PARTS
from dev.reproduction.script import ForSeeds, Put, Run, carry_out, parsed, shell
from dev.reproduction.sections import QUICK, Amounts
from tirgeo_ros.core.types.errors import BagError, CalibrationError

TABLES = (1, 2, 5, 6, 7, 8, 9)


@pytest.fixture(scope="module")
def written():
    return (PROJECT / "docs" / "reproduction.md").read_text(encoding="utf-8")


@pytest.fixture
def project(monkeypatch):
    monkeypatch.chdir(PROJECT)


def blocks(text):
    return re.findall(r"```sh\n(.*?)\n```", text, re.DOTALL)


def commands(block):
    """The commands of a shell's text, loops unrolled once, files that are written left out."""
    block = re.sub(r"cat > \S+ <<'END'\n.*?\nEND", "", block, flags=re.DOTALL)
    seeds = re.findall(r"^for seed in (\d+)", block, re.MULTILINE) or [""]
    block = re.sub(r"^(for seed in .*; do|done)$", "", block, flags=re.MULTILINE)
    lines = block.replace("$seed", seeds[0]).replace("\\\n", " ").splitlines()
    return [shlex.split(line) for line in lines if line.strip()]


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


def test_every_table_is_there(written):
    assert written.startswith(HEAD)
    titles = re.findall(r"^## (Table \d[^\n]*)", written, re.MULTILINE)
    assert titles == [part(Amounts()).title for part in PARTS]
    assert {int(title[6]) for title in titles} == set(TABLES)
    for title in titles:
        section = written.partition(f"## {title}\n")[2].partition("\n## ")[0]
        assert re.search(r"^\| -+", section, re.MULTILINE), title


@pytest.mark.parametrize(
    ("title", "numbers"),
    [
        ("Table 1", TABLE_1.values()),
        ("Table 2", TABLE_2_M.values()),
        ("Table 8", TABLE_8_DEG.values()),
        ("Table 9", TABLE_9.values()),
    ],
)
def test_the_paper_s_numbers_are_there(written, title, numbers):
    section = written.partition(f"## {title}:")[2].partition("\n## ")[0]
    for number in numbers:
        assert f" {number:.4f}" in section


def test_the_points_of_table_6_are_there(written):
    rows = re.findall(r"^\| (\d+) +\|(.*)\|$", written, re.MULTILINE)
    assert [number for number, _ in rows] == list(TABLE_6_M["raw"])
    for number, row in rows:
        cells = [cell.strip() for cell in row.split("|")]
        assert cells[:4] == [f"{column[number]:.2f}" for column in TABLE_6_M.values()]


def test_the_page_s_commands_are_the_script_s(written):
    shown = blocks(written)
    assert shown == [shell(part(Amounts()).steps) for part in PARTS if part(Amounts()).steps]


def test_the_commands_parse(written):
    found = [words_ for block in blocks(written) for words_ in commands(block)]
    assert len(found) > 15
    for line in found:
        args = parsed(line)  # leaves by SystemExit where they are wrong
        assert callable(args.verb_module.run)


def test_the_ways_of_the_methods_come_out(written):
    """The requirement's figures, of the numbers that the page tells."""
    section = written.partition("`composition: encoders`\n\n|")[2].partition("\n\n")[0]
    here = {
        m: float(value) for m, value in re.findall(r"`(\w+)` +\|[^|]*\|[^|]*\| *([\d.]+)", section)
    }
    assert here["raw"] > here["rtk"] > here["ekf"] > here["ekf_heading"]
    assert here["ekf_heading"] <= 0.8
    assert here["calibrated"] <= 0.3


def test_what_is_askew_matters_and_is_found(written):
    """What the words under the table say of its numbers."""
    section = written.partition("with the camera askew\n")[2].partition("\n## ")[0]
    askew = dict(re.findall(r"^\| `(\w+)` .*\| +([\d.]+) \|$", section, re.MULTILINE))
    assert float(askew["ekf_heading"]) > TABLE_6_AVERAGE_M["ekf_heading"]
    assert float(askew["calibrated"]) <= 0.3
    found = re.findall(r"^\| (\w+), (deg|ms) .*?\| +(\S+) \| +(\S+) \|", section, re.MULTILINE)
    assert [name for name, *_ in found][:4] == ["roll", "pitch", "yaw", "latency"]
    for _, unit, planted, value in found:
        assert abs(float(value) - float(planted)) <= (10.0 if unit == "ms" else 0.1)


@pytest.mark.slow
def test_the_budget_is_within_four_per_cent(tmp_path, project):
    """Tables 1 and 2 as they are made, of a part of the flight."""
    found, texts = {}, []
    for part in PARTS[:2]:
        section = part(QUICK)
        found = {**found, **carry_out(section.steps, tmp_path)}
        texts.append(section.text(found))
    assert "E_beta (heading)" in texts[0]
    rows = {row["factor"]: row for row in found["budget"]["rows"] if row["form"] == "closed"}
    assert rows["height"]["mean_m"] == pytest.approx(TABLE_2_M["CamHeight"], rel=0.04)
    assert rows["heading"]["mean_m"] == pytest.approx(TABLE_2_M["CamYaw"], rel=0.04)
    assert f"| {rows['height']['mean_m']:.4f} |" in re.sub(r" +", " ", texts[1])


@pytest.mark.slow
@pytest.mark.long
def test_the_page_is_of_the_present_script(written, tmp_path, project, capsys):
    """Little of everything makes the same words."""
    made = tmp_path / "page.md"
    assert main(["--quick", "--work", str(tmp_path / "work"), "-o", str(made)]) == 0
    assert skeleton(made.read_text(encoding="utf-8")) == skeleton(written)


def test_a_command_that_fails_is_told(tmp_path, project):
    steps = [Run("gone", "tirgeo budget reproduction/none.mcap")]
    with pytest.raises(BagError, match=r"none\.mcap"):
        carry_out(steps, tmp_path)


def test_a_result_with_an_error_is_none(tmp_path, monkeypatch):
    class Module:
        @staticmethod
        def run(_args):
            return {"error": "half a bag"}

    monkeypatch.setattr(
        "dev.reproduction.script.parsed",
        lambda _words: type("Args", (), {"verb_module": Module}),
    )
    with pytest.raises(CalibrationError, match="half a bag"):
        carry_out([Run("half", "tirgeo x")], tmp_path)


def test_the_shell_takes_what_is_shown():
    steps = [
        Put("reproduction/a.yaml", "a: 1\n"),
        ForSeeds(
            (1, 2), [Run("x $seed", "tirgeo simulate s.yaml -o " + "long/" * 16 + " --seed 1")]
        ),
    ]
    assert shell(steps).splitlines() == [
        "cat > reproduction/a.yaml <<'END'",
        "a: 1",
        "END",
        "for seed in 1 2; do",
        "  tirgeo simulate s.yaml \\",
        "      -o " + "long/" * 16 + " \\",
        "      --seed 1",
        "done",
    ]


def test_files_are_put_below_the_folder(tmp_path):
    carry_out([Put("reproduction/a.yaml", "a: 1\n")], tmp_path)
    assert (tmp_path / "a.yaml").read_text() == "a: 1\n"


def test_markdown():
    assert table(["a", "bb"], [["long", "1"]]) == "| a    | bb |\n| ---- | -: |\n| long |  1 |"
    assert words("\n  one\n  two\n\n  - a\n    b\n  - c\n") == "one two\n\n- a b\n- c"
    assert spread([1.0, 2.0, 3.0], 2) == "2.00 ± 1.00"
    assert spread([1.0], 1) == "1.0"
    assert [p_value(p) for p in (None, 0.00004, 0.00051)] == ["-", "< 0.0001", "0.0005"]


def test_it_wants_the_project_s_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit):
        main([])
    assert "run it in the project's folder" in capsys.readouterr().err

"""docs/library.md and the README: their code runs, their columns and names exist."""

from __future__ import annotations

import re

import pytest
from project import PROJECT

import tirgeo_ros
from tirgeo_ros.library.sensor_columns import SENSORS

PAGE = (PROJECT / "docs" / "library.md").read_text()
README = (PROJECT / "README.md").read_text()


def blocks(text):
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.slow
@pytest.mark.usefixtures("sample")
@pytest.mark.parametrize(
    ("text", "count", "said"),
    [
        (README, 1, r"39\.\d{6} 116\.\d{6} ±0\.\d m\n"),
        (PAGE, 5, r"running .*\n39\.\d{6} 116\.\d{6} ±0\.\d m .*Ellipse\(.*running -?\d"),
    ],
    ids=["README", "library"],
)
def test_the_code_runs_from_top_to_bottom(text, count, said, tmp_path, monkeypatch, capsys):
    (tmp_path / "bags").symlink_to(PROJECT / "bags")
    monkeypatch.chdir(tmp_path)
    code = blocks(text)
    assert len(code) == count
    namespace = {}
    for number, block in enumerate(code):
        exec(compile(block, f"block {number}", "exec"), namespace)
    assert re.search(said, capsys.readouterr().out, re.DOTALL)


def test_the_first_example_has_ten_lines():
    body = blocks(README)[0].split("\n\n", 1)[1]
    assert len(body.splitlines()) <= 10


@pytest.mark.parametrize("topic", SENSORS)
def test_the_columns_are_the_present_ones(topic):
    (row,) = (line for line in PAGE.splitlines() if line.startswith("|") and f"`{topic}`" in line)
    _, _, needed, absent, _ = row.split("|")
    columns = SENSORS[topic].columns
    assert re.findall(r"`(\w+)`", needed) == [c.name for c in columns if c.default is None]
    assert re.findall(r"`(\w+)`", absent) == [c.name for c in columns if c.default is not None]


def test_the_columns_of_the_result_are_the_present_ones(flight):
    listed = PAGE.partition("The columns of `table`: ")[2].partition("\n\n")[0]
    assert re.findall(r"`(\w+)`", listed) == list(flight.table)


def test_the_line_of_the_error_is_the_present_one(tables):
    fix = {
        name.replace("latitude_rad", "latitude"): one for name, one in tables["rtk/fix"].items()
    }
    with pytest.raises(tirgeo_ros.TableError) as caught:
        tirgeo_ros.filter_flight(tables["imu/data"], rtk_fix=fix)
    assert f"`{caught.value}`" in PAGE.replace("\n", " ")


def test_the_table_of_names_is_complete():
    table = PAGE.partition("## All names")[2].partition("\n## ")[0]
    assert set(re.findall(r"`(?:tirgeo_ros\.)?(\w+)", table)) >= set(tirgeo_ros.__all__)


def test_what_may_stand_in_place_of_a_column_is_on_the_page():
    others = {name for form in SENSORS.values() for c in form.columns for name in c.others}
    for unit in {re.sub(r"^sigma_(north|east|down)_", "sigma_..._", name) for name in others}:
        pattern = unit.replace("sigma_..._", "sigma_(north|east|down)_")
        pattern = re.sub(r"^\w+_deg$", r"\\w+_deg", pattern)
        assert re.search(f"`{pattern}`", PAGE), unit

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
"""A wrong column in one line; docs/library.md and the README: their code runs, names exist."""

from __future__ import annotations

import re

import numpy as np
import pandas as pd
import pytest
from project import PROJECT

import tirgeo_ros
from tirgeo_ros import TableError
from tirgeo_ros.library.tables import SENSORS, numbers_of

STAMPS = np.arange(3) * 10_000_000
HEADING = {"stamp_ns": STAMPS, "heading_rad": [0.1, 0.2, 0.3], "variance_rad2": np.zeros(3)}
COLUMNS = SENSORS["rtk/heading"].columns


def changed(**columns):
    return {name: item for name, item in (HEADING | columns).items() if item is not None}


@pytest.mark.parametrize(
    ("table", "line"),
    [
        (changed(heading_rad=None), r"heading: no column heading_rad or heading_deg: heading, "),
        (changed(heading_rad=None, headin_rad=STAMPS), r"\(did you mean headin_rad\?\)"),
        (changed(stamp_ns=None), r"heading: no column stamp_ns: time of measurement, ns, int64"),
        (changed(stamp_ns=STAMPS * 1.0), r"stamp_ns must be whole nanoseconds .* float64"),
        (changed(heading_rad=["N", "E", "S"]), r"heading_rad must be numbers; it is <U1"),
        (changed(heading_rad=np.zeros((3, 3))), r"heading_rad needs one number a row, has .*3, 3"),
        (changed(sigma_deg=np.ones(3)), r"columns variance_rad2 and sigma_deg say the same"),
        (changed(heading_rad=[0.1]), r"heading_rad has 1 rows, stamp_ns has 3"),
        (changed(stamp_ns=np.array([0, "NaT", 2], "datetime64[ns]")), r"no time \(NaT\) in row 1"),
        (np.zeros((3, 3)), r"heading: ndarray is not a table: give a dict of arrays"),
        (pd.DataFrame(HEADING).rename(columns={"variance_rad2": "var"}),
         r"no column variance_rad2 or sigma_rad or sigma_deg: .*0 = unknown"),
        (pd.DataFrame(HEADING).set_index("stamp_ns"), r"index is not read; frame.reset_index\("),
    ],
)  # fmt: skip
def test_the_error_names_the_column(table, line):
    with pytest.raises(TableError, match=line):
        numbers_of("heading", table, COLUMNS)


def test_columns_that_belong_together_are_all_there_or_none():
    """Three parts of a quaternion are a mistake: they would be dropped without a word."""
    columns = SENSORS["imu/data"].columns
    table = {"stamp_ns": STAMPS} | {column.name: np.ones(3) for column in columns}
    del table["autopilot_qz"]
    with pytest.raises(TableError, match=r"imu: no column autopilot_qz: "):
        numbers_of("imu", table, columns)


def test_degrees_under_a_name_of_radians_are_warned_of():
    with pytest.warns(UserWarning, match=r"heading_rad has values like 188: .* name it heading_d"):
        numbers_of("heading", changed(heading_rad=[170.0, 188.0, 190.0]), COLUMNS)


def test_stamps_of_pandas_with_a_time_zone_are_those_without():
    stamps = np.arange(3) + 1_634_731_235_000_000_001
    zoned = pd.to_datetime(stamps, utc=True).tz_convert("Europe/Berlin")
    frame = pd.DataFrame(HEADING).assign(stamp_ns=zoned)
    assert numbers_of("heading", frame, COLUMNS).stamps_ns.tolist() == stamps.tolist()


def test_what_may_be_absent_has_its_default():
    imu = dict(zip([c.name for c in SENSORS["imu/data"].columns[:6]], np.eye(6), strict=True))
    result = numbers_of("imu", imu | {"stamp_ns": np.arange(6)}, SENSORS["imu/data"].columns)
    inertial, attitude = np.split(result.rows, [6], axis=1)
    assert np.array_equal(inertial, np.eye(6))
    assert np.isnan(attitude).all()
    assert np.array_equal(result.arrivals_ns, np.arange(6))


@pytest.mark.parametrize("topic", SENSORS)
def test_a_row_is_its_sample(topic):
    """Each column's value comes back in its place: none is swapped or lost."""
    form = SENSORS[topic]
    row = np.arange(1.0, len(form.columns) + 1)
    if topic in {"rtk/fix", "gps/fix", "gimbal/joint_states"}:
        row[0 if topic.endswith("fix") else -1] = 1.0
    sample = form.sample(5, row.tolist())
    assert sample.stamp_ns == 5
    assert list(form.values(sample)) == row.tolist()


def test_a_fix_has_a_symmetric_covariance_and_a_status_of_a_receiver():
    values = [2.0, 0.7, 2.0, 50.0, 1.0, 2.0, 3.0, 0.1, 0.2, 0.3]
    sample = SENSORS["rtk/fix"].sample(0, values)
    assert sample.covariance_n.tolist() == [[1.0, 0.1, 0.2], [0.1, 2.0, 0.3], [0.2, 0.3, 3.0]]
    for status in (2.5, np.nan, 7.0):
        assert SENSORS["rtk/fix"].sample(0, [status, *values[1:]]).status == -1


def test_an_unknown_topic_is_named(tmp_path):
    with pytest.raises(
        TableError, match=r"rtk/velocity: no topic of a sensor \(did you mean rtk/vel"
    ):
        tirgeo_ros.write_bag(tmp_path / "bag.mcap", {"rtk/velocity": HEADING})
    assert list(tmp_path.iterdir()) == []


PAGE = (PROJECT / "docs" / "library.md").read_text()
README = (PROJECT / "README.md").read_text()


def blocks(text):
    return re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)


@pytest.mark.slow
@pytest.mark.usefixtures("sample")
@pytest.mark.parametrize(
    ("text", "count", "output"),
    [
        (README, 1, r"39\.\d{6} 116\.\d{6} ±0\.\d m\n"),
        (PAGE, 5, r"running .*\n39\.\d{6} 116\.\d{6} ±0\.\d m .*Ellipse\(.*running -?\d"),
    ],
    ids=["README", "library"],
)
def test_the_code_runs_from_top_to_bottom(text, count, output, tmp_path, monkeypatch, capsys):
    (tmp_path / "bags").symlink_to(PROJECT / "bags")
    monkeypatch.chdir(tmp_path)
    code = blocks(text)
    assert len(code) == count
    namespace = {}
    for number, block in enumerate(code):
        exec(compile(block, f"block {number}", "exec"), namespace)
    assert re.search(output, capsys.readouterr().out, re.DOTALL)


@pytest.mark.parametrize("topic", SENSORS)
def test_the_columns_are_the_present_ones(topic):
    (row,) = (line for line in PAGE.splitlines() if line.startswith("|") and f"`{topic}`" in line)
    _, _, needed, absent, _ = row.split("|")
    columns = SENSORS[topic].columns
    assert re.findall(r"`(\w+)`", needed) == [c.name for c in columns if c.default is None]
    assert re.findall(r"`(\w+)`", absent) == [c.name for c in columns if c.default is not None]


def test_the_table_of_names_is_complete():
    table = PAGE.partition("## All names")[2].partition("\n## ")[0]
    assert set(re.findall(r"`(?:tirgeo_ros\.)?(\w+)", table)) >= set(tirgeo_ros.__all__)


def test_what_may_stand_in_place_of_a_column_is_on_the_page():
    others = {name for form in SENSORS.values() for c in form.columns for name in c.others}
    for unit in {re.sub(r"^sigma_(north|east|down)_", "sigma_..._", name) for name in others}:
        pattern = unit.replace("sigma_..._", "sigma_(north|east|down)_")
        pattern = re.sub(r"^\w+_deg$", r"\\w+_deg", pattern)
        assert re.search(f"`{pattern}`", PAGE), unit

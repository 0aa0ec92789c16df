"""The experiment over the sample flight and the paper's: numbers, tables, files, the command."""

from __future__ import annotations

import csv
import json
import math
import re

import pytest
from process_bags import METHODS, files
from project import PROJECT

from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.evaluate.evaluate import evaluate
from tirgeo_ros.tools.evaluate.report import text_tables
from tirgeo_ros.tools.evaluate.summary import summary, write_evaluation
from tirgeo_ros.tools.evaluate.verdict import verdict
from tirgeo_ros.tools.simulate import simulate

pytestmark = pytest.mark.slow
ALL = [*METHODS, "calibrated"]


def test_the_methods_come_in_the_order_of_table_6(found):
    assert [one.method for one in found.methods] == ALL
    rmse = [one.errors.rmse_m for one in found.methods[:4]]
    assert rmse == sorted(rmse, reverse=True)
    # what the filter reaches on this flight, to the project's figure for the paper's
    assert found.method("ekf_heading").errors.rmse_m <= 0.8
    assert (found.missing, len(found.tests)) == ({}, 10)
    # of the last method, whose boresight is 5 deg off
    assert found.error.startswith("NO GO: the camera looks 5.0 deg away from its poses")
    heading = {one.method: one.against_truth.heading_rad for one in found.methods}
    assert heading["raw"] > 3 * heading["ekf_heading"]
    assert found.method("ekf_heading").against_truth.position_m < 0.05
    assert found.method("raw").against_truth.position_m > 1


def test_the_boresight_file_overrides_the_parameters(found):
    plain, turned = (found.method(name).setup.configs for name in ("ekf_heading", "calibrated"))
    assert turned.gimbal.boresight_rpy_deg == (0.0, 0.0, 5.0)
    assert plain.gimbal.boresight_rpy_deg == (0.0, 0.0, 0.0)
    assert turned.ekf.method == "ekf_heading"
    told = verdict(found.methods)
    assert told.startswith("0 of 24 lie in their ellipse of 95 %, ")
    assert told.endswith(" deg; run calibrate boresight (calibrated)")
    degrees = float(re.search(r"turned by ([0-9.]+) deg", told)[1])
    assert degrees == pytest.approx(5.0, abs=0.5)  # a tenth is the linear fit's
    honest = verdict(found.methods[:-1])
    assert re.fullmatch(r"2\d of 24 lie in .* 95 %, 0[.]\d\d m off on average \(.*\)", honest)


def test_the_files(found, tmp_path):
    folder = tmp_path / "out" / "deeper"
    written = write_evaluation(found, folder)
    assert sorted(written) == sorted(str(path) for path in folder.iterdir())
    with (folder / "points.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["id", *(f"{method}_rmse_m" for method in ALL), "observations"]
    expected = found.method("rtk").errors.point_rmse_m
    assert {row["id"]: float(row["rtk_rmse_m"]) for row in rows} == pytest.approx(
        expected, abs=5e-5
    )
    with (folder / "observations.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 5 * 25
    refused = [row for row in rows if row["reason"]]
    assert len(refused) == sum(len(one.refused) for one in found.methods) > 0
    assert all(row["distance_m"] == "" for row in refused)
    numbers = json.loads((folder / "result.json").read_text())
    assert numbers["methods"]["raw"]["ce90_m"] == found.method("raw").errors.ce90_m


def test_the_tables(found):
    lines = text_tables(summary(found)).splitlines()
    assert lines[3].split() == ["point", *ALL, "seen"]
    located = next(line for line in lines if line.startswith("located"))
    assert located.split() == ["located", "25", "25", "24", "24", "24", "of", "25"]
    share = next(line for line in lines if line.startswith("in ellipse"))
    assert [word for word in share.split() if word != "%"][2:] == [*["100"] * 4, "0"]
    rmse = found.method("rtk").errors.point_rmse_m["P02"]
    assert next(line for line in lines if line.startswith("P02")).split()[2] == f"{rmse:.3f}"
    start = lines.index("paired t-test on these points, two-sided p-value")
    table = [re.split(r"\s{2,}", line) for line in lines[start + 1 : start + 7]]
    assert table[0][1:] == [row[0] for row in table[1:]] == ALL
    for one in found.tests:
        first, second = ALL.index(one.first) + 1, ALL.index(one.second) + 1
        told = "< 0.0001" if one.p_value < 1e-4 else f"{one.p_value:.4f}"
        assert table[first][second] == table[second][first] == told
    assert "ekf: 1 x no trusted pose at that picture" in lines


def test_the_command(sample, raw_flight, tmp_path, capsys):
    """The same input gives the same files."""
    bag, survey, seen = raw_flight
    words = ["evaluate", bag, "--survey", survey, "--observations", seen]
    words += ["--params", sample / "params.yaml", "--truth", sample / "truth.mcap"]
    assert main([str(word) for word in [*words, "-o", tmp_path / "one"]]) == 0
    said, complaint = capsys.readouterr()
    assert re.match(r"\d+ of \d+ lie in their ellipse of 95 %, .* [(]raw[)]\n", said)
    assert said.splitlines()[3].split() == ["point", "raw", "seen"]
    # the filter would fall back on GPS, but that is no method of Table 6
    assert "ekf is left out: needed topic absent: /rtk/fix" in said
    assert "missing" not in complaint
    assert main([str(word) for word in [*words, "-o", tmp_path / "two", "--json"]]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert next(iter(numbers)) == "verdict"
    assert list(numbers["methods"]) == ["raw"]
    assert list(numbers["missing"]) == METHODS[1:]
    assert len(numbers["output"]) == 4
    for path in (tmp_path / "one").iterdir():
        assert path.read_bytes() == (tmp_path / "two" / path.name).read_bytes()


def test_methods_over_the_papers_flight(tmp_path):
    """The order of Table 6, and the figures that this filter is to reach on the paper's flight."""
    scenario = PROJECT / "config" / "scenarios" / "paper_flight.yaml"
    simulate(scenario, tmp_path, images=False)
    for composition, limit_m in (("paper", 0.8), ("encoders", 0.3)):
        chosen = tmp_path / f"{composition}.yaml"
        chosen.write_text(f"/**/gimbal_node:\n  ros__parameters: {{composition: {composition}}}\n")
        params = [tmp_path / "params.yaml", chosen]
        found = evaluate(*files(tmp_path), params=params, truth=tmp_path / "truth.mcap")
        rmse = [found.method(name).errors.rmse_m for name in METHODS]
        assert rmse == sorted(rmse, reverse=True)
        assert 2.5 < rmse[0] < 8.0  # the paper measured 3.21 and computed 5.8 from these inputs
        assert rmse[3] < limit_m
        assert all(len(one.located) == 60 for one in found.methods)
    proposed, earlier = (found.method(name).against_truth for name in ("ekf_heading", "ekf"))
    limit = math.radians(0.12)
    assert max(proposed.heading_rad, proposed.roll_rad, proposed.pitch_rad) < limit
    assert proposed.position_m < 0.02
    assert earlier.heading_rad > 3 * proposed.heading_rad

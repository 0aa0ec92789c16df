"""tirgeo locate without pixels: targets from one format into another."""

from __future__ import annotations

import json

import pytest
from target_samples import TARGETS

from tirgeo_ros.io.targets.formats import exported, read_targets
from tirgeo_ros.tools.cli.main import main


@pytest.fixture
def targets(tmp_path):
    path = tmp_path / "targets.gpkg"
    path.write_bytes(exported(TARGETS, "gpkg"))
    return path


def run(*words):
    return main([str(word) for word in ("locate", *words)])


@pytest.mark.parametrize("form", ["geojson", "kml", "gpx", "csv"])
def test_each_format_is_what_the_page_exports(form, targets, tmp_path):
    out = tmp_path / f"out.{form}"
    assert run(targets, "-o", out) == 0
    assert out.read_bytes() == exported(TARGETS, form)


def test_a_geopackage_keeps_every_click_and_the_summary_counts(targets, tmp_path, capsys):
    out, kml = tmp_path / "out.gpkg", tmp_path / "out.kml"
    assert run(targets, "-o", out, "--kml", kml, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said == {"input": str(targets), "output": [str(out), str(kml)], "targets": 2}
    assert read_targets(out) == TARGETS
    assert kml.read_bytes() == exported(TARGETS, "kml")


def test_what_is_no_file_of_targets_is_named(targets, tmp_path, capsys):
    flight = tmp_path / "flight.mcap"
    flight.write_bytes(b"\x89MCAP0\r\n")
    assert run(flight, "-o", tmp_path / "x.kml") == 1
    assert "flight.mcap" in (said := capsys.readouterr().err)
    assert "a recorded flight needs --pixels" in said
    assert run(targets, "-o", targets) == 1
    assert "would overwrite the input" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="2"):
        run(targets, "-o", tmp_path / "x.kml", "--cot", tmp_path / "x.xml")
    assert "--cot needs --pixels" in capsys.readouterr().err
    assert not (tmp_path / "x.kml").exists()

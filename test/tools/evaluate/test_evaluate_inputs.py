"""The experiment with other files: what they change, what is missing, what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
from evaluations import RTK, cut, files

from tirgeo_ros.core.types.errors import BagError, CalibrationError, ConfigError, SurveyError
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.surveys.survey import (
    Observation,
    SurveyPoint,
    load_observations,
    load_survey,
    save_observations,
    save_survey,
)
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.evaluate.evaluate import evaluate
from tirgeo_ros.tools.evaluate.summary import summary, write_evaluation

pytestmark = pytest.mark.slow

LATER = "/**/overlay_node:\n  ros__parameters: {ground_height_m: 14.5}\n"


def test_the_same_input_gives_the_same_files(sample, raw_flight, tmp_path):
    texts = []
    for name in ("one", "two"):
        found = evaluate(*raw_flight, params=sample / "params.yaml")
        written = write_evaluation(found, tmp_path / name)
        texts.append([Path(path).read_bytes() for path in written])
    assert len(texts[0]) == 4
    assert texts[0] == texts[1]


def test_utm_scales_the_errors(sample, raw_flight):
    utm, plain = (
        evaluate(*raw_flight, params=sample / "params.yaml", projection=kind)
        for kind in ("utm", "gauss-krueger")
    )
    assert "EPSG:32650" in utm.projection.name
    ratio = utm.method("raw").errors.distance_m / plain.method("raw").errors.distance_m
    # both planes have their meridian at 117 deg: the scales differ by that of UTM alone
    np.testing.assert_allclose(ratio, 0.9996, rtol=1e-7)


def test_a_later_file_of_parameters_stands_before_an_earlier_one(sample, raw_flight, tmp_path):
    later = tmp_path / "later.yaml"
    later.write_text(LATER)
    params = [sample / "params.yaml", later]
    raised = evaluate(*raw_flight, params=params)
    assert raised.method("raw").setup.ground == 14.5
    assert "level at 14.500 m; the observed" in raised.notes[0]
    given = evaluate(*raw_flight, params=params, ground_height=11.0)
    assert given.method("raw").setup.ground == 11.0


def test_on_an_elevation_model(sample, raw_flight, tmp_path):
    rasterio = pytest.importorskip("rasterio", reason="elevation models need rasterio")
    path = tmp_path / "dem.tif"
    shape = {"height": 100, "width": 100, "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    transform = rasterio.transform.from_origin(116.695, 39.855, 1e-4, 1e-4)
    with rasterio.open(path, "w", driver="GTiff", transform=transform, **shape) as out:
        out.write(np.full((1, 100, 100), 11.5, np.float32))
    level = evaluate(*raw_flight, params=sample / "params.yaml")
    raster = evaluate(*raw_flight, params=sample / "params.yaml", dem=path)
    assert raster.method("raw").setup.ground_words == f"elevation model {path}"
    # parabolas along the ray are true to 0.1 mm in height, seen at 10 deg and more
    apart = raster.method("raw").errors.error_en - level.method("raw").errors.error_en
    assert np.abs(apart).max() < 1e-3


def test_an_aircraft_in_a_namespace_on_the_survey_s_ground(raw_flight, tmp_path):
    bag, survey, seen = raw_flight
    with BagWriter(tmp_path / "uav1.mcap") as writer:
        for item in BagReader(bag).messages():
            writer.write(f"/uav1{item.topic}", item.typename, item.data, item.log_time_ns)
    plain = evaluate(bag, survey, seen)
    heights = {p.id: p.height_m for p in load_survey(survey)}
    observed = {one.id for one in load_observations(seen)}
    assert plain.method("raw").setup.ground == np.median([heights[name] for name in observed])
    assert "the median of the survey's heights" in plain.notes[0]
    named = evaluate(tmp_path / "uav1.mcap", survey, seen, namespace="uav1")
    expected = plain.method("raw").errors.error_en
    np.testing.assert_array_equal(named.method("raw").errors.error_en, expected)


def test_a_method_without_its_topic_is_missing_and_the_others_go_on(sample, tmp_path):
    absent = {"/rtk/heading", "/gps/fix", "/thermal/image_raw/compressed"}
    bag = cut(sample / "flight.mcap", tmp_path / "cut.mcap", without=absent, seconds=14)
    found = evaluate(bag, *files(sample)[1:], params=sample / "params.yaml")
    assert [one.method for one in found.methods] == ["rtk", "ekf"]
    assert found.missing["ekf_heading"] == "needed topic absent: /rtk/heading"
    assert "needed topic absent: /gps/fix" in found.missing["raw"]
    numbers = summary(found)
    assert numbers["warning"] is None  # a fact, and no fault
    assert "ekf_heading is left out: needed topic absent: /rtk/heading" in numbers["notes"]
    assert [(t["first"], t["second"]) for t in numbers["t_tests"]] == [("rtk", "ekf")]


def test_a_method_that_never_starts_is_missing(sample, tmp_path):
    """Half a second is too short for the filter to align."""
    bag = cut(sample / "flight.mcap", tmp_path / "short.mcap", seconds=0.5)
    found = evaluate(bag, *files(sample)[1:], params=sample / "params.yaml")
    assert [one.method for one in found.methods] == ["raw", "rtk"]
    assert found.missing["ekf"].startswith("no camera pose could be made: ")
    assert f"ekf is missing: {found.missing['ekf']}" in summary(found)["warning"]
    assert "no observation could be located: no trusted pose" in found.error
    numbers = summary(found)
    assert numbers["methods"]["raw"]["rmse_m"] is None
    assert numbers["t_tests"][0]["note"] == "fewer than 2 points"
    json.dumps(numbers, allow_nan=False)


def test_no_method_at_all_is_an_error(sample, tmp_path):
    bag = cut(sample / "flight.mcap", tmp_path / "cut.mcap", without={"/imu/data"})
    with pytest.raises(CalibrationError, match=r"no method can be run: raw, rtk.*: needed topic"):
        evaluate(bag, *files(sample)[1:], params=sample / "params.yaml")
    bag = cut(sample / "flight.mcap", tmp_path / "lens.mcap", without={"/thermal/camera_info"})
    with pytest.raises(BagError, match="needed topic absent: /thermal/camera_info"):
        evaluate(bag, *files(sample)[1:], params=sample / "params.yaml")
    with pytest.raises(CalibrationError, match=r"/uav1/imu/data"):
        evaluate(*files(sample), namespace="uav1")


def test_what_observations_and_survey_do_not_share_is_told(sample, tmp_path):
    bag = cut(sample / "flight.mcap", tmp_path / "raw.mcap", without=RTK)
    seen = load_observations(sample / "observations.csv")
    odd = Observation(seen[0].id, seen[0].stamp_ns + 4_000_000, seen[0].u, seen[0].v)
    strange = Observation("Q7", seen[0].stamp_ns, 3.0, 4.0)
    save_observations(tmp_path / "seen.csv", [*seen, odd, strange])
    survey = load_survey(sample / "survey.geojson")
    save_survey(tmp_path / "survey.csv", survey)
    found = evaluate(bag, tmp_path / "survey.csv", tmp_path / "seen.csv")
    checks = found.checks
    assert (checks.observations, checks.unknown_ids) == (27, {"Q7": 1})
    assert set(checks.unobserved_ids) == {p.id for p in survey} - {one.id for one in seen}
    assert checks.off_pictures == 1
    assert checks.off_pictures_most_s == pytest.approx(0.004)
    notes = "\n".join(found.notes)
    assert "1 of 27 observations are of points that the survey has not, and left out: Q7" in notes
    assert "1 of 27 observations have a stamp that is no picture's: up to 0.004 s" in notes
    assert sum(point["observations"] for point in summary(found)["points"].values()) == 26


def test_the_survey_of_another_place_is_told(sample, raw_flight, tmp_path):
    survey = [
        SurveyPoint(one.id, one.latitude_rad + math.radians(0.1), one.longitude_rad, one.height_m)
        for one in load_survey(raw_flight[1])
    ]
    save_survey(tmp_path / "survey.csv", survey)
    away = evaluate(
        raw_flight[0],
        tmp_path / "survey.csv",
        raw_flight[2],
        params=sample / "params.yaml",
    )
    # a tenth of a degree of the meridian at 40 deg is 11.10 km
    assert any("points lie 11.1 km from where the survey" in note for note in away.notes)


def test_wrong_use(sample, tmp_path, capsys):
    bag, survey, seen = files(sample)
    words = ["evaluate", bag, "--survey", survey, "--observations", seen, "-o", tmp_path / "out"]
    with pytest.raises(SystemExit, match="2"):
        main([str(word) for word in [*words, "--dem", "d.tif", "--ground-height", "3"]])
    assert "give one" in capsys.readouterr().err
    with pytest.raises(ConfigError, match="boresight"):
        evaluate(*files(sample), boresight=tmp_path / "boresight.yaml")
    (tmp_path / "none.csv").write_text("id,stamp_ns,u,v\n")
    with pytest.raises(SurveyError, match="has no observations"):
        evaluate(bag, survey, tmp_path / "none.csv")
    assert not (tmp_path / "out").exists()

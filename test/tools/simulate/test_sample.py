"""The sample flight in the tree is the one that its scenario makes now."""

from __future__ import annotations

import numpy as np
import pytest
from process_bags import messages_of

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.surveys.survey import load_observations, load_survey
from tirgeo_ros.tools.simulate.files import parameters_text
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.park import lay_out, map_text
from tirgeo_ros.tools.simulate.renderer import targets_of, targets_text
from tirgeo_ros.tools.simulate.scenario import scenario_from
from tirgeo_ros.tools.simulate.survey import sightings, surveyed

START_S, END_S = 35.0, 65.0


@pytest.fixture(scope="module")
def flight():
    return fly(scenario_from({}))


def read(path, topic, convert_one):
    return [convert_one(message) for _, message in messages_of(path, topic)]


def test_its_inertial_data_and_truth_are_the_scenarios(flight, sample):
    said = read(sample / "flight.mcap", "/imu/data", convert.imu_sample)
    start_ns = flight.scenario.start_ns
    flown = [
        s
        for arrival, s in flight.samples
        if isinstance(s, ImuSample) and START_S * 1e9 <= arrival - start_ns <= END_S * 1e9
    ]
    assert [s.stamp_ns for s in said] == [s.stamp_ns for s in flown]
    for field in ("specific_force_b", "angular_rate_b"):
        np.testing.assert_allclose(
            [getattr(s, field) for s in said], [getattr(s, field) for s in flown], atol=1e-9
        )
    true = read(sample / "truth.mcap", "/tirgeo/odometry", convert.body_pose)
    rows = np.isin(flight.truth.stamp_ns, [pose.stamp_ns for pose in true])
    # Earth-fixed coordinates are good to a nanometre.
    np.testing.assert_allclose(
        [pose.position_n for pose in true], flight.truth.position_p[rows], atol=1e-7
    )


def test_its_map_survey_and_parameters_are_the_scenarios(flight, sample):
    park = lay_out(flight.scenario.park, flight.seed)
    assert (sample / "map.geojson").read_text(encoding="utf-8") == map_text(park, flight.plane)
    assert (sample / "params.yaml").read_text() == parameters_text(flight.scenario)
    points, clicks = surveyed(flight, XT2, park)
    assert [p.id for p in load_survey(sample / "survey.geojson")] == [p.id for p in points]
    start_ns = flight.scenario.start_ns
    inside = [c for c in clicks if START_S * 1e9 <= c.stamp_ns - start_ns <= END_S * 1e9]
    stored = load_observations(sample / "observations.csv")
    assert [(c.id, c.stamp_ns) for c in stored] == [(c.id, c.stamp_ns) for c in inside]
    np.testing.assert_allclose(
        [(c.u, c.v) for c in stored], [(c.u, c.v) for c in inside], atol=1e-3
    )


def test_its_operator_clicks_on_the_person(flight, sample):
    targets = targets_of(flight.scenario, flight.seed)
    told = (sample / "targets.geojson").read_text()
    assert told == targets_text(targets, flight.plane)
    ((stamp_ns, u, v),) = read(sample / "flight.mcap", "/tirgeo/locate/pixel", convert.pixel)
    (seen,) = (
        one
        for one in sightings(flight, XT2, targets)
        if START_S * 1e9 <= one.stamp_ns - flight.scenario.start_ns <= END_S * 1e9
    )
    assert (stamp_ns, u, v) == (seen.stamp_ns, pytest.approx(seen.u), pytest.approx(seen.v))

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
"""A scenario's flight as files: complete, repeatable, cut; the sample flight; joint orders."""

from __future__ import annotations

import json

import numpy as np
import pytest
from process_bags import messages_of
from project import PROJECT

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import BagPlayerConfig, DjiConfig, EkfConfig, OverlayConfig
from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.core.types.measurements import USUAL_ORDER, ImuSample
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.parameters.parameter_file import ParameterFile, load_yaml
from tirgeo_ros.io.surveys.survey import load_observations, load_survey
from tirgeo_ros.tools.cli.main import main
from tirgeo_ros.tools.replay.graph_outputs import differences
from tirgeo_ros.tools.replay.process import process
from tirgeo_ros.tools.simulate import fly, scenario_from, simulate
from tirgeo_ros.tools.simulate.files import parameters_text
from tirgeo_ros.tools.simulate.park import lay_out, map_text
from tirgeo_ros.tools.simulate.renderer import targets_of, targets_text
from tirgeo_ros.tools.simulate.scenario import Scenario, load_scenario
from tirgeo_ros.tools.simulate.survey import sightings, surveyed

SHORT = """\
duration_s: 6.0
route: {hover_s: 1.0}
park: {resolution_m: 0.2}
survey: {points: 4, after_s: 0.0, apart_s: 0.5}
"""
NAMES = {
    *("flight.mcap", "truth.mcap", "map.geojson", "survey.geojson", "targets.geojson"),
    *("observations.csv", "params.yaml"),
}
TOPICS = {
    "flight.mcap": "imu/data gps/fix gps/vel rtk/fix rtk/vel rtk/heading gimbal/joint_states "
    "gimbal/attitude thermal/image_raw/compressed thermal/camera_info",
    "truth.mcap": "tirgeo/odometry tirgeo/camera_pose tirgeo/origin tirgeo/fix",
}


@pytest.fixture(scope="module")
def scenario_path(tmp_path_factory):
    path = tmp_path_factory.mktemp("scenario") / "short.yaml"
    path.write_text(SHORT)
    return path


@pytest.fixture(scope="module")
def whole(scenario_path, tmp_path_factory):
    folder = tmp_path_factory.mktemp("whole")
    return folder, simulate(scenario_path, folder)


def test_every_file_is_there_with_the_contracts_topics(whole):
    folder, summary = whole
    assert {path.name for path in folder.iterdir()} == NAMES
    assert (summary["control_points"], summary["observations"]) == (4, 12)
    assert summary["messages"]["imu/data"] == 601
    # 9 Hz from the start, as long as the pictures arrive (50 ms later) within the 6 s.
    assert summary["messages"]["thermal/image_raw/compressed"] == 54
    for name, topics in TOPICS.items():
        expected = {f"/{topic}": TOPIC_TYPES[topic] for topic in topics.split()}
        assert BagReader(folder / name).topics() == expected


def test_a_window_is_a_cut_of_the_whole(whole, scenario_path, tmp_path):
    """So a seed always gives the same bytes."""
    folder, start_s, duration_s = whole[0], 2.0, 2.5
    simulate(scenario_path, tmp_path, start_s=start_s, duration_s=duration_s)
    start_ns = scenario_from({}).start_ns + round(start_s * 1e9)
    window = range(start_ns, start_ns + round(duration_s * 1e9) + 1)
    for name in ("flight.mcap", "truth.mcap"):
        of_whole, of_cut = (
            [
                (m.topic, m.log_time_ns, m.data)
                for m in BagReader(path / name).messages()
                if m.log_time_ns in window and m.topic != "/tirgeo/origin"
            ]
            for path in (folder, tmp_path)
        )
        assert of_cut == of_whole
        assert BagReader(tmp_path / name).span_ns[1] <= window[-1]
    for name in ("map.geojson", "survey.geojson", "params.yaml"):
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes()
    clicks = load_observations(folder / "observations.csv")
    inside = [click for click in clicks if click.stamp_ns in window]
    assert load_observations(tmp_path / "observations.csv") == inside
    assert 0 < len(inside) < 12


def test_parameters_fit_the_flight(whole):
    path, scenario = whole[0] / "params.yaml", scenario_from({})
    ekf = ParameterFile(path).config("ekf_node", EkfConfig)
    assert ekf.aircraft == scenario.aircraft
    assert ekf.origin_lat_lon_h == (39.85, 116.7, 11.5)
    assert ekf.imu.angle_random_walk == scenario.imu.noise.angle_random_walk
    overlay = ParameterFile(path).config("overlay_node", OverlayConfig)
    assert (overlay.ground_height_m, overlay.video_latency_s) == (11.5, 0.05)
    dji = ParameterFile(path).config("dji_node", DjiConfig)
    player = ParameterFile(path).config("bag_player", BagPlayerConfig)
    assert dji.geoid_undulation_m == player.simulated_aircraft.geoid_undulation_m == -9.0
    assert dji.rtk.delay_s == scenario.rtk.arrival_delay_s


@pytest.mark.parametrize(
    ("start_s", "duration_s"), [(-1.0, 2.0), (0.0, 0.0), (3.0, 4.0), (7.0, None), (np.nan, 1.0)]
)
def test_a_window_outside_the_flight_is_refused(scenario_path, tmp_path, start_s, duration_s):
    with pytest.raises(ScenarioError, match=r"short.yaml: .* are not within the flight of 6 s"):
        simulate(scenario_path, tmp_path / "out", start_s=start_s, duration_s=duration_s)
    assert not (tmp_path / "out").exists()


def test_the_verb_and_too_many_control_points(scenario_path, tmp_path, capsys):
    arguments = ["-o", str(tmp_path / "out"), "--no-images", "--seed", "5", "--json"]
    assert main(["simulate", str(scenario_path), *arguments]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert (summary["seed"], summary["messages"]["rtk/fix"]) == (5, 30)
    path = tmp_path / "greedy.yaml"
    path.write_text(SHORT.replace("points: 4", "points: 900"))
    with pytest.raises(ScenarioError, match=r"survey.points: 900 are wanted, but only \d+ corner"):
        simulate(path, tmp_path / "out", images=False)


PAPER = PROJECT / "config" / "scenarios" / "paper_flight.yaml"


def leaves(tree, prefix=""):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


def test_the_paper_flights_file_states_all_defaults():
    assert load_scenario(PAPER) == Scenario()
    unsaid = {p.name for p in parameters_of(Scenario)} - set(leaves(load_yaml(PAPER)))
    # The filter's own belief of turn-on biases is no property of the flight.
    assert unsaid == {"imu.noise.gyro_turn_on_bias", "imu.noise.accel_turn_on_bias"}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("route:\n  sped_m_s: 3", r"bad.yaml: unknown parameter route.sped_m_s .*speed_m_s"),
        ("route:\n  speed_m_s: fast", r"bad.yaml: parameter route.speed_m_s: 'fast' is not"),
        ("duration_s: -3", r"bad.yaml: parameter duration_s: -3 s is outside"),
        ("rtk: 5", r"bad.yaml: unknown parameter rtk"),
        ("start_utc: noon", r"bad.yaml: start_utc: 'noon' is not a time such as"),
        ("rtk:\n  second_antenna_m: [-0.1, 0.3, 0]", r"bad.yaml: .* too little for a heading"),
        ("park:\n  north_m: [9, -9]", r"bad.yaml: park.north_m: 9 to -9 is smaller than one cell"),
        ("video:\n  bits: 12", r"bad.yaml: parameter video.bits: 12 is neither 8 nor 16"),
        ("video:\n  distortion: [9, -99, 0, 0]", r"bad.yaml: video: .* lens model .* folds"),
        (
            "scene:\n  people_at: [1, 2, 3]",
            r"bad.yaml: parameter scene.people_at: needs 0, 4, 8, ... or 400 numbers, has 3",
        ),
        ("- 1", r"bad.yaml: is not a scenario"),
        ("seed: 1\nseed: 2", r"bad.yaml: line 2: not YAML: key seed appears twice"),
    ],
)
def test_a_bad_scenario_is_refused_with_file_and_key(tmp_path, text, message):
    path = tmp_path / "bad.yaml"
    path.write_text(text)
    with pytest.raises(ScenarioError, match=message):
        load_scenario(path)


START_S, END_S = 35.0, 65.0


@pytest.fixture(scope="module")
def flight():
    return fly(scenario_from({}))


def read(path, topic, convert_one):
    return [convert_one(message) for _, message in messages_of(path, topic)]


def test_its_inertial_data_and_truth_are_the_scenarios(flight, sample):
    recorded = read(sample / "flight.mcap", "/imu/data", convert.imu_sample)
    start_ns = flight.scenario.start_ns
    flown = [
        s
        for arrival, s in flight.samples
        if isinstance(s, ImuSample) and START_S * 1e9 <= arrival - start_ns <= END_S * 1e9
    ]
    assert [s.stamp_ns for s in recorded] == [s.stamp_ns for s in flown]
    for field in ("specific_force_b", "angular_rate_b"):
        np.testing.assert_allclose(
            [getattr(s, field) for s in recorded], [getattr(s, field) for s in flown], atol=1e-9
        )
    true = read(sample / "truth.mcap", "/tirgeo/odometry", convert.body_pose)
    rows = np.isin(flight.truth.stamp_ns, [pose.stamp_ns for pose in true])
    # Earth-fixed coordinates are good to a nanometre.
    np.testing.assert_allclose(
        [pose.position_n for pose in true], flight.truth.position_p[rows], atol=1e-7
    )


def test_its_map_survey_parameters_and_click_are_the_scenarios(flight, sample):
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
    targets = targets_of(flight.scenario, flight.seed)
    assert (sample / "targets.geojson").read_text() == targets_text(targets, flight.plane)
    ((stamp_ns, u, v),) = read(sample / "flight.mcap", "/tirgeo/locate/pixel", convert.pixel)
    (click,) = (
        click
        for click in sightings(flight, XT2, targets)
        if START_S * 1e9 <= click.stamp_ns - start_ns <= END_S * 1e9
    )
    assert (stamp_ns, u, v) == (click.stamp_ns, pytest.approx(click.u), pytest.approx(click.v))


def processed(folder, order):
    """Return estimated minus true camera poses of a flight with an order of the joints."""
    scenario, flown, out = (folder / f"{order}{end}" for end in (".yaml", "", ".mcap"))
    gimbal = f"gimbal: {{joint_order: {order}}}"
    scenario.write_text(f"duration_s: 40.0\nroute: {{hover_s: 2.0}}\n{gimbal}\n")
    simulate(scenario, flown, images=False)
    process(flown / "flight.mcap", out, params=flown / "params.yaml", images=False)
    computed, true = (
        read(path, "/tirgeo/camera_pose", convert.camera_pose)
        for path in (out, flown / "truth.mcap")
    )
    return differences(computed, true)


@pytest.mark.slow
def test_processing_finds_the_true_camera_as_exactly_as_with_the_usual_order(tmp_path):
    usual, other = (processed(tmp_path, order) for order in (USUAL_ORDER, "pitch-yaw-roll"))
    assert len(other.stamp_ns) == len(usual.stamp_ns) > 1500
    # The filter errs as before; the encoders' 0.02 deg are about other axes.
    per_pose = np.degrees(np.abs(other.angle_rad - usual.angle_rad))
    assert np.max(per_pose) < 0.02 * 2 * 4.5
    rms_deg = np.degrees([np.sqrt(np.mean(item.angle_rad**2)) for item in (usual, other)])
    assert rms_deg[1] == pytest.approx(rms_deg[0], rel=0.05)

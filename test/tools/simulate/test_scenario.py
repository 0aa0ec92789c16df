"""Scenarios are read strictly, and the file of the paper's flight states every default."""

from __future__ import annotations

import pytest
from project import PROJECT

from tirgeo_ros.core.config.schema import parameters_of
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.tools.simulate.scenario import Scenario, load_scenario

PAPER = PROJECT / "config" / "scenarios" / "paper_flight.yaml"


def leaves(tree, prefix=""):
    for key, value in tree.items():
        if isinstance(value, dict):
            yield from leaves(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}"


def test_the_paper_flight_is_the_default_and_says_so_in_full():
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
        ("route:\n  shape: spiral", r"bad.yaml: .*route.shape: 'spiral' is not one of lawnmower"),
        ("start_utc: noon", r"bad.yaml: start_utc: 'noon' is not a time such as"),
        ("start_utc: 2040-01-01T00:00:00Z", r"bad.yaml: start_utc: 2040.* outside 1970 to 2038"),
        ("rtk:\n  lever_arm_m: [1, 2]", r"bad.yaml: parameter rtk.lever_arm_m: needs 3 numbers"),
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

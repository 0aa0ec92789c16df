"""Define a scenario, the input of a simulated flight, read strictly from YAML.

The defaults are the flight of Ren et al. 2022 (sections 4.2 to 5.2); its scenario file is
``config/scenarios/paper_flight.yaml``. Lever arms are in ROS's axes (forward, left, up), as in the
parameters of the nodes.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime, timezone

from tirgeo_ros.core.config import AircraftConfig
from tirgeo_ros.core.config.schema import config_from, group, param, parameters_of
from tirgeo_ros.core.types.errors import CameraError, ConfigError, ScenarioError
from tirgeo_ros.io.parameters.parameter_file import load_yaml
from tirgeo_ros.tools.simulate import scenario_aircraft as flown
from tirgeo_ros.tools.simulate import scenario_ground as seen

_LAST_SECOND = 2**31 - 10  # a ROS stamp holds 2**31 - 1; the rest is for late arrivals


@dataclass(frozen=True, slots=True)
class Scenario:
    """Hold the parameters of a whole flight."""

    name: str = param("paper_flight", "name of the flight")
    seed: int = param(2205, "of all random numbers", ("", 0, 2**31))
    start_utc: str = param("2021-10-20T12:00:00Z", "first instant, ISO 8601")
    duration_s: float = param(107.0, "length of the flight", ("s", 1, 7200))
    site: seen.SiteScenario = group(seen.SiteScenario)
    route: flown.RouteScenario = group(flown.RouteScenario)
    wind: flown.WindScenario = group(flown.WindScenario)
    imu: flown.ImuScenario = group(flown.ImuScenario)
    rtk: flown.RtkScenario = group(flown.RtkScenario)
    heading: flown.HeadingScenario = group(flown.HeadingScenario)
    gps: flown.GpsScenario = group(flown.GpsScenario)
    barometer: flown.BarometerScenario = group(flown.BarometerScenario)
    autopilot: flown.AutopilotScenario = group(flown.AutopilotScenario)
    gimbal: flown.GimbalScenario = group(flown.GimbalScenario)
    video: seen.VideoScenario = group(seen.VideoScenario)
    park: seen.ParkScenario = group(seen.ParkScenario)
    scene: seen.SceneScenario = group(seen.SceneScenario)
    survey: seen.SurveyScenario = group(seen.SurveyScenario)

    @property
    def aircraft(self) -> AircraftConfig:
        """Return the places of antennas, gimbal and camera as the nodes' parameters."""
        return AircraftConfig(
            rtk_antenna_m=self.rtk.lever_arm_m,
            second_antenna_m=self.rtk.second_antenna_m,
            gps_antenna_m=self.gps.lever_arm_m,
            gimbal_pivot_m=self.gimbal.lever_arm_m,
            camera_from_pivot_m=self.gimbal.camera_offset_m,
        )

    @property
    def start_ns(self) -> int:
        """Return the first instant in ns of Unix time; raise ScenarioError."""
        text = self.start_utc.replace("Z", "+00:00")
        try:
            start = datetime.fromisoformat(text)
        except ValueError:
            raise ScenarioError(
                f"start_utc: {self.start_utc!r} is not a time such as 2021-10-20T12:00:00Z"
            ) from None
        start = start if start.tzinfo else start.replace(tzinfo=timezone.utc)
        second = int(start.timestamp())
        if not 0 <= second <= _LAST_SECOND - self.duration_s:
            raise ScenarioError(f"start_utc: {self.start_utc} is outside 1970 to 2038")
        return second * 1_000_000_000


_GROUPS = {p.name.rpartition(".")[0] for p in parameters_of(Scenario)}


def load_scenario(path: str | os.PathLike[str]) -> Scenario:
    """Return the scenario of a YAML file; ScenarioError names the file and the key."""
    try:
        tree = load_yaml(path)
    except ConfigError as error:
        raise ScenarioError(str(error)) from None
    if not isinstance(tree, Mapping):
        raise ScenarioError(f"{path}: is not a scenario (a mapping of keys to values)")
    return scenario_from(dict(_flat(tree, "")), str(path))


def scenario_from(values: Mapping[str, object], where: str = "") -> Scenario:
    """Return a scenario from dotted values, the others at their defaults; raise ScenarioError."""
    try:
        scenario = config_from(Scenario, values, where)
    except ConfigError as error:
        raise ScenarioError(str(error)) from None
    try:
        _check(scenario)
    except ScenarioError as error:
        raise ScenarioError(f"{where}: {error}" if where else str(error)) from None
    return scenario


def _check(scenario: Scenario) -> None:
    """Raise ScenarioError for what a range of one parameter cannot express."""
    _ = scenario.start_ns
    try:
        _ = scenario.aircraft.baseline_b, scenario.video.camera
    except ConfigError as error:
        raise ScenarioError(str(error)) from None
    except CameraError as error:
        raise ScenarioError(f"video: {error}") from None
    if scenario.video.bits not in {8, 16}:
        raise ScenarioError(f"parameter video.bits: {scenario.video.bits} is neither 8 nor 16")
    for name in ("north_m", "east_m"):
        low, high = getattr(scenario.park, name)
        if high - low < scenario.park.cell_m:
            raise ScenarioError(
                f"park.{name}: {low:g} to {high:g} is smaller than one cell of "
                f"{scenario.park.cell_m:g} "
                "m; give the lower end first"
            )


def _flat(tree: Mapping[object, object], prefix: str) -> Iterator[tuple[str, object]]:
    for key, value in tree.items():
        name = f"{prefix}{key}"
        if isinstance(value, Mapping) and (value or name in _GROUPS):
            yield from _flat(value, name + ".")
        else:
            yield name, value

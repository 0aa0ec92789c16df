"""Write the files of a simulated flight with truth from a scenario: ``tirgeo simulate``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import yaml

from tirgeo_ros.core.config.schema import values_of
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.core.types.joint_orders import USUAL_ORDER
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder, write_files
from tirgeo_ros.io.surveys.survey import Observation, save_observations, save_survey
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.simulate.bags import write_flight, write_truth
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.ground import paint
from tirgeo_ros.tools.simulate.map_file import map_text
from tirgeo_ros.tools.simulate.park import Park, lay_out
from tirgeo_ros.tools.simulate.relief import WGS84_TEXT, Relief, elevation_text
from tirgeo_ros.tools.simulate.renderer import Renderer
from tirgeo_ros.tools.simulate.scenario import Scenario, load_scenario
from tirgeo_ros.tools.simulate.survey import sightings, surveyed
from tirgeo_ros.tools.simulate.targets import Target, targets_of, targets_text

NAMES = (
    *("flight.mcap", "truth.mcap", "map.geojson", "survey.geojson", "targets.geojson"),
    *("observations.csv", "params.yaml"),
)
#: Files written beside NAMES if the ground is not level.
ELEVATION = ("dem.asc", "dem.prj")
_CLEAR_M = 3.0  # smallest height above all ground
_HEAD = """\
# The nodes' parameters for the simulated flight {name}, written by 'tirgeo simulate'.
# They make 'map' the plane of truth.mcap. The map itself is given by --map or map:=.
"""
#: Priors of the filter, which are no properties of the flight.
_PRIORS = {"gyro_turn_on_bias", "accel_turn_on_bias"}


class _Scene(NamedTuple):
    """Hold what stands on the ground."""

    scenario: Scenario
    park: Park
    targets: list[Target]
    relief: Relief

    def write(self, folder: Path, plane: TangentPlane) -> None:
        """Write map, targets, parameters and, if the ground is not level, elevation model."""
        texts = {
            "map.geojson": map_text(self.park, plane, self.relief),
            "targets.geojson": targets_text(self.targets, plane, self.relief),
            "params.yaml": parameters_text(self.scenario),
        }
        if not self.relief.is_level:
            texts |= {"dem.asc": elevation_text(self.relief, plane), "dem.prj": WGS84_TEXT}
        write_files({folder / name: text for name, text in texts.items()}, ScenarioError)

    def drawn(
        self, flight: SimulatedFlight, *, images: bool
    ) -> tuple[Renderer | None, Sequence[Observation]]:
        """Return what renders the pictures, if any, and the clicks on their targets."""
        if not images:
            return None, []
        video = self.scenario.video
        ground = paint(self.park, self.scenario.park, flight.seed)
        renderer = Renderer(video.camera, ground, video, self.targets, self.relief)
        return renderer, sightings(flight, video.camera, self.targets)


def simulate(
    scenario_path: PathLike,
    out_dir: PathLike,
    *,
    seed: int | None = None,
    joint_order: str | None = None,
    barometer_hz: float | None = None,
    start_s: float = 0.0,
    duration_s: float | None = None,
    images: bool = True,
    progress: Report = silent,
) -> dict[str, object]:
    """Fly a scenario and write NAMES into ``out_dir``; the same seed gives the same bytes.

    ``joint_order`` and ``barometer_hz`` override the scenario's. ``start_s`` and ``duration_s``
    cut bags and observations, and nothing else. Return what was written. Raise ScenarioError, and
    BagError or SurveyError if files cannot be written.
    """
    outputs = [Path(out_dir) / name for name in (*NAMES, *ELEVATION)]
    check_outputs([scenario_path], outputs, ScenarioError)
    scenario = _scenario(scenario_path, joint_order, barometer_hz)
    window = _window(scenario, scenario_path, start_s, duration_s)
    flight = fly(scenario, seed)
    park = lay_out(scenario.park, flight.seed)
    points, clicks = surveyed(flight, scenario.video.camera, park)
    clicks = [click for click in clicks if click.stamp_ns in window]
    targets, relief = targets_of(scenario, flight.seed), Relief(scenario.park)
    scene = _Scene(scenario, park, targets, relief)
    _check_clear(flight, relief)
    folder = made_folder(out_dir, ScenarioError)
    scene.write(folder, flight.plane)
    save_survey(folder / "survey.geojson", points)
    save_observations(folder / "observations.csv", clicks)
    write_truth(folder / "truth.mcap", flight, window)
    drawn = (scenario.video.camera, *scene.drawn(flight, images=images))
    counts = write_flight(folder / "flight.mcap", flight, window, *drawn, progress)
    return {
        "folder": str(folder),
        "scenario": scenario.name,
        "seed": flight.seed,
        "duration_s": (len(window) - 1) / 1e9,
        "control_points": len(points),
        "observations": len(clicks),
        "targets": len(targets),
        "messages": counts,
        "bytes": {name: (folder / name).stat().st_size for name in NAMES},
    }


def _scenario(path: PathLike, joint_order: str | None, barometer_hz: float | None) -> Scenario:
    """Return a scenario with what overrides its own values."""
    scenario = load_scenario(path)
    if joint_order is not None:
        scenario = replace(scenario, gimbal=replace(scenario.gimbal, joint_order=joint_order))
    if barometer_hz is not None:
        scenario = replace(scenario, barometer=replace(scenario.barometer, rate_hz=barometer_hz))
    return scenario


def _window(scenario: Scenario, path: PathLike, start_s: float, duration_s: float | None) -> range:
    """Return the log times (ns) that are written. Raise ScenarioError outside the flight."""
    if duration_s is None:
        duration_s = scenario.duration_s - start_s
    end_s = start_s + duration_s
    if not (start_s >= 0 and duration_s > 0 and end_s <= scenario.duration_s + 1e-9):  # nor nan
        raise ScenarioError(
            f"{path}: no {duration_s:g} s from {start_s:g} s on in a flight of "
            f"{scenario.duration_s:g} s; change the start or the duration"
        )
    start_ns = scenario.start_ns + round(start_s * 1e9)
    return range(start_ns, start_ns + round(duration_s * 1e9) + 1)


def _check_clear(flight: SimulatedFlight, relief: Relief) -> None:
    """Raise ScenarioError if the ground could be as high as the aircraft."""
    lowest_m = -float(flight.truth.position_p[:, 2].max())
    if relief.highest_m > lowest_m - _CLEAR_M:
        raise ScenarioError(
            f"park: its ground rises to {relief.highest_m:.1f} m, and the flight is as low as "
            f"{lowest_m:.1f} m: fly {_CLEAR_M:g} m above it, or make slope_deg less"
        )


def parameters_text(scenario: Scenario) -> str:
    """Return a ROS 2 parameter file: the aircraft for all nodes, then each node's own part."""
    site, order = scenario.site, scenario.gimbal.joint_order
    noise = values_of(scenario.imu.noise).items()
    imu = {name: _plain(value) for name, value in noise if name not in _PRIORS}
    if scenario.imu.averages:
        imu["delay_s"] = 0.5 / scenario.imu.rate_hz  # its group delay
    joints: dict[str, object] = {} if order == USUAL_ORDER else {"joint_order": order}
    straight = not any(scenario.gimbal.boresight_rpy_deg)
    # For ground that is not level the user gives --dem.
    ground = {} if scenario.park.slope_deg else {"ground_height_m": site.ground_height_m}
    undulation = {"geoid_undulation_m": site.geoid_undulation_m}
    places = values_of(scenario.aircraft).items()
    nodes: dict[str, dict[str, object]] = {
        # An empty list has no type in a parameter file.
        "/**": {"aircraft": {name: _plain(value) for name, value in places if value != ()}},
        "/**/dji_node": {
            **undulation,
            "rtk": {"delay_s": scenario.rtk.arrival_delay_s},
            "delay": {"gps_s": scenario.gps.arrival_delay_s},
        },
        "/**/ekf_node": {
            "origin_lat_lon_h": [site.latitude_deg, site.longitude_deg, site.ground_height_m],
            "imu": imu,
        },
        "/**/gimbal_node": joints | ({"boresight_rpy_deg": [0.0] * 3} if straight else {}),
        "/**/overlay_node": {**ground, "video_latency_s": scenario.video.latency_s},
        "/**/bag_player": {"simulated_aircraft": {**undulation, **joints}},
    }
    tree = {pattern: {"ros__parameters": values} for pattern, values in nodes.items() if values}
    body: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=95)
    return _HEAD.format(name=scenario.name) + body


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value

"""The parameters with which the nodes fit a simulated flight.

They are what the integrator of such an aircraft knows. A boresight error of the scenario is not
among them: ``tirgeo calibrate boresight`` finds it.
"""

from __future__ import annotations

import yaml

from tirgeo_ros.core.config import SimulatedAircraftConfig
from tirgeo_ros.core.parameter import values_of
from tirgeo_ros.tools.simulate.scenario import Scenario

_HEAD = """\
# The nodes' parameters for the simulated flight {name}, written by 'tirgeo simulate'.
# They make 'map' the plane of truth.mcap. The map itself is given by --map or map:=.
"""
_IMU = (
    "angle_random_walk",
    "velocity_random_walk",
    "gyro_bias_instability",
    "gyro_bias_time_s",
    "accel_bias_instability",
    "accel_bias_time_s",
)


def parameters_text(scenario: Scenario) -> str:
    """A ROS 2 parameter file."""
    nodes = {
        "dji_node": _dji(scenario),
        "ekf_node": _ekf(scenario),
        "gimbal_node": {
            "lever_arm_m": list(scenario.gimbal.lever_arm_m),
            "camera_offset_m": list(scenario.gimbal.camera_offset_m),
        },
        "overlay_node": {
            "ground_height_m": scenario.site.ground_height_m,
            "video_latency_s": scenario.video.latency_s,
        },
        "bag_player": {"aircraft": _aircraft(scenario)},
    }
    tree = {f"/**/{node}": {"ros__parameters": values} for node, values in nodes.items()}
    body: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=95)
    return _HEAD.format(name=scenario.name) + body


def _aircraft(scenario: Scenario) -> dict[str, object]:
    """What an aircraft is like that says the flight in DJI's protocol."""
    return {
        "geoid_undulation_m": scenario.site.geoid_undulation_m,
        "baseline_offset_deg": SimulatedAircraftConfig().baseline_offset_deg,
    }


def _dji(scenario: Scenario) -> dict[str, object]:
    """How to understand that aircraft."""
    told = _aircraft(scenario)
    return {
        "geoid_undulation_m": told["geoid_undulation_m"],
        "heading": {"baseline_offset_deg": told["baseline_offset_deg"]},
        "rtk": {"delay_s": scenario.rtk.arrival_delay_s},
        "delay": {"gps_s": scenario.gps.arrival_delay_s},
    }


def _ekf(scenario: Scenario) -> dict[str, object]:
    site, noise = scenario.site, values_of(scenario.imu.noise)
    return {
        "origin_lat_lon_h": [site.latitude_deg, site.longitude_deg, site.ground_height_m],
        "imu": {name: _plain(noise[name]) for name in _IMU},
        "rtk": {"lever_arm_m": list(scenario.rtk.lever_arm_m)},
        "heading": {"offset_deg": scenario.heading.offset_deg},
        "gps": {"lever_arm_m": list(scenario.gps.lever_arm_m)},
    }


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value

"""Write the nodes' parameters for a simulated flight.

They are what the integrator of such an aircraft knows. A boresight error of the scenario is not
written, because ``tirgeo calibrate boresight`` finds it; only a boresight of zero is written.
"""

from __future__ import annotations

import yaml

from tirgeo_ros.core.config.schema import values_of
from tirgeo_ros.core.types.joint_orders import USUAL_ORDER
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
    """Return a ROS 2 parameter file: the aircraft for all nodes, then each node's own part."""
    site = scenario.site
    nodes: dict[str, dict[str, object]] = {
        "/**": {"aircraft": _places(scenario)},
        "/**/dji_node": {
            "geoid_undulation_m": site.geoid_undulation_m,
            "rtk": {"delay_s": scenario.rtk.arrival_delay_s},
            "delay": {"gps_s": scenario.gps.arrival_delay_s},
        },
        "/**/ekf_node": _ekf(scenario),
        **_gimbal(scenario),
        "/**/overlay_node": _ground(scenario) | {"video_latency_s": scenario.video.latency_s},
        "/**/bag_player": {
            "simulated_aircraft": {"geoid_undulation_m": site.geoid_undulation_m}
            | _joint_order(scenario)
        },
    }
    tree = {pattern: {"ros__parameters": values} for pattern, values in nodes.items()}
    body: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=95)
    return _HEAD.format(name=scenario.name) + body


def _ground(scenario: Scenario) -> dict[str, object]:
    """Return the height of level ground; for other ground the user gives ``--dem``."""
    is_level = not (scenario.park.slope_deg or scenario.park.hills_m)
    return {"ground_height_m": scenario.site.ground_height_m} if is_level else {}


def _places(scenario: Scenario) -> dict[str, object]:
    """Return the places that are set: an empty list has no type in a parameter file."""
    places = values_of(scenario.aircraft)
    return {name: _plain(value) for name, value in places.items() if value != ()}


def _ekf(scenario: Scenario) -> dict[str, object]:
    site, noise = scenario.site, values_of(scenario.imu.noise)
    return {
        "origin_lat_lon_h": [site.latitude_deg, site.longitude_deg, site.ground_height_m],
        "imu": {name: _plain(noise[name]) for name in _IMU} | _imu_delay(scenario),
    }


def _gimbal(scenario: Scenario) -> dict[str, dict[str, object]]:
    """Return the camera's mounting if it is exactly known, and an unusual joint order."""
    values = _joint_order(scenario)
    if not any(scenario.gimbal.boresight_rpy_deg):
        values["boresight_rpy_deg"] = [0.0, 0.0, 0.0]
    return {"/**/gimbal_node": values} if values else {}


def _joint_order(scenario: Scenario) -> dict[str, object]:
    """Return the order of the gimbal's joints if it is not the usual one."""
    order = scenario.gimbal.joint_order
    return {} if order == USUAL_ORDER else {"joint_order": order}


def _imu_delay(scenario: Scenario) -> dict[str, object]:
    """Return the group delay of an IMU that averages."""
    return {"delay_s": 0.5 / scenario.imu.rate_hz} if scenario.imu.averages else {}


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value

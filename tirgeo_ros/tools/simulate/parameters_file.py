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
    *("angle_random_walk", "velocity_random_walk", "gyro_bias_instability", "gyro_bias_time_s"),
    *("accel_bias_instability", "accel_bias_time_s"),
)


def parameters_text(scenario: Scenario) -> str:
    """Return a ROS 2 parameter file: the aircraft for all nodes, then each node's own part."""
    site, noise = scenario.site, values_of(scenario.imu.noise)
    places = values_of(scenario.aircraft)
    imu = {name: _plain(noise[name]) for name in _IMU}
    if scenario.imu.averages:
        imu["delay_s"] = 0.5 / scenario.imu.rate_hz  # its group delay
    order = scenario.gimbal.joint_order
    joints: dict[str, object] = {} if order == USUAL_ORDER else {"joint_order": order}
    gimbal = dict(joints)
    if not any(scenario.gimbal.boresight_rpy_deg):
        gimbal["boresight_rpy_deg"] = [0.0, 0.0, 0.0]
    # For ground that is not level the user gives --dem.
    is_level = not (scenario.park.slope_deg or scenario.park.hills_m)
    ground = {"ground_height_m": site.ground_height_m} if is_level else {}
    undulation = {"geoid_undulation_m": site.geoid_undulation_m}
    nodes: dict[str, dict[str, object]] = {
        # An empty list has no type in a parameter file.
        "/**": {"aircraft": {k: _plain(value) for k, value in places.items() if value != ()}},
        "/**/dji_node": {
            **undulation,
            "rtk": {"delay_s": scenario.rtk.arrival_delay_s},
            "delay": {"gps_s": scenario.gps.arrival_delay_s},
        },
        "/**/ekf_node": {
            "origin_lat_lon_h": [site.latitude_deg, site.longitude_deg, site.ground_height_m],
            "imu": imu,
        },
        "/**/gimbal_node": gimbal,
        "/**/overlay_node": {**ground, "video_latency_s": scenario.video.latency_s},
        "/**/bag_player": {"simulated_aircraft": {**undulation, **joints}},
    }
    tree = {pattern: {"ros__parameters": values} for pattern, values in nodes.items() if values}
    body: str = yaml.safe_dump(tree, sort_keys=False, default_flow_style=None, width=95)
    return _HEAD.format(name=scenario.name) + body


def _plain(value: object) -> object:
    return list(value) if isinstance(value, tuple) else value

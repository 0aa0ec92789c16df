"""Write the nodes' parameters for a simulated flight: what the integrator of it knows.

A boresight error of the scenario is not written, because ``tirgeo calibrate boresight`` finds it;
only a boresight of zero is written.
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
#: Priors of the filter, which are no properties of the flight.
_PRIORS = {"gyro_turn_on_bias", "accel_turn_on_bias"}


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

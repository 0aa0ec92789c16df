"""Filter the tables of a bag through the public interface."""

from __future__ import annotations

import tirgeo_ros

#: filter_flight's argument -> the topic of its table.
ARGUMENTS = {
    "rtk_fix": "rtk/fix",
    "rtk_velocity": "rtk/vel",
    "heading": "rtk/heading",
    "gps_fix": "gps/fix",
    "gps_velocity": "gps/vel",
    "joints": "gimbal/joint_states",
    "camera_attitude": "gimbal/attitude",
}


def filtered(tables, **others):
    """Filter all tables of a bag."""
    given = {name: tables[topic] for name, topic in ARGUMENTS.items() if topic in tables}
    return tirgeo_ros.filter_flight(tables["imu/data"], **(given | others))

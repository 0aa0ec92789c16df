"""The table of faults: how each is planted, and what a finding must name."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from dev.planted_faults.changes import (
    changed_map,
    half_size,
    joints,
    late,
    level_dem,
    longer_lens,
    lowered,
    ned_velocity,
    next_zone,
    no_covariance,
    points,
    scaled,
    swapped,
    swapped_tilt,
)
from dev.planted_faults.planting import (
    FlightFiles,
    Planter,
    altered,
    both,
    left_out,
    parameters,
    restamped,
    rewritten,
    turned_yaw,
    with_map,
)

#: Height of the geoid above the ellipsoid in central Europe: heights above sea level are less.
GEOID_M = 47.0
_GROUND_M = 11.5  # of the sample's site, ellipsoidal
_G = 9.80665
_JOINTS, _CAMERA_INFO = "gimbal/joint_states", "thermal/camera_info"
_PICTURES = "thermal/image_raw/compressed"
_RTK = ("rtk/fix", "rtk/vel", "rtk/heading")


class ShownFrom(Enum):
    """From when on data can show a fault; the value is for a person to read."""

    AT_ONCE = "the first samples"
    MOVING_PICTURES = "the first camera pose: it takes pictures that move"
    TURNS = "40 deg of turns"


@dataclass(frozen=True)
class Fault:
    """One fault; ``names``: one of these must be in the parameter that a finding names."""

    name: str
    names: tuple[str, ...]
    plant: Planter
    shown: ShownFrom = ShownFrom.AT_ONCE  # from when on, at the earliest


def _no_params(good: FlightFiles, _folder: Path) -> FlightFiles:
    return dataclasses.replace(good, params=[])


_DEG = math.degrees(1.0)
_ANTENNAS = {
    "aircraft__rtk_antenna_m": [0.1, -0.32, -0.38],
    "aircraft__second_antenna_m": [1.1, -0.32, -0.38],
}
_PIVOT = ("gimbal/joint_states",)

FAULTS: tuple[Fault, ...] = (
    Fault(
        "boresight",
        ("boresight_rpy_deg",),
        parameters("gimbal_node", boresight_rpy_deg=[0.0, 5.0, 0.0]),
        ShownFrom.MOVING_PICTURES,
    ),
    Fault(
        "latency",
        ("video_latency_s",),
        parameters("overlay_node", video_latency_s=0.35),
        ShownFrom.MOVING_PICTURES,
    ),
    Fault(
        "ground above sea level",
        ("ground_height_m",),
        parameters("overlay_node", ground_height_m=_GROUND_M - GEOID_M),
        ShownFrom.MOVING_PICTURES,
    ),
    Fault(
        "DEM above sea level", ("dem",), level_dem(_GROUND_M - GEOID_M), ShownFrom.MOVING_PICTURES
    ),
    Fault(
        "fixes above sea level",
        ("rtk/fix", "geoid_undulation_m"),
        altered(lowered(GEOID_M), "rtk/fix"),
    ),
    Fault(
        "wrong K", (_CAMERA_INFO,), altered(longer_lens, _CAMERA_INFO), ShownFrom.MOVING_PICTURES
    ),
    Fault("wrong size", (_CAMERA_INFO,), altered(half_size, _CAMERA_INFO)),
    Fault("roll and pitch swapped", _PIVOT, altered(joints(swapped_tilt), _JOINTS)),
    Fault(
        "joints in degrees",
        _PIVOT,
        altered(joints(lambda all_: {k: _DEG * v for k, v in all_.items()}), _JOINTS),
    ),
    Fault(
        "pitch sign",
        _PIVOT,
        altered(joints(lambda all_: all_ | {"pitch": -all_["pitch"]}), _JOINTS),
    ),
    Fault(
        "heading 90 deg",
        ("rtk/heading", "second_antenna_m"),
        altered(lambda m: turned_yaw(m.orientation, lambda yaw: yaw + math.pi / 2), "rtk/heading"),
    ),
    Fault("lever arm sign", ("rtk_antenna_m",), parameters("", **_ANTENNAS), ShownFrom.TURNS),
    Fault(
        "gyroscopes in deg/s", ("imu/data",), altered(scaled("angular_velocity", _DEG), "imu/data")
    ),
    Fault(
        "acceleration in g",
        ("imu/data",),
        altered(scaled("linear_acceleration", 1 / _G), "imu/data"),
    ),
    Fault("UTM zone", ("map",), with_map(next_zone)),
    Fault("no params", ("--params",), _no_params),
    # Own ones.
    Fault("latitude and longitude swapped", ("map",), with_map(changed_map(swapped))),
    Fault(
        "heading sign",
        ("rtk/heading",),
        altered(lambda m: turned_yaw(m.orientation, lambda yaw: -yaw), "rtk/heading"),
        ShownFrom.TURNS,
    ),
    Fault("NED velocity", ("rtk/vel",), altered(ned_velocity, "rtk/vel")),
    Fault("covariance 0", ("rtk/fix",), altered(no_covariance, "rtk/fix")),
    Fault(
        "image stamps 0",
        ("thermal/image_raw",),
        altered(lambda m: restamped(m.header, None), _PICTURES),
    ),
    Fault("RTK 0.6 s late", ("rtk", "delay_s"), rewritten(late, *_RTK), ShownFrom.TURNS),
    Fault("no camera_info", (_CAMERA_INFO,), left_out(_CAMERA_INFO)),
    Fault(
        "gimbal of another type",
        ("gimbal/joint_states",),
        both(rewritten(points, _JOINTS), left_out("gimbal/attitude")),
    ),
)

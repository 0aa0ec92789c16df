"""The table of faults: how each is planted, and what a finding must name."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from dev.planted_faults.planting import (
    FlightFiles,
    Planter,
    altered,
    both,
    changed_map,
    half_size,
    heading_off,
    joints,
    late,
    left_out,
    level_dem,
    longer_lens,
    lowered,
    mounted,
    moved,
    ned_velocity,
    next_zone,
    no_covariance,
    parameters,
    pictures,
    points,
    restamped,
    rewritten,
    scaled,
    swapped,
    swapped_tilt,
    turned_yaw,
    with_map,
    yaw_from_north,
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
    word: str = ""  # must be in what the finding says
    flipped: tuple[int, ...] = ()  # of its pictures' axes: 0 down, 1 across


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
    Fault("RTK 0.6 s late", ("rtk", "delay_s"), late(0.6, *_RTK), ShownFrom.TURNS),
    Fault("no camera_info", (_CAMERA_INFO,), left_out(_CAMERA_INFO)),
    Fault(
        "gimbal of another type",
        ("gimbal/joint_states",),
        both(rewritten(points, _JOINTS), left_out("gimbal/attitude")),
    ),
)

_IMU, _AHEAD = ("imu_rpy_deg", "imu/data"), ("rtk/heading", "second_antenna_m")
_SEEN, _LATE = ("thermal/image_raw",), ("video_latency_s", "thermal/image_raw")


def _tilted(name: str, *rpy_deg: float, word: str = "") -> Fault:
    return Fault(f"IMU {name}", _IMU, altered(mounted(*rpy_deg), "imu/data"), word=word)


def _pictures_late(by_s: float) -> Fault:
    plant = late(by_s, _PICTURES)
    return Fault(f"pictures {by_s} s late", _LATE, plant, ShownFrom.MOVING_PICTURES)


def _heading_off(by_deg: float) -> Fault:
    plant = altered(heading_off(by_deg), "rtk/heading")
    return Fault(f"headings {by_deg:g} deg off", _AHEAD, plant, ShownFrom.TURNS)


def _boresight(by_deg: float) -> Fault:
    plant = parameters("gimbal_node", boresight_rpy_deg=[0.0, by_deg, 0.0])
    name = f"boresight {by_deg:g} deg"
    return Fault(name, ("boresight_rpy_deg",), plant, ShownFrom.MOVING_PICTURES)


def _flipped(name: str, *axes: int) -> Fault:
    plant = altered(pictures(*axes), _PICTURES)
    return Fault(name, _SEEN, plant, ShownFrom.MOVING_PICTURES, name, axes)


#: Smaller ones, and what is seldom wrong. A boresight below 2.5 deg and a map that lies metres
#: off cannot be told yet.
FAULTS += (
    _tilted("tilted by 5 deg", 0.0, 5.0, 0.0),
    _tilted("tilted by 10 deg", 10.0, 0.0, 0.0),
    _tilted("tilted by 20 deg", 0.0, 20.0, 0.0),
    _tilted("turned by 90 deg", 0.0, 0.0, 90.0, word="90"),
    *map(_pictures_late, (0.2, 0.3, 0.4, 0.5)),
    *map(_heading_off, (4.0, 7.0)),
    *map(_boresight, (2.0, 3.0)),
    _flipped("mirrored", 1),
    _flipped("upside down", 0, 1),
    Fault("yaw from north", _PIVOT, yaw_from_north),
    Fault("gimbal 0.3 s late", ("gimbal",), late(0.3, _JOINTS, "gimbal/attitude"), word="0.3"),
    Fault(
        "latency 0.25 for 0.05",
        ("video_latency_s",),
        parameters("overlay_node", video_latency_s=0.25),
        ShownFrom.MOVING_PICTURES,
    ),
    Fault(
        "RTK antenna 1 m off",
        ("rtk_antenna_m",),
        parameters(
            "",
            aircraft__rtk_antenna_m=[-1.1, 0.32, 0.38],
            aircraft__second_antenna_m=[-0.1, 0.32, 0.38],
        ),
        ShownFrom.TURNS,
    ),
    Fault(
        "RTK velocities of zero",
        ("rtk/vel",),
        altered(scaled("twist.twist.linear", 0.0), "rtk/vel"),
    ),
    Fault("map 10 m off", ("map",), with_map(changed_map(moved))),
)

"""The table of faults: how each is planted, and what a finding must name."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.io.bag import Cdr
from tirgeo_ros.tools.planted_faults.planting import (
    Flight,
    Item,
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


class Shown(Enum):
    """From when on data can show a fault; the value is for a person to read."""

    AT_ONCE = "the first samples"
    MOVING_PICTURES = "the first camera pose: it takes pictures that move"
    TURNS = "40 deg of turns"


@dataclass(frozen=True)
class Fault:
    """One fault; ``names``: one of these must be in the parameter that a finding names."""

    name: str
    planted: str  # what a person would have done
    names: tuple[str, ...]
    plant: Planter
    shown: Shown = Shown.AT_ONCE  # from when on, at the earliest


def _scaled(field: str, factor: float) -> Callable[[Any], None]:
    def change(message: Any) -> None:
        vector = getattr(message, field)
        vector.x, vector.y, vector.z = (factor * v for v in (vector.x, vector.y, vector.z))

    return change


def _joints(change: Callable[[dict[str, float]], dict[str, float]]) -> Callable[[Any], None]:
    def changed(message: Any) -> None:
        angles = dict(zip(message.name, map(float, message.position), strict=True))
        new = change({name.split("_")[1]: angle for name, angle in angles.items()})
        message.position = np.array([new[name.split("_")[1]] for name in message.name])

    return changed


def _swapped_tilt(angles: dict[str, float]) -> dict[str, float]:
    return angles | {"roll": angles["pitch"], "pitch": angles["roll"]}


def _higher(message: Any) -> None:
    message.altitude -= GEOID_M


def _longer_lens(message: Any) -> None:
    message.k = message.k * np.array([1.5, 1, 1, 1, 1.5, 1, 1, 1, 1])


def _half_size(message: Any) -> None:
    message.width, message.height = message.width // 2, message.height // 2
    message.k = message.k * np.array([0.5, 1, 0.5, 1, 0.5, 0.5, 1, 1, 1])


def _ned_velocity(message: Any) -> None:
    linear = message.twist.twist.linear
    linear.x, linear.y, linear.z = linear.y, linear.x, -linear.z


def _no_covariance(message: Any) -> None:
    message.position_covariance = np.zeros(9)


def _late(item: Item) -> Iterator[Item]:
    """Stamped at an arrival 0.6 s after the measurement."""
    restamped(item.message.header, 600_000_000)
    yield dataclasses.replace(item, log_time_ns=item.log_time_ns + 600_000_000)


def _points(item: Item) -> Iterator[Item]:
    """The joints as a point, as some gimbal drivers send them."""
    typename = "geometry_msgs/msg/Vector3Stamped"
    kind = Cdr().types(typename)
    vector = Cdr().types("geometry_msgs/msg/Vector3")(*map(float, item.message.position[:3]))
    yield dataclasses.replace(
        item, typename=typename, message=kind(header=item.message.header, vector=vector)
    )


def _each_place(change: Callable[[list[Any]], list[Any]]) -> Callable[[Any], Any]:
    def walk(value: Any) -> Any:
        if value and isinstance(value[0], int | float):
            return change(value)
        return [walk(inner) for inner in value]

    return walk


def _changed_map(change: Callable[[list[Any]], list[Any]], crs: str = "") -> Callable[[str], str]:
    def changed(text: str) -> str:
        tree, walk = json.loads(text), _each_place(change)
        for feature in tree["features"]:
            geometry = feature["geometry"]
            geometry["coordinates"] = walk(geometry["coordinates"])
        if crs:
            tree["crs"] = {"type": "name", "properties": {"name": crs}}
        return json.dumps(tree)

    return changed


def _swapped(place: list[Any]) -> list[Any]:
    return [place[1], place[0], *place[2:]]


def _next_zone(text: str) -> str:
    """Put a map into UTM zone 50, and say that it is zone 51."""
    import pyproj  # noqa: PLC0415 heavy

    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32650", always_xy=True)
    return _changed_map(
        lambda place: [*to_utm.transform(*place[:2]), *place[2:]], "urn:ogc:def:crs:EPSG::32651"
    )(text)


def _dem(good: Flight, folder: Path) -> Flight:
    """Give a level DEM in heights above sea level, without its undulation."""
    import rasterio  # noqa: PLC0415 an extra

    path = folder / "dem.tif"
    west, north, step = 116.69, 39.86, 1e-4
    profile = {"crs": "EPSG:4326", "transform": rasterio.Affine(step, 0, west, 0, -step, north)}
    size = {"count": 1, "height": 200, "width": 200, "dtype": "float32"}
    with rasterio.open(path, "w", driver="GTiff", **size, **profile) as out:
        out.write(np.full((1, 200, 200), _GROUND_M - GEOID_M, np.float32))
    return dataclasses.replace(good, options={"dem": path})


def _no_params(good: Flight, _folder: Path) -> Flight:
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
        "boresight_rpy_deg 5 deg of pitch that is not there",
        ("boresight_rpy_deg",),
        parameters("gimbal_node", boresight_rpy_deg=[0.0, 5.0, 0.0]),
        Shown.MOVING_PICTURES,
    ),
    Fault(
        "latency",
        "video_latency_s 0.35, and it is 0.05",
        ("video_latency_s",),
        parameters("overlay_node", video_latency_s=0.35),
        Shown.MOVING_PICTURES,
    ),
    Fault(
        "ground above sea level",
        f"ground_height_m less by {GEOID_M:g} m",
        ("ground_height_m",),
        parameters("overlay_node", ground_height_m=_GROUND_M - GEOID_M),
        Shown.MOVING_PICTURES,
    ),
    Fault(
        "DEM above sea level",
        f"a DEM less by {GEOID_M:g} m",
        ("dem",),
        _dem,
        Shown.MOVING_PICTURES,
    ),
    Fault(
        "fixes above sea level",
        f"rtk/fix lower by {GEOID_M:g} m",
        ("rtk/fix", "geoid_undulation_m"),
        altered(_higher, "rtk/fix"),
    ),
    Fault(
        "wrong K",
        "focal lengths of camera_info times 1.5",
        (_CAMERA_INFO,),
        altered(_longer_lens, _CAMERA_INFO),
        Shown.MOVING_PICTURES,
    ),
    Fault(
        "wrong size",
        "camera_info of half the size",
        (_CAMERA_INFO,),
        altered(_half_size, _CAMERA_INFO),
    ),
    Fault(
        "roll and pitch swapped",
        "joints of roll and pitch swapped",
        _PIVOT,
        altered(_joints(_swapped_tilt), _JOINTS),
    ),
    Fault(
        "joints in degrees",
        "joint angles in degrees",
        _PIVOT,
        altered(_joints(lambda all_: {k: _DEG * v for k, v in all_.items()}), _JOINTS),
    ),
    Fault(
        "pitch sign",
        "pitch joint with the other sign",
        _PIVOT,
        altered(_joints(lambda all_: all_ | {"pitch": -all_["pitch"]}), _JOINTS),
    ),
    Fault(
        "heading 90 deg",
        "rtk/heading turned by 90 deg",
        ("rtk/heading", "second_antenna_m"),
        altered(lambda m: turned_yaw(m.orientation, lambda yaw: yaw + math.pi / 2), "rtk/heading"),
    ),
    Fault(
        "lever arm sign",
        "both antennas with the other sign",
        ("rtk_antenna_m",),
        parameters("", **_ANTENNAS),
        Shown.TURNS,
    ),
    Fault(
        "gyroscopes in deg/s",
        "angular_velocity in deg/s",
        ("imu/data",),
        altered(_scaled("angular_velocity", _DEG), "imu/data"),
    ),
    Fault(
        "acceleration in g",
        "linear_acceleration in g",
        ("imu/data",),
        altered(_scaled("linear_acceleration", 1 / _G), "imu/data"),
    ),
    Fault("UTM zone", "the map in UTM 50, named 51", ("map",), with_map(_next_zone)),
    Fault("no params", "no parameter file", ("--params",), _no_params),
    # Own ones.
    Fault(
        "latitude and longitude swapped",
        "the map's coordinates swapped",
        ("map",),
        with_map(_changed_map(_swapped)),
    ),
    Fault(
        "heading sign",
        "rtk/heading counted clockwise",
        ("rtk/heading",),
        altered(lambda m: turned_yaw(m.orientation, lambda yaw: -yaw), "rtk/heading"),
        Shown.TURNS,
    ),
    Fault("NED velocity", "rtk/vel in NED", ("rtk/vel",), altered(_ned_velocity, "rtk/vel")),
    Fault(
        "covariance 0",
        "position_covariance of rtk/fix all 0",
        ("rtk/fix",),
        altered(_no_covariance, "rtk/fix"),
    ),
    Fault(
        "image stamps 0",
        "stamps of the pictures all 0",
        ("thermal/image_raw",),
        altered(lambda m: restamped(m.header, None), _PICTURES),
    ),
    Fault(
        "RTK 0.6 s late",
        "RTK arrives 0.6 s later and is stamped so",
        ("rtk", "delay_s"),
        rewritten(_late, *_RTK),
        Shown.TURNS,
    ),
    Fault("no camera_info", "camera_info not recorded", (_CAMERA_INFO,), left_out(_CAMERA_INFO)),
    Fault(
        "gimbal of another type",
        "joint angles as Vector3Stamped, no reported attitude",
        ("gimbal/joint_states",),
        both(rewritten(_points, _JOINTS), left_out("gimbal/attitude")),
    ),
)

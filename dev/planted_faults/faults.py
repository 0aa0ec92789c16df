# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The table of faults: how each is planted in a good flight, and what a finding must name.

A planted flight has its bag, its parameters or its map written anew.
"""

from __future__ import annotations

import dataclasses
import json
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.parameters.parameter_file import Value, parameters_yaml


@dataclass(frozen=True)
class Item:
    """A decoded message of a bag."""

    topic: str
    typename: str
    message: Any
    log_time_ns: int


#: What becomes of a message: items in its place, none where it is left out.
Change = Callable[[Item], Iterator[Item]]


@dataclass(frozen=True)
class FlightFiles:
    """The files of a flight, in the arguments of ``tirgeo check``."""

    bag: Path
    params: list[Path]
    map: Path | None = None
    options: Mapping[str, Any] = field(default_factory=dict)

    @property
    def arguments(self) -> dict[str, Any]:
        """Return the keyword arguments of ``check``."""
        return {"bag": self.bag, "params": self.params, "map": self.map, **self.options}

    @classmethod
    def in_folder(cls, folder: Path) -> FlightFiles:
        """Return the flight that ``tirgeo simulate`` has written to a folder."""
        return cls(folder / "flight.mcap", [folder / "params.yaml"], folder / "map.geojson")


#: What makes a faulty flight of a good one, with a folder for its files.
Planter = Callable[[FlightFiles, Path], FlightFiles]


def altered(change: Callable[[Any], object], *topics: str) -> Planter:
    """Return a planter that changes the messages of topics in place."""

    def changed(item: Item) -> Iterator[Item]:
        change(item.message)
        yield item

    return rewritten(changed, *topics)


def rewritten(change: Change, *topics: str) -> Planter:
    """Return a planter that puts what ``change`` makes in the place of topics' messages."""

    def plant(good: FlightFiles, folder: Path) -> FlightFiles:
        cdr, items = Cdr(), []
        for raw in BagReader(good.bag).messages():
            data: Any = raw.data
            made: list[Item] = [Item(raw.topic, raw.typename, data, raw.log_time_ns)]
            if raw.topic.strip("/") in topics:
                message = cdr.deserialize(data, raw.typename)
                made = list(change(dataclasses.replace(made[0], message=message)))
            items += made
        path = folder / "flight.mcap"
        with BagWriter(path) as writer:
            for item in sorted(items, key=lambda item: item.log_time_ns):
                writer.write(item.topic, item.typename, item.message, item.log_time_ns)
        return dataclasses.replace(good, bag=path)

    return plant


def left_out(*topics: str) -> Planter:
    """Return a planter that leaves topics out."""
    return rewritten(lambda _: iter(()), *topics)


def parameters(node: str, **values: Value) -> Planter:
    """Return a planter that sets parameters; two underscores stand for a dot."""

    def plant(good: FlightFiles, folder: Path) -> FlightFiles:
        path = folder / f"{node or 'all'}.yaml"
        dotted = {name.replace("__", "."): value for name, value in values.items()}
        path.write_text(parameters_yaml({node: dotted}, "planted"))
        return dataclasses.replace(good, params=[*good.params, path])

    return plant


def with_map(change: Callable[[str], str]) -> Planter:
    """Return a planter that changes the map's text."""

    def plant(good: FlightFiles, folder: Path) -> FlightFiles:
        assert good.map is not None
        path = folder / "map.geojson"
        path.write_text(change(good.map.read_text(encoding="utf-8")), encoding="utf-8")
        return dataclasses.replace(good, map=path)

    return plant


def restamped(header: Any, shift_ns: int | None) -> None:
    """Move a stamp in place; None: to 0."""
    stamp_ns = header.stamp.sec * 10**9 + header.stamp.nanosec
    moved_ns = 0 if shift_ns is None else stamp_ns + shift_ns
    header.stamp.sec, header.stamp.nanosec = divmod(moved_ns, 10**9)


def turned_yaw(q: Any, turn: Callable[[float], float]) -> None:
    """Give a quaternion about the vertical another yaw (rad, ENU), in place."""
    yaw = turn(2 * math.atan2(q.z, q.w))
    q.x, q.y, q.z, q.w = 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)


#: Changes a message in place.
MessageChange = Callable[[Any], None]


def scaled(field: str, factor: float) -> MessageChange:
    """Return a change of a vector of a message by a factor."""

    def change(message: Any) -> None:
        vector = operator.attrgetter(field)(message)
        vector.x, vector.y, vector.z = (factor * v for v in (vector.x, vector.y, vector.z))

    return change


JointsChange = Callable[[dict[str, float]], dict[str, float]]


def joints(change: JointsChange) -> MessageChange:
    """Return a change of joint angles (rad) by the axis that they turn."""

    def changed(message: Any) -> None:
        angles = dict(zip(message.name, map(float, message.position), strict=True))
        new = change({name.split("_")[1]: angle for name, angle in angles.items()})
        message.position = np.array([new[name.split("_")[1]] for name in message.name])

    return changed


def setting(**values: Callable[[Any], Any]) -> MessageChange:
    """Return a change of fields of a message to what functions of the message return."""

    def change(message: Any) -> None:
        for name, value in values.items():
            setattr(message, name, value(message))

    return change


def scaled_k(factor: float, middle: float = 1.0) -> Callable[[Any], Any]:
    """Return what makes K of a message's: focal lengths and principal point by factors."""
    return lambda m: m.k * np.array([factor, 1, middle, 1, factor, middle, 1, 1, 1])


def ned_velocity(message: Any) -> None:
    """Put an ENU velocity into NED."""
    linear = message.twist.twist.linear
    linear.x, linear.y, linear.z = linear.y, linear.x, -linear.z


def late(seconds: float, *topics: str) -> Planter:
    """Return a planter that lets messages arrive later, and stamps them so."""
    shift_ns = round(seconds * 1e9)

    def change(item: Item) -> Iterator[Item]:
        restamped(item.message.header, shift_ns)
        yield dataclasses.replace(item, log_time_ns=item.log_time_ns + shift_ns)

    return rewritten(change, *topics)


def mounted(roll_deg: float, pitch_deg: float, yaw_deg: float) -> MessageChange:
    """Return a change of the samples of an IMU to those of one that is turned about its axes."""
    from scipy.spatial.transform import Rotation  # noqa: PLC0415 heavy

    turn = Rotation.from_euler("ZYX", [yaw_deg, pitch_deg, roll_deg], degrees=True).inv()

    def change(message: Any) -> None:
        for vector in (message.angular_velocity, message.linear_acceleration):
            vector.x, vector.y, vector.z = turn.apply([vector.x, vector.y, vector.z])

    return change


def yaw_from_north(good: FlightFiles, folder: Path) -> FlightFiles:
    """Count the gimbal's yaw from north, not from the nose."""
    nose_rad = 0.0

    def change(item: Item) -> Iterator[Item]:
        nonlocal nose_rad
        if item.topic.endswith("imu/data"):
            q = item.message.orientation
            nose_rad = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
        else:
            turn_rad = nose_rad - math.pi / 2
            joints(lambda all_: all_ | {"yaw": all_["yaw"] + turn_rad})(item.message)
        yield item

    return rewritten(change, "imu/data", "gimbal/joint_states")(good, folder)


def pictures(*axes: int) -> MessageChange:
    """Return a change of JPEG pictures, flipped along axes (0 down, 1 across)."""

    def change(message: Any) -> None:
        import cv2  # noqa: PLC0415 heavy

        pixels: Any = cv2.imdecode(message.data, cv2.IMREAD_UNCHANGED)
        pixels = np.flip(pixels, axes)
        message.data = cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 80])[1].ravel()

    return change


def points(item: Item) -> Iterator[Item]:
    """Send joints as a point, as some gimbal drivers do, and no attitude."""
    if item.topic.endswith("attitude"):
        return
    typename = "geometry_msgs/msg/Vector3Stamped"
    kind = Cdr().types(typename)
    vector = Cdr().types("geometry_msgs/msg/Vector3")(*map(float, item.message.position[:3]))
    yield dataclasses.replace(
        item, typename=typename, message=kind(header=item.message.header, vector=vector)
    )


def changed_map(change: Callable[[list[Any]], list[Any]], crs: str = "") -> Callable[[str], str]:
    """Return a change of all places of a map's text, and of its CRS."""

    def walk(value: Any) -> Any:
        if value and isinstance(value[0], int | float):
            return change(value)
        return [walk(inner) for inner in value]

    def changed(text: str) -> str:
        tree = json.loads(text)
        for feature in tree["features"]:
            geometry = feature["geometry"]
            geometry["coordinates"] = walk(geometry["coordinates"])
        if crs:
            tree["crs"] = {"type": "name", "properties": {"name": crs}}
        return json.dumps(tree)

    return changed


def next_zone(text: str) -> str:
    """Put a map into UTM zone 50, and say that it is zone 51."""
    import pyproj  # noqa: PLC0415 heavy

    to_utm = pyproj.Transformer.from_crs("EPSG:4326", "EPSG:32650", always_xy=True)
    return changed_map(
        lambda place: [*to_utm.transform(*place[:2]), *place[2:]], "urn:ogc:def:crs:EPSG::32651"
    )(text)


def level_dem(height_m: float) -> Planter:
    """Return a planter that gives a level DEM of a height, without its undulation."""

    def plant(good: FlightFiles, folder: Path) -> FlightFiles:
        import rasterio  # noqa: PLC0415 an extra

        path = folder / "dem.tif"
        with rasterio.open(
            path,
            "w",
            driver="GTiff",
            count=1,
            dtype="float32",
            crs="EPSG:4326",
            height=200,
            width=200,
            transform=rasterio.Affine(1e-4, 0, 116.69, 0, -1e-4, 39.86),
        ) as out:
            out.write(np.full((1, 200, 200), height_m, np.float32))
        return dataclasses.replace(good, options={"dem": path})

    return plant


#: Height of the geoid above the ellipsoid in central Europe: heights above sea level are less.
GEOID_M = 47.0
_GROUND_M = 11.5  # of the sample's site, ellipsoidal
_JOINTS, _CAMERA_INFO = "gimbal/joint_states", "thermal/camera_info"
_GIMBAL = (_JOINTS,)
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


_DEG = math.degrees(1.0)
_MOVES, _TURNS = ShownFrom.MOVING_PICTURES, ShownFrom.TURNS


def _antennas(*place_m: float) -> Planter:
    second_m = [place_m[0] + 1.0, *place_m[1:]]
    places = {"aircraft__rtk_antenna_m": [*place_m], "aircraft__second_antenna_m": second_m}
    return parameters("", **places)


_IMU, _AHEAD = ("imu_rpy_deg", "imu/data"), ("rtk/heading", "second_antenna_m")
_LATE = ("video_latency_s", "thermal/image_raw")


def _tilted(name: str, *rpy_deg: float, word: str = "") -> Fault:
    return Fault(f"IMU {name}", _IMU, altered(mounted(*rpy_deg), "imu/data"), word=word)


def _heading_off(by_deg: float) -> Fault:
    by_rad = math.radians(by_deg)
    plant = altered(lambda m: turned_yaw(m.orientation, lambda yaw: yaw - by_rad), "rtk/heading")
    return Fault(f"headings {by_deg:g} deg off", _AHEAD, plant, _TURNS)


def _boresight(by_deg: float) -> Fault:
    plant = parameters("gimbal_node", boresight_rpy_deg=[0.0, by_deg, 0.0])
    return Fault(f"boresight {by_deg:g} deg", ("boresight_rpy_deg",), plant, _MOVES)


def _latency(name: str, latency_s: float) -> Fault:
    plant = parameters("overlay_node", video_latency_s=latency_s)
    return Fault(name, ("video_latency_s",), plant, _MOVES)


def _joint_fault(name: str, change: JointsChange) -> Fault:
    return Fault(name, _GIMBAL, altered(joints(change), _JOINTS))


def _flipped(name: str, *axes: int) -> Fault:
    plant = altered(pictures(*axes), _PICTURES)
    return Fault(name, ("thermal/image_raw",), plant, _MOVES, name, axes)


FAULTS: tuple[Fault, ...] = (
    _latency("latency", 0.35),
    Fault(
        "ground above sea level",
        ("ground_height_m",),
        parameters("overlay_node", ground_height_m=_GROUND_M - GEOID_M),
        _MOVES,
    ),
    Fault("DEM above sea level", ("dem",), level_dem(_GROUND_M - GEOID_M), _MOVES),
    Fault(
        "fixes above sea level",
        ("rtk/fix", "geoid_undulation_m"),
        altered(setting(altitude=lambda m: m.altitude - GEOID_M), "rtk/fix"),
    ),
    Fault("wrong K", (_CAMERA_INFO,), altered(setting(k=scaled_k(1.5)), _CAMERA_INFO), _MOVES),
    Fault(
        "wrong size",
        (_CAMERA_INFO,),
        altered(
            setting(
                k=scaled_k(0.5, 0.5), width=lambda m: m.width // 2, height=lambda m: m.height // 2
            ),
            _CAMERA_INFO,
        ),
    ),
    _joint_fault(
        "roll and pitch swapped",
        lambda all_: all_ | {"roll": all_["pitch"], "pitch": all_["roll"]},
    ),
    _joint_fault("joints in degrees", lambda all_: {k: _DEG * v for k, v in all_.items()}),
    _joint_fault("pitch sign", lambda all_: all_ | {"pitch": -all_["pitch"]}),
    Fault(
        "heading 90 deg",
        ("rtk/heading", "second_antenna_m"),
        altered(lambda m: turned_yaw(m.orientation, lambda yaw: yaw + math.pi / 2), "rtk/heading"),
    ),
    Fault("lever arm sign", ("rtk_antenna_m",), _antennas(0.1, -0.32, -0.38), _TURNS),
    Fault(
        "gyroscopes in deg/s", ("imu/data",), altered(scaled("angular_velocity", _DEG), "imu/data")
    ),
    Fault(
        "acceleration in g",
        ("imu/data",),
        altered(scaled("linear_acceleration", 1 / 9.80665), "imu/data"),
    ),
    Fault("UTM zone", ("map",), with_map(next_zone)),
    Fault("no params", ("--params",), lambda good, _: dataclasses.replace(good, params=[])),
    Fault(
        "latitude and longitude swapped",
        ("map",),
        with_map(changed_map(lambda place: [place[1], place[0], *place[2:]])),
    ),
    Fault(
        "heading sign",
        ("rtk/heading",),
        altered(lambda m: turned_yaw(m.orientation, lambda yaw: -yaw), "rtk/heading"),
        _TURNS,
    ),
    Fault("NED velocity", ("rtk/vel",), altered(ned_velocity, "rtk/vel")),
    Fault(
        "covariance 0",
        ("rtk/fix",),
        altered(setting(position_covariance=lambda _: np.zeros(9)), "rtk/fix"),
    ),
    Fault(
        "image stamps 0",
        ("thermal/image_raw",),
        altered(lambda m: restamped(m.header, None), _PICTURES),
    ),
    Fault("RTK 0.6 s late", ("rtk", "delay_s"), late(0.6, *_RTK), _TURNS),
    Fault("no camera_info", (_CAMERA_INFO,), left_out(_CAMERA_INFO)),
    Fault(
        "gimbal of another type",
        ("gimbal/joint_states",),
        rewritten(points, _JOINTS, "gimbal/attitude"),
    ),
    # Smaller ones, and what is seldom wrong. A boresight below 2.5 deg and a map that lies metres
    # off cannot be told yet.
    _tilted("tilted by 5 deg", 0.0, 5.0, 0.0),
    _tilted("tilted by 10 deg", 10.0, 0.0, 0.0),
    _tilted("tilted by 20 deg", 0.0, 20.0, 0.0),
    _tilted("turned by 90 deg", 0.0, 0.0, 90.0, word="90"),
    *(
        Fault(f"pictures {by_s} s late", _LATE, late(by_s, _PICTURES), _MOVES)
        for by_s in (0.2, 0.3, 0.4, 0.5)
    ),
    *map(_heading_off, (4.0, 7.0)),
    *map(_boresight, (2.0, 3.0, 5.0)),
    _flipped("mirrored", 1),
    _flipped("upside down", 0, 1),
    Fault("yaw from north", _GIMBAL, yaw_from_north),
    Fault("gimbal 0.3 s late", ("gimbal",), late(0.3, _JOINTS, "gimbal/attitude"), word="0.3"),
    _latency("latency 0.25 for 0.05", 0.25),
    Fault("RTK antenna 1 m off", ("rtk_antenna_m",), _antennas(-1.1, 0.32, 0.38), _TURNS),
    Fault(
        "RTK velocities of zero",
        ("rtk/vel",),
        altered(scaled("twist.twist.linear", 0.0), "rtk/vel"),
    ),
    Fault(
        "map 10 m off",
        ("map",),
        with_map(changed_map(lambda place: [place[0], place[1] + 9e-5, *place[2:]])),
    ),
)

"""A good flight with a fault in it: its bag, its parameters or its map written anew."""

from __future__ import annotations

import dataclasses
import json
import math
import operator
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from tirgeo_ros.io.bags.bag import BagReader, BagWriter, Cdr
from tirgeo_ros.io.parameters.parameter_file import Value, write_parameters


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

    def one(item: Item) -> Iterator[Item]:
        change(item.message)
        yield item

    return rewritten(one, *topics)


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
            for item in sorted(items, key=lambda one: one.log_time_ns):
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
        write_parameters(path, {node: dotted}, "planted")
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


def both(*planters: Planter) -> Planter:
    """Return a planter that does what some do, one after another."""

    def plant(good: FlightFiles, folder: Path) -> FlightFiles:
        for number, planter in enumerate(planters):
            place = folder / str(number)
            place.mkdir()
            good = planter(good, place)
        return good

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


def joints(change: Callable[[dict[str, float]], dict[str, float]]) -> MessageChange:
    """Return a change of joint angles (rad) by the axis that they turn."""

    def changed(message: Any) -> None:
        angles = dict(zip(message.name, map(float, message.position), strict=True))
        new = change({name.split("_")[1]: angle for name, angle in angles.items()})
        message.position = np.array([new[name.split("_")[1]] for name in message.name])

    return changed


def swapped_tilt(angles: dict[str, float]) -> dict[str, float]:
    """Return angles with roll and pitch swapped."""
    return angles | {"roll": angles["pitch"], "pitch": angles["roll"]}


def lowered(by_m: float) -> MessageChange:
    """Return a change of the height of fixes."""

    def change(message: Any) -> None:
        message.altitude -= by_m

    return change


def longer_lens(message: Any) -> None:
    """Make the focal lengths half as long again."""
    message.k = message.k * np.array([1.5, 1, 1, 1, 1.5, 1, 1, 1, 1])


def half_size(message: Any) -> None:
    """Make a calibration that of pictures of half the size."""
    message.width, message.height = message.width // 2, message.height // 2
    message.k = message.k * np.array([0.5, 1, 0.5, 1, 0.5, 0.5, 1, 1, 1])


def ned_velocity(message: Any) -> None:
    """Put an ENU velocity into NED."""
    linear = message.twist.twist.linear
    linear.x, linear.y, linear.z = linear.y, linear.x, -linear.z


def no_covariance(message: Any) -> None:
    """Take the sigmas of a fix away."""
    message.position_covariance = np.zeros(9)


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


def heading_off(by_deg: float) -> MessageChange:
    """Return a change of headings by an angle, clockwise."""
    return lambda m: turned_yaw(m.orientation, lambda yaw: yaw - math.radians(by_deg))


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
    """Send joints as a point, as some gimbal drivers do."""
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


def changed_map(change: Callable[[list[Any]], list[Any]], crs: str = "") -> Callable[[str], str]:
    """Return a change of all places of a map's text, and of its CRS."""

    def changed(text: str) -> str:
        tree, walk = json.loads(text), _each_place(change)
        for feature in tree["features"]:
            geometry = feature["geometry"]
            geometry["coordinates"] = walk(geometry["coordinates"])
        if crs:
            tree["crs"] = {"type": "name", "properties": {"name": crs}}
        return json.dumps(tree)

    return changed


def moved(place: list[Any]) -> list[Any]:
    """Return a place 10 m farther north."""
    return [place[0], place[1] + 9e-5, *place[2:]]


def swapped(place: list[Any]) -> list[Any]:
    """Return a place with longitude and latitude swapped."""
    return [place[1], place[0], *place[2:]]


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
        west, north, step = 116.69, 39.86, 1e-4
        profile = {
            "crs": "EPSG:4326",
            "transform": rasterio.Affine(step, 0, west, 0, -step, north),
        }
        size = {"count": 1, "height": 200, "width": 200, "dtype": "float32"}
        with rasterio.open(path, "w", driver="GTiff", **size, **profile) as out:
            out.write(np.full((1, 200, 200), height_m, np.float32))
        return dataclasses.replace(good, options={"dem": path})

    return plant

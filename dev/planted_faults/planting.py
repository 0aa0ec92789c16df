"""A good flight with a fault in it: its bag, its parameters or its map written anew."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

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

"""The subscription: packages of topics, and the push (set 02, id 05) that carries one.

A push names its package and nothing else: what the package holds is known from the request that
made it (set 0B, id 01), here kept in a ``PackageTable``.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

from tirgeo_ros.core.errors import DjiError
from tirgeo_ros.dji.blocks import flat
from tirgeo_ros.dji.topics import BY_NAME, BY_UID, Topic

#: Ids of the set 0B whose requests change the table.
ADD, RESET, REMOVE = 0x01, 0x02, 0x03

MAX_PACKAGES = 5
MAX_DATA_BYTES = 250  # of one push: id, stamp and topics

_ADD_HEAD = struct.Struct("<BHBB")  # package, rate in Hz, config, count of topics
_STAMPED = 0x01  # of config


class Package(NamedTuple):
    """What one package holds, in the order of its bytes."""

    id: int
    rate_hz: int
    with_timestamp: bool
    topics: tuple[Topic, ...]

    @property
    def length(self) -> int:
        """Bytes of its push's value."""
        return _plan(self).whole.size


class Push(NamedTuple):
    """One push: when it was sent (the aircraft's clock) and its topics by name."""

    package: Package
    time_ms: int | None  # None without a stamp
    time_ns: int | None
    values: dict[str, Any]  # numbers, tuples and named tuples of ``dji.blocks``


def package(id: int, rate_hz: int, with_timestamp: bool, names: Iterable[str]) -> Package:  # noqa: A002 its name on the wire
    """A package of topics by name. KeyError for a name that is no topic's."""
    return Package(id, rate_hz, with_timestamp, tuple(BY_NAME[name] for name in names))


#: The packages of an aircraft whose requests were not seen.
USUAL_PACKAGES = (
    package(
        0,
        5,
        True,
        (
            "GPS_DATE",
            "GPS_TIME",
            "GPS_POSITION",
            "GPS_VELOCITY",
            "GPS_DETAILS",
            "BATTERY_INFO",
            "RTK_POSITION",
            "RTK_VELOCITY",
            "RTK_YAW",
            "RTK_YAW_INFO",
            "RTK_POSITION_INFO",
        ),
    ),
    package(
        1,
        50,
        True,
        (
            "GPS_FUSED",
            "ALTITUDE_FUSIONED",
            "HEIGHT_FUSION",
            "STATUS_FLIGHT",
            "STATUS_DISPLAYMODE",
            "GIMBAL_ANGLES",
            "GIMBAL_STATUS",
            "RC",
            "VELOCITY",
            "GPS_CONTROL_LEVEL",
        ),
    ),
    package(2, 100, True, ("QUATERNION", "ACCELERATION_GROUND", "ANGULAR_RATE_FUSIONED")),
    package(3, 400, True, ("HARD_SYNC",)),
    package(4, 200, False, ("ACCELERATION_RAW", "ANGULAR_RATE_RAW", "ACCELERATION_BODY")),
)


class PackageTable:
    """What each package holds, as far as it is known."""

    def __init__(self, packages: Iterable[Package] = USUAL_PACKAGES) -> None:
        self._packages = {package.id: package for package in packages}

    def __iter__(self) -> Iterator[Package]:
        return iter(self._packages.values())

    def __len__(self) -> int:
        return len(self._packages)

    def get(self, package_id: int) -> Package | None:
        """The package of that id; None if not known."""
        return self._packages.get(package_id)

    def add(self, package: Package) -> None:
        """Set a package, instead of any of its id."""
        self._packages[package.id] = package

    def remove(self, package_id: int) -> None:
        """Forget a package."""
        self._packages.pop(package_id, None)

    def clear(self) -> None:
        """Forget all packages."""
        self._packages.clear()

    def learn(self, cmd_id: int, value: bytes) -> bool:
        """Take a request of set 0B that was sent to the aircraft; False if it changes nothing.

        A package with a topic of unknown length is forgotten: its pushes cannot be read.
        """
        if cmd_id == ADD and len(value) >= _ADD_HEAD.size:
            self.remove(value[0])
            made = decode_add_package(value)
            if made is not None:
                self.add(made)
        elif cmd_id == RESET:
            self.clear()
        elif cmd_id == REMOVE and value:
            self.remove(value[0])
        else:
            return False
        return True


def decode_add_package(value: bytes) -> Package | None:
    """A request's package; None if it is cut or names an unknown topic."""
    if len(value) < _ADD_HEAD.size:
        return None
    package_id, rate_hz, config, count = _ADD_HEAD.unpack_from(value)
    if len(value) != _ADD_HEAD.size + 4 * count:
        return None
    uids = struct.unpack_from(f"<{count}I", value, _ADD_HEAD.size)
    if any(uid not in BY_UID for uid in uids):
        return None
    return Package(
        package_id, rate_hz, bool(config & _STAMPED), tuple(BY_UID[uid] for uid in uids)
    )


def encode_add_package(package: Package) -> bytes:
    """The value of the request (set 0B, id 01) that makes a package."""
    config = _STAMPED if package.with_timestamp else 0
    uids = [topic.uid for topic in package.topics]
    return struct.pack(f"<BHBB{len(uids)}I", package.id, package.rate_hz, config, len(uids), *uids)


class _Plan(NamedTuple):
    whole: struct.Struct
    topics: tuple[tuple[str, int, int, Callable[[tuple[Any, ...]], Any]], ...]  # name, from, to


@lru_cache(maxsize=64)
def _plan(package: Package) -> _Plan:
    form, at = ("<BII", 3) if package.with_timestamp else ("<B", 1)
    topics = []
    for topic in package.topics:
        packed = struct.Struct(f"<{topic.form}")
        count = len(packed.unpack(bytes(packed.size)))
        topics.append((topic.name, at, at + count, topic.make))
        form, at = form + topic.form, at + count
    return _Plan(struct.Struct(form), tuple(topics))


def decode_push(value: bytes, table: PackageTable) -> Push | None:
    """Read a push's value (what follows set and id).

    None if its package is not known or does not have its length.
    """
    package = table.get(value[0]) if value else None
    if package is None:
        return None
    plan = _plan(package)
    if len(value) != plan.whole.size:
        return None
    numbers = plan.whole.unpack(value)
    values = {name: make(numbers[start:stop]) for name, start, stop, make in plan.topics}
    if package.with_timestamp:
        return Push(package, numbers[1], numbers[2], values)
    return Push(package, None, None, values)


def encode_push(push: Push) -> bytes:
    """A push's value. DjiError for values that its package cannot hold."""
    plan = _plan(push.package)
    stamp = (push.time_ms, push.time_ns) if push.package.with_timestamp else ()
    parts = [push.values.get(topic.name) for topic in push.package.topics]
    try:
        return plan.whole.pack(push.package.id, *stamp, *flat(tuple(parts)))
    except (struct.error, OverflowError) as error:
        raise DjiError(f"push of package {push.package.id}: {error}") from None

"""Decode and encode the subscription's push (set 02, id 05), which carries a package of topics.

A push contains the id of its package and not what the package holds. That is known from the
request that made it (set 0B, id 01), kept here in a ``PackageTable``.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from functools import lru_cache
from typing import Any, NamedTuple

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.protocol.broadcast_parts import flat
from tirgeo_ros.dji.protocol.commands import AddPackage, RemovePackage, Request, ResetPackages
from tirgeo_ros.dji.protocol.subscription_topics import BY_NAME, BY_UID, Topic

#: Capacity of one push: stamp and topics, without the package's id.
MAX_DATA_BYTES = 250


class Package(NamedTuple):
    """Hold the definition of one package, topics in the order of its bytes."""

    id: int
    rate_hz: int
    with_timestamp: bool
    topics: tuple[Topic, ...]

    @classmethod
    def of(cls, number: int, rate_hz: int, with_timestamp: bool, names: Iterable[str]) -> Package:
        """Return a package of topics by name. Raises DjiError for a name that is no topic's."""
        names = tuple(names)
        if unknown := [name for name in names if name not in BY_NAME]:
            raise DjiError(f"package {number}: no topic is called {unknown[0]}")
        return cls(number, rate_hz, with_timestamp, tuple(BY_NAME[name] for name in names))

    @property
    def length(self) -> int:
        """Return the bytes of its push's value."""
        return _plan(self).whole.size

    @property
    def request(self) -> AddPackage:
        """Return the request that adds it."""
        uids = tuple(topic.uid for topic in self.topics)
        return AddPackage(self.id, self.rate_hz, self.with_timestamp, uids)


class Push(NamedTuple):
    """Hold one push: when it was sent (the aircraft's clock) and its topics by name."""

    package: Package
    time_ms: int | None  # None without a stamp
    time_ns: int | None
    values: dict[str, Any]  # numbers, tuples and named tuples of ``dji.protocol.broadcast_parts``


#: The packages of an aircraft whose requests were not seen.
USUAL_PACKAGES = (
    Package.of(
        0,
        5,
        with_timestamp=True,
        names=(
            *("GPS_DATE", "GPS_TIME", "GPS_POSITION", "GPS_VELOCITY", "GPS_DETAILS"),
            *("BATTERY_INFO", "RTK_POSITION", "RTK_VELOCITY", "RTK_YAW"),
            *("RTK_YAW_INFO", "RTK_POSITION_INFO"),
        ),
    ),
    Package.of(
        1,
        50,
        with_timestamp=True,
        names=(
            *("GPS_FUSED", "ALTITUDE_FUSIONED", "HEIGHT_FUSION", "STATUS_FLIGHT"),
            *("STATUS_DISPLAYMODE", "GIMBAL_ANGLES", "GIMBAL_STATUS", "RC", "VELOCITY"),
            "GPS_CONTROL_LEVEL",
        ),
    ),
    Package.of(
        2,
        100,
        with_timestamp=True,
        names=("QUATERNION", "ACCELERATION_GROUND", "ANGULAR_RATE_FUSIONED"),
    ),
    Package.of(3, 400, with_timestamp=True, names=("HARD_SYNC",)),
    Package.of(
        4,
        200,
        with_timestamp=False,
        names=("ACCELERATION_RAW", "ANGULAR_RATE_RAW", "ACCELERATION_BODY"),
    ),
)


class PackageTable:
    """Hold the packages that are known, by id; by default the usual ones."""

    def __init__(self, packages: Iterable[Package] = USUAL_PACKAGES) -> None:
        self._packages = {package.id: package for package in packages}

    def __iter__(self) -> Iterator[Package]:
        """Return the known packages, sorted by id."""
        return iter([self._packages[number] for number in sorted(self._packages)])

    def __len__(self) -> int:
        return len(self._packages)

    def get(self, number: int) -> Package | None:
        """Return the package of that id; None if not known."""
        return self._packages.get(number)

    def add(self, package: Package) -> None:
        """Set a package, replacing one of the same id."""
        self._packages[package.id] = package

    def remove(self, number: int) -> None:
        """Forget a package."""
        self._packages.pop(number, None)

    def clear(self) -> None:
        """Forget all packages."""
        self._packages.clear()

    def copy(self) -> PackageTable:
        """Return a table of the same packages."""
        return PackageTable(self)

    def learn(self, request: Request) -> bool:
        """Apply a host's request to the table; return whether it is about packages.

        A package with a topic of unknown length is forgotten: its pushes cannot be read.
        """
        match request:
            case AddPackage(number, rate_hz, with_timestamp, uids):
                self.remove(number)
                if all(uid in BY_UID for uid in uids):
                    topics = tuple(BY_UID[uid] for uid in uids)
                    self.add(Package(number, rate_hz, with_timestamp, topics))
            case RemovePackage(number):
                self.remove(number)
            case ResetPackages():
                self.clear()
            case _:
                return False
        return True


class _Plan(NamedTuple):
    """Hold how to read or write the pushes of a package."""

    whole: struct.Struct
    topics: tuple[tuple[str, int, int, Callable[[tuple[Any, ...]], Any]], ...]  # name, from, to


@lru_cache(maxsize=64)
def _plan(package: Package) -> _Plan:
    form, at = ("<BII", 3) if package.with_timestamp else ("<B", 1)
    topics = []
    for topic in package.topics:
        topics.append((topic.name, at, at + topic.numbers, topic.make))
        form, at = form + topic.form, at + topic.numbers
    return _Plan(struct.Struct(form), tuple(topics))


def decode_push(value: bytes, table: PackageTable) -> Push | None:
    """Decode a push's value (what follows set and id).

    Returns None if its package is not known or has another length.
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
    """Encode a push's value. Raises DjiError for values that its package cannot hold."""
    plan = _plan(push.package)
    numbers: list[Any] = [push.package.id]
    if push.package.with_timestamp:
        numbers += [push.time_ms, push.time_ns]
    for name, start, stop, _ in plan.topics:
        part = flat(push.values.get(name))
        if len(part) != stop - start:
            raise DjiError(f"package {push.package.id}: {name} needs {stop - start} numbers")
        numbers += part
    try:
        return plan.whole.pack(*numbers)
    except (struct.error, OverflowError) as error:
        raise DjiError(f"package {push.package.id} cannot be sent: {error}") from None

"""Decode and encode the subscription's push (set 02, id 05), which carries a package of topics.

A push contains the id of its package and not what the package holds. That is known from the
request that made it (set 0B, id 01), kept here in a ``PackageTable``.
"""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

from tirgeo_ros.dji.protocol.commands import Request, add_package
from tirgeo_ros.dji.protocol.packed_fields import PackedFields
from tirgeo_ros.dji.protocol.subscription_topics import BY_NAME, Topic

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
        """Return a package of topics by name."""
        return cls(number, rate_hz, with_timestamp, tuple(BY_NAME[name] for name in names))

    @property
    def length(self) -> int:
        """Return the bytes of its push's value."""
        return _packed(self).size

    @property
    def request(self) -> Request:
        """Return the request that adds it."""
        uids = [topic.uid for topic in self.topics]
        return add_package(self.id, self.rate_hz, uids, stamped=self.with_timestamp)


class Push(NamedTuple):
    """Hold one push: when it was sent (the aircraft's clock) and its topics by name."""

    package: Package
    time_ms: int | None  # None without a stamp
    time_ns: int | None
    values: dict[str, Any]  # numbers, tuples and named tuples of ``dji.protocol.broadcast_parts``


_USUAL = (
    (
        0,
        5,
        True,
        """GPS_DATE GPS_TIME GPS_POSITION GPS_VELOCITY GPS_DETAILS BATTERY_INFO
        RTK_POSITION RTK_VELOCITY RTK_YAW RTK_YAW_INFO RTK_POSITION_INFO""",
    ),
    (
        1,
        50,
        True,
        """GPS_FUSED ALTITUDE_FUSIONED HEIGHT_FUSION STATUS_FLIGHT STATUS_DISPLAYMODE
        GIMBAL_ANGLES GIMBAL_STATUS RC VELOCITY GPS_CONTROL_LEVEL""",
    ),
    (2, 100, True, "QUATERNION ACCELERATION_GROUND ANGULAR_RATE_FUSIONED"),
    (3, 400, True, "HARD_SYNC"),
    (4, 200, False, "ACCELERATION_RAW ANGULAR_RATE_RAW ACCELERATION_BODY"),
)
#: The packages of an aircraft whose requests were not seen.
USUAL_PACKAGES = tuple(
    Package.of(number, rate_hz, stamped, names.split())
    for number, rate_hz, stamped, names in _USUAL
)


class PackageTable(dict[int, Package]):
    """Hold the packages that are known, by id; by default the usual ones."""

    def __init__(self, packages: Iterable[Package] = USUAL_PACKAGES) -> None:
        super().__init__((package.id, package) for package in packages)


@lru_cache(maxsize=64)
def _packed(package: Package) -> PackedFields:
    parts = ((topic.name, topic.form, topic.make) for topic in package.topics)
    return PackedFields("<BII" if package.with_timestamp else "<B", parts)


def decode_push(value: bytes, table: PackageTable) -> Push | None:
    """Decode a push's value (what follows set and id).

    Returns None if its package is not known or has another length.
    """
    package = table.get(value[0]) if value else None
    if package is None:
        return None
    packed = _packed(package)
    if len(value) != packed.size:
        return None
    numbers, values = packed.unpack(value)
    if package.with_timestamp:
        return Push(package, numbers[1], numbers[2], values)
    return Push(package, None, None, values)


def encode_push(push: Push) -> bytes:
    """Encode a push's value; its values must be those of its package."""
    number, *_, with_timestamp, _topics = push.package
    head = [number, push.time_ms, push.time_ns] if with_timestamp else [number]
    return _packed(push.package).pack(head, push.values)

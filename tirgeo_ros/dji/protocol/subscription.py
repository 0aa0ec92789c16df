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
"""Decode and encode the subscription's push (set 02, id 05), which contains a package of topics.

A push contains the id of its package but not the list of its topics. The request of the package
(set 0B, id 01) defines them; a ``PackageTable`` holds the definitions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from operator import itemgetter
from typing import Any, NamedTuple

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.protocol import rtk_gps_imu_broadcast as parts
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import Make, PackedFields

PACKAGE_IDS = range(5)
#: Largest length of stamp and topics in one push, without the package's id.
MAX_DATA_BYTES = 250
#: Keys and rates of a package in a YAML file.
_KEYS = ("rate_hz", "with_timestamp", "topics")
_RATES_HZ = range(1, 401)


class Topic(NamedTuple):
    """Hold one topic; ``make`` converts its numbers to a type of ``rtk_gps_imu_broadcast``."""

    name: str
    uid: int
    form: str  # as in ``struct``, without the byte order
    make: Make


_number = itemgetter(0)
#: Every topic that can be read. Vectors become tuples, single numbers stay numbers.
TOPICS = (
    Topic("QUATERNION", 0xA493281F, "4f", tuple),  # w, x, y, z; FRD to NED
    Topic("ACCELERATION_GROUND", 0x8696C85B, "3f", tuple),  # m/s2, north-east-up
    Topic("ACCELERATION_BODY", 0xBB17D5FE, "3f", tuple),  # m/s2, forward-right-up
    Topic("ACCELERATION_RAW", 0xC3503A6E, "3f", tuple),  # m/s2, FRD
    Topic("VELOCITY", 0x18FB271D, "3fB", lambda v: parts.Velocity(v[:3], v[3])),  # north-east-up
    Topic("ANGULAR_RATE_FUSIONED", 0x3599C4BE, "3f", tuple),  # rad/s, in uncertain axes
    Topic("ANGULAR_RATE_RAW", 0x700389EE, "3f", tuple),  # rad/s, FRD
    Topic("ALTITUDE_FUSIONED", 0x11E9C81A, "f", _number),  # m, by pressure
    Topic("ALTITUDE_BAROMETER", 0x27396A39, "f", _number),  # m
    Topic("HEIGHT_FUSION", 0x87CF419D, "f", _number),  # m above the ground
    Topic("GPS_FUSED", 0x4B19A8C7, "2dfH", parts.GpsFused._make),
    Topic("GPS_DATE", 0x598F79BC, "I", _number),  # yyyymmdd
    Topic("GPS_TIME", 0xD48912C9, "I", _number),  # hhmmss
    Topic("GPS_POSITION", 0x0C949E94, "3i", parts.GpsPosition._make),
    Topic("GPS_VELOCITY", 0x7AC7EB80, "3f", tuple),  # cm/s, NED
    Topic("GPS_DETAILS", 0x81FED54E, "6f2I2H", parts.GpsDetail._make),
    Topic("RTK_POSITION", 0x1DF9A6B6, "2df", parts.RtkPosition._make),
    Topic("RTK_VELOCITY", 0x763D13C3, "3f", tuple),  # cm/s, NED
    Topic("RTK_YAW", 0xF45D73FD, "h", _number),  # deg, azimuth of the antennas' baseline
    Topic("RTK_POSITION_INFO", 0xDA4A57B5, "B", _number),
    Topic("RTK_YAW_INFO", 0xCB72B9E3, "B", _number),
    Topic("COMPASS", 0xDF3D72B7, "3h", tuple),
    Topic("RC", 0x739F7FE4, "6h", parts.Rc._make),
    Topic("GIMBAL_ANGLES", 0x01F71678, "3f", parts.GimbalAngles._make),
    Topic("GIMBAL_STATUS", 0x8B6CD45C, "I", _number),  # bits
    Topic("GIMBAL_CONTROL_MODE", 0x326A446D, "B", _number),
    Topic("STATUS_FLIGHT", 0x20CFB02A, "B", _number),
    Topic("STATUS_DISPLAYMODE", 0x1A67D6A1, "B", _number),
    Topic("BATTERY_INFO", 0x69779DD9, "I2iB", parts.Battery._make),
    Topic(
        "HARD_SYNC",
        0xECBEF06D,
        "3IHB4f3f3f",
        lambda v: parts.HardSync._make((*v[:5], v[5:9], v[9:12], v[12:])),
    ),
    Topic("GPS_CONTROL_LEVEL", 0xE30B17B0, "B", _number),
    Topic("GPS_SIGNAL_LEVEL", 0xA6A0395F, "B", _number),
    Topic("RTK_CONNECT_STATUS", 0x6F349326, "H", _number),  # bit 0
    Topic("HEIGHT_HOMEPOINT", 0x252C164B, "f", _number),  # m
    Topic("HOME_POINT_SET_STATUS", 0xB5C2211F, "B", _number),
    Topic("HOME_POINT_INFO", 0xBFE4B520, "2d", tuple),  # latitude and longitude, rad
    Topic("STATUS_LANDINGGEAR", 0x772D6E22, "B", _number),
    Topic("STATUS_MOTOR_START_ERROR", 0x3A41E909, "H", _number),
    Topic("CONTROL_DEVICE", 0x667BA86A, "2B", parts.Device._make),
    Topic("RC_FULL_RAW_DATA", 0x16EC4D0E, "22h", tuple),
    Topic("RC_WITH_FLAG_DATA", 0xFE04CFCD, "4fB", tuple),
    Topic("ESC_DATA", 0xAAA0F589, "2hHhH" * 8, tuple),  # of each motor
    Topic("FLIGHT_ANOMALY", 0x0A624B4B, "I", _number),  # bits
    Topic("POSITION_VO", 0xD3462697, "3fB", tuple),  # m, NED of its own start; health
    Topic("AVOID_DATA", 0xF6405DAA, "6fB", parts.RelativePosition._make),
)

BY_NAME = {topic.name: topic for topic in TOPICS}


class Package(NamedTuple):
    """Hold the definition of one package, with its topics in the order of the bytes."""

    id: int
    rate_hz: int
    with_timestamp: bool
    topics: tuple[Topic, ...]

    @classmethod
    def of(cls, number: int, rate_hz: int, with_timestamp: bool, names: Iterable[str]) -> Package:
        """Return a package of the topics with these names."""
        return cls(number, rate_hz, with_timestamp, tuple(BY_NAME[name] for name in names))

    @property
    def length(self) -> int:
        """Return the length of its push's value in bytes."""
        return _packed(self).size


class Push(NamedTuple):
    """Hold one push: its time by the aircraft's clock, and its topics by name."""

    package: Package
    time_ms: int | None  # None without a stamp
    time_ns: int | None
    values: dict[str, Any]  # numbers, tuples and parts of ``rtk_gps_imu_broadcast``


_RECEIVERS = """GPS_DATE GPS_TIME GPS_POSITION GPS_VELOCITY GPS_DETAILS BATTERY_INFO
    RTK_POSITION RTK_VELOCITY RTK_YAW RTK_YAW_INFO RTK_POSITION_INFO"""
_FLIGHT = """GPS_FUSED ALTITUDE_FUSIONED HEIGHT_FUSION STATUS_FLIGHT STATUS_DISPLAYMODE
    GIMBAL_ANGLES GIMBAL_STATUS RC VELOCITY GPS_CONTROL_LEVEL"""
_FUSED = ("QUATERNION", "ACCELERATION_GROUND", "ANGULAR_RATE_FUSIONED")
_RAW = ("ACCELERATION_RAW", "ANGULAR_RATE_RAW", "ACCELERATION_BODY")
#: The packages that are assumed without the requests: those of DJI's ROS wrapper.
USUAL_PACKAGES = (
    Package.of(0, 5, with_timestamp=True, names=_RECEIVERS.split()),
    Package.of(1, 50, with_timestamp=True, names=_FLIGHT.split()),
    Package.of(2, 100, with_timestamp=True, names=_FUSED),
    Package.of(3, 400, with_timestamp=True, names=("HARD_SYNC",)),
    Package.of(4, 200, with_timestamp=False, names=_RAW),
)


class PackageTable(dict[int, Package]):
    """Hold the definitions of packages by id; by default the usual ones."""

    def __init__(self, packages: Iterable[Package] = USUAL_PACKAGES) -> None:
        super().__init__((package.id, package) for package in packages)


@lru_cache(maxsize=64)
def _packed(package: Package) -> PackedFields:
    parts = ((topic.name, topic.form, topic.make) for topic in package.topics)
    return PackedFields("<BII" if package.with_timestamp else "<B", parts)


def decode_push(value: bytes, table: PackageTable) -> Push | None:
    """Decode a push's value (without set and id).

    Returns None if its package is not in the table or has another length.
    """
    package = table.get(value[0]) if value else None
    if package is None:
        return None
    packed = _packed(package)
    if len(value) != packed.size:
        return None
    numbers, values = packed.unpack(value)
    time_ms, time_ns = numbers[1:3] if package.with_timestamp else (None, None)
    return Push(package, time_ms, time_ns, values)


def encode_push(push: Push) -> bytes:
    """Encode a push's value; the push must have a value for each topic of its package."""
    number, *_, with_timestamp, _topics = push.package
    head = [number, push.time_ms, push.time_ns] if with_timestamp else [number]
    return _packed(push.package).pack(head, push.values)


def package_table(tree: object, file: str) -> PackageTable:
    """Return the table that a YAML file's content describes.

    A person who knows the requests writes the file::

        packages:
          0:                     # the package's id, 0 to 4
            rate_hz: 5
            with_timestamp: true
            topics: [GPS_DATE, GPS_TIME, RTK_POSITION, RTK_YAW]   # in the order of the request

    ``file``: its name, for messages. Raises DjiError, naming file and key, if the content is
    invalid.
    """
    entries = tree.get("packages") if isinstance(tree, Mapping) else None
    if not isinstance(entries, Mapping) or not entries:
        raise DjiError(f"{file}: must have the key packages: a table of packages by their ids")
    return PackageTable(_package(n, e, f"{file}: packages.{n}") for n, e in entries.items())


def _package(number: Any, entry: Any, where: str) -> Package:
    if type(number) is not int or number not in PACKAGE_IDS:
        raise DjiError(f"{where}: the id must be {PACKAGE_IDS[0]} to {PACKAGE_IDS[-1]}")
    if not isinstance(entry, Mapping) or set(entry) != set(_KEYS):
        raise DjiError(f"{where}: must have the keys {', '.join(_KEYS)}, and no others")
    rate_hz, with_timestamp, names = (entry[key] for key in _KEYS)
    if type(rate_hz) is not int or rate_hz not in _RATES_HZ:
        raise DjiError(f"{where}.rate_hz: {rate_hz}: must be an integer, 1 to {_RATES_HZ[-1]}")
    if not isinstance(with_timestamp, bool):
        raise DjiError(f"{where}.with_timestamp: {with_timestamp}: must be true or false")
    if not isinstance(names, list) or not names:
        raise DjiError(f"{where}.topics: must be a list of topics, in the order of the request")
    if unknown := [name for name in names if str(name) not in BY_NAME]:
        raise DjiError(f"{where}.topics: unknown topic {unknown[0]}")
    package = Package.of(number, rate_hz, with_timestamp, names)
    length = package.length - 1
    if length > MAX_DATA_BYTES:
        raise DjiError(f"{where}: {length} bytes, more than the {MAX_DATA_BYTES} of a push")
    return package

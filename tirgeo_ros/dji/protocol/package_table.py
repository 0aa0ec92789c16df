"""Read a table of packages from a YAML tree, for a person who knows what was requested.

As read from the file::

    packages:
      0:                     # the package's id, 0 to 4
        rate_hz: 5
        with_timestamp: true
        topics: [GPS_DATE, GPS_TIME, RTK_POSITION, RTK_YAW]   # names or numbers, in their order
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.protocol.commands import PACKAGE_IDS
from tirgeo_ros.dji.protocol.subscription import MAX_DATA_BYTES, Package, PackageTable
from tirgeo_ros.dji.protocol.subscription_topics import BY_NAME, BY_UID, Topic

_KEYS = ("rate_hz", "with_timestamp", "topics")
_RATES_HZ = range(1, 401)


def package_table(tree: object, file: str) -> PackageTable:
    """Return the table that a YAML file's content describes.

    ``file``: its name, for messages. Raises DjiError, naming file and key, if the content is
    invalid.
    """
    entries = tree.get("packages") if isinstance(tree, Mapping) else None
    if not isinstance(entries, Mapping) or not entries:
        raise DjiError(f"{file}: not a table of packages: it needs packages: ID: TOPICS and so on")
    return PackageTable(_package(n, e, f"{file}: packages.{n}") for n, e in entries.items())


def _package(number: Any, entry: Any, where: str) -> Package:
    if type(number) is not int or number not in PACKAGE_IDS:
        raise DjiError(f"{where}: ids of packages are {PACKAGE_IDS[0]} to {PACKAGE_IDS[-1]}")
    if not isinstance(entry, Mapping) or set(entry) != set(_KEYS):
        raise DjiError(f"{where}: needs {', '.join(_KEYS)}, and nothing else")
    rate_hz, with_timestamp, names = (entry[key] for key in _KEYS)
    if type(rate_hz) is not int or rate_hz not in _RATES_HZ:
        raise DjiError(f"{where}.rate_hz: {rate_hz}: a whole number from 1 to {_RATES_HZ[-1]}")
    if not isinstance(with_timestamp, bool):
        raise DjiError(f"{where}.with_timestamp: {with_timestamp}: true or false")
    if not isinstance(names, list) or not names:
        raise DjiError(f"{where}.topics: a list of topics, in the order of the request")
    topics = tuple(_topic(name, where) for name in names)
    package = Package(number, rate_hz, with_timestamp, topics)
    if package.length - 1 > MAX_DATA_BYTES:
        raise DjiError(
            f"{where}: {package.length - 1} bytes, more than the {MAX_DATA_BYTES} of a push"
        )
    return package


def _topic(name: Any, where: str) -> Topic:
    """Return a topic by its name or its number."""
    known = BY_UID.get(name) if type(name) is int else BY_NAME.get(str(name))
    if known is None:
        shown = f"0x{name:08x}" if type(name) is int else name
        raise DjiError(f"{where}.topics: unknown topic {shown}")
    return known

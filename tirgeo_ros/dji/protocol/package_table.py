"""Read a table of packages from a YAML tree, for a person who knows what was requested.

As read from the file::

    packages:
      0:                     # the package's id, 0 to 4
        rate_hz: 5
        with_timestamp: true
        topics: [GPS_DATE, GPS_TIME, RTK_POSITION, RTK_YAW]   # names or numbers, in their order
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from typing import Any

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.protocol.commands import PACKAGE_IDS
from tirgeo_ros.dji.protocol.subscription import MAX_DATA_BYTES, Package, PackageTable
from tirgeo_ros.dji.protocol.subscription_topics import BY_NAME, BY_UID, Topic

_ROOT = "packages"
_KEYS = ("rate_hz", "with_timestamp", "topics")
_MAX_RATE_HZ = 400


def package_table(tree: object, file: str) -> PackageTable:
    """Return the table that a YAML file's content describes.

    ``file``: its name, for messages. Raises DjiError, naming file and key, if the content is
    invalid.
    """
    if not isinstance(tree, Mapping) or list(tree) != [_ROOT]:
        raise DjiError(f"{file}: no table of packages: it needs {_ROOT}: ID: TOPICS and so on")
    entries = tree[_ROOT]
    if not isinstance(entries, Mapping) or not entries:
        raise DjiError(f"{file}: {_ROOT}: needs an entry for each package, by its id")
    holder: dict[str, int] = {}
    packages = [_package(n, entry, f"{file}: {_ROOT}.{n}") for n, entry in entries.items()]
    for package in packages:
        for topic in package.topics:  # the aircraft refuses a topic in two packages
            if topic.name in holder:
                raise DjiError(
                    f"{file}: {_ROOT}.{package.id}.topics: {topic.name} stands in package "
                    f"{holder[topic.name]} already"
                )
            holder[topic.name] = package.id
    return PackageTable(packages)


def _package(number: Any, entry: Any, where: str) -> Package:
    if not _is_number(number) or number not in PACKAGE_IDS:
        raise DjiError(f"{where}: ids of packages are {PACKAGE_IDS[0]} to {PACKAGE_IDS[-1]}")
    if not isinstance(entry, Mapping):
        raise DjiError(f"{where}: needs {', '.join(_KEYS)}")
    if unknown := [key for key in entry if key not in _KEYS]:
        raise DjiError(f"{where}: unknown key {unknown[0]}{_hint(unknown[0], _KEYS)}")
    if missing := [key for key in _KEYS if key not in entry]:
        raise DjiError(f"{where}: {missing[0]} is missing")
    rate_hz, with_timestamp, names = (entry[key] for key in _KEYS)
    if not _is_number(rate_hz) or not 1 <= rate_hz <= _MAX_RATE_HZ:
        raise DjiError(f"{where}.rate_hz: {rate_hz}: a whole number from 1 to {_MAX_RATE_HZ}")
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


def _is_number(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _topic(name: Any, where: str) -> Topic:
    """Return a topic by its name or its number."""
    if _is_number(name) and name in BY_UID:
        return BY_UID[name]
    if isinstance(name, str) and name in BY_NAME:
        return BY_NAME[name]
    shown = f"0x{name:08x}" if _is_number(name) else str(name)
    raise DjiError(f"{where}.topics: unknown topic {shown}{_hint(name, BY_NAME)}")


def _hint(name: object, known: Any) -> str:
    near = difflib.get_close_matches(str(name), known, n=1)
    return f" (did you mean {near[0]}?)" if near else ""

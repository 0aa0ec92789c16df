"""Find the files of a bag in its folder, by ``metadata.yaml`` or without it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.files.whole_files import read_text

METADATA = "metadata.yaml"
_ZSTD = ".zstd"
_SUFFIXES = (".mcap", ".db3")
_STORAGES = ("mcap", "sqlite3")
_MOST_BYTES = 4 << 20  # of metadata: some hundred bytes a topic and a file


def bag_files(path: Path) -> tuple[list[Path], list[str]]:
    """Return a bag's files in order, and what is lost: files that its metadata names in vain.

    ``path`` is a file, a folder, or the ``metadata.yaml`` in it. The metadata only names the
    files: what it says of times and counts is not always right. Without metadata (the recorder
    was killed), or where all its names are wrong, the files of the folder are taken. Raises
    BagError for a folder without a bag or with several, and for a storage or a compression that is
    not known.
    """
    folder = path.parent if path.name == METADATA else path
    if not folder.is_dir():
        return [path], []
    metadata = folder / METADATA
    if not metadata.is_file():
        return _in_folder(folder), []
    try:
        told = _told(metadata)
        names = [Path(name).name for name in told["relative_file_paths"]]
    except (BagError, yaml.YAMLError, KeyError, TypeError, ValueError, RecursionError):
        return _in_folder(folder), [f"{METADATA} is damaged"]
    _check_known(metadata, told)
    found = {name: _file_of(folder, name) for name in names}
    files = [file for file in found.values() if file]
    lost = [f"{name}, named in {METADATA}, is absent" for name in names if not found[name]]
    return files or _in_folder(folder), lost


def is_bag(path: Path) -> bool:
    """Return whether a path looks like a bag: a file by its name, a folder by what is in it.

    A folder without metadata is one if it has nothing but files of bags.
    """
    if path.is_dir():
        inside = list(path.iterdir())
        return path / METADATA in inside or (bool(inside) and all(map(_bag_name, inside)))
    return path.name == METADATA or _bag_name(path)


def by_numbers(path: Path) -> list[tuple[int, str]]:
    """Return a sort key that puts ``bag_2`` before ``bag_10``."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (-1, part) for part in parts]


def _told(metadata: Path) -> dict[str, Any]:
    """Return what metadata say; the names of version 3 and before have the folder's in front."""
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # ten times as fast where there is C
    tree = yaml.load(read_text(metadata, BagError, _MOST_BYTES), loader)  # noqa: S506  safe
    told: dict[str, Any] = tree["rosbag2_bagfile_information"]
    return told


def _check_known(metadata: Path, told: dict[str, Any]) -> None:
    storage = told.get("storage_identifier")
    if storage not in _STORAGES:
        raise BagError(
            f"{metadata}: storage {storage!r} is not known ({', '.join(_STORAGES)} are); "
            "convert the bag with ros2 bag convert"
        )
    form = told.get("compression_format") or "zstd"
    if str(told.get("compression_mode") or "none").lower() != "none" and form != "zstd":
        raise BagError(
            f"{metadata}: compression {form!r} is not known (zstd is); "
            "convert the bag with ros2 bag convert"
        )


def _file_of(folder: Path, name: str) -> Path | None:
    """Return the file of this name; of a recorder that was killed, before or after compression."""
    for one in (name, name + _ZSTD, name.removesuffix(_ZSTD)):
        if one and (folder / one).is_file():
            return folder / one
    return None


def _in_folder(folder: Path) -> list[Path]:
    """Return the files of the one bag in a folder, in the order of their numbers."""
    found = sorted((one for one in folder.iterdir() if _bag_name(one)), key=by_numbers)
    # Where a recorder was killed while it compressed a file, the plain one is the whole one.
    found = [one for one in found if one.name.removesuffix(_ZSTD) == one.name or not _plain(one)]
    bags = sorted({re.sub(r"_\d+$", "", one.name.split(".")[0]) for one in found})
    if not bags:
        raise BagError(f"{folder}: no bag in this folder: no .mcap and no .db3 file")
    if len(bags) > 1:
        more = ", ..." if len(bags) > 3 else ""
        raise BagError(
            f"{folder}: {len(bags)} recordings without a {METADATA} ({', '.join(bags[:3])}{more}):"
            " give one of them"
        )
    return found


def _plain(path: Path) -> bool:
    return path.with_name(path.name.removesuffix(_ZSTD)).is_file()


def _bag_name(path: Path) -> bool:
    name = path.name.lower().removesuffix(_ZSTD)
    return name.endswith(_SUFFIXES) and not name.startswith(".")

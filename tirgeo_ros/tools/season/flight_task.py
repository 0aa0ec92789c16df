"""Define the task of one flight, and what its outputs are made from."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tirgeo_ros import __version__
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import bag_files
from tirgeo_ros.io.files.whole_files import PathLike

_PIECE = 1 << 20  # bytes of a file that are read at once

#: Name, size in bytes and time of change (ns) of a file; None for what is not known.
Stamp = list[str | int | None]
#: SHA-256 of a file, or the stamps of what is in a folder; None of what is absent.
Digest = str | list[Stamp] | None


@dataclass(frozen=True)
class FlightTask:
    """Hold what a process, on this computer or another, needs to process a flight."""

    name: str  # of its files in the season's folder
    bag: str
    folder: str  # of the season
    working_folder: str  # in which relative paths begin
    options: dict[str, Any]  # keywords of ``process``, in JSON's types
    video: str  # the ending of its video; "" for none
    made_from: dict[str, Any]

    def path(self, ending: str) -> Path:
        """Return the place of one of its files; ``ending`` begins with a dot."""
        return Path(self.folder) / f"{self.name}{ending}"

    @property
    def outputs(self) -> list[Path]:
        """Return the places of all its files."""
        endings = (".mcap", ".json", ".jpg", self.video)
        return [self.path(ending) for ending in endings if ending]


def place_of(bag: PathLike) -> Path:
    """Return the whole path of a flight; of a link its own, not where it leads."""
    return Path(os.path.normpath(Path(bag).absolute()))


def bag_stamps(bag: PathLike) -> list[Stamp]:
    """Return the stamps of a bag's files; of one that cannot be read, that of its path."""
    try:
        files, _ = bag_files(Path(bag))
    except (BagError, OSError):
        files = [Path(bag)]
    return [_stamp(path) for path in files]


def made_from(
    stamps: Iterable[Stamp], options: Mapping[str, Any], digests: Mapping[str, Digest]
) -> dict[str, Any]:
    """Return, in JSON's types, all that a flight's outputs follow from.

    ``digests`` are those of parameter files and of what they name. They are known by their
    contents, for they are small and are copied and edited; the flight's own files by size and
    time of change.
    """
    flight, files = list(stamps), dict(digests)
    return {"version": __version__, "flight": flight, "options": dict(options), "files": files}


def digests_of(paths: Iterable[PathLike]) -> dict[str, Digest]:
    """Return by path the SHA-256 of each file, and the stamps of what is in each folder."""
    return {str(path): _digest(Path(path)) for path in paths if path}


def _stamp(path: Path) -> Stamp:
    try:
        status = path.stat()
    except OSError:
        return [path.name, None, None]
    return [path.name, status.st_size, status.st_mtime_ns]


def _digest(path: Path) -> Digest:
    try:
        if path.is_dir():
            return [_stamp(one) for one in sorted(path.iterdir())]
        digest = hashlib.sha256()
        with path.open("rb") as file:
            while piece := file.read(_PIECE):
                digest.update(piece)
    except OSError:
        return None
    return digest.hexdigest()

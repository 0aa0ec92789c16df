"""What a soak has written down: the player's ledger and the witness's record."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tirgeo_ros.core.types.arrays import Array

_MS = 1_000_000
#: Each player that is started has so many numbers of epochs for itself.
EPOCHS = 1000


@dataclass(frozen=True)
class Ledger:
    """What the players have sent, in order."""

    shift_ns: dict[int, int] = field(default_factory=dict)  # by epoch
    stamps_ns: list[int] = field(default_factory=list)  # of each frame
    sent_s: list[float] = field(default_factory=list)  # when, by the steady clock

    def place(self, stamp_ns: int) -> int | None:
        """Which frame of all it is, from 0 on; None for one that was not sent."""
        return self._places.get(stamp_ns)

    def __post_init__(self) -> None:
        self._places: dict[int, int]
        places = {stamp: place for place, stamp in enumerate(self.stamps_ns)}
        object.__setattr__(self, "_places", places)

    def player(self, place: int) -> int:
        """Which of the players, from 0 on, has sent a frame."""
        return epoch_of(self.stamps_ns[place]) // EPOCHS

    def sent_before(self, time_s: float) -> int:
        """How many frames had been sent at a time."""
        return bisect_right(self.sent_s, time_s)


def epoch_of(stamp_ns: int) -> int:
    """The epoch that a stamp is from: the nanoseconds below a whole millisecond."""
    return stamp_ns % _MS


@dataclass(frozen=True)
class Poses:
    """The poses of the camera that came out, N of them in order of their coming."""

    came_s: Array  # (N,) by the steady clock
    stamps_ns: list[int]
    position_n: Array  # (N, 3) m
    q_nc: Array  # (N, 4) wxyz
    variance: Array  # (N, 6) m2 and rad2


@dataclass(frozen=True)
class Picture:
    """One picture that came out."""

    came_s: float
    stamp_ns: int
    line_pixels: int


@dataclass(frozen=True)
class Report:
    """What a node said of itself at a time: item to key to value."""

    came_s: float
    items: dict[str, dict[str, str]]


@dataclass(frozen=True)
class Record:
    """What the witness saw."""

    poses: Poses
    pictures: list[Picture]
    reports: list[Report]


def read_ledger(path: Path) -> Ledger:
    """The ledger of a soak; a last line that a kill has cut is left out."""
    lines = [line.split() for line in path.read_text().splitlines(keepends=True) if "\n" in line]
    frames = [(int(words[1]), float(words[2])) for words in lines if words[0] == "frame"]
    shifts = {int(words[1]): int(words[2]) for words in lines if words[0] == "epoch"}
    return Ledger(shifts, [stamp for stamp, _ in frames], [sent_s for _, sent_s in frames])


def read_record(path: Path) -> Record:
    """The record of a soak."""
    poses, pictures, reports = [], [], []
    with path.open() as lines:
        for line in lines:
            kind, came_s, *values = json.loads(line)
            if kind == "pose":
                poses.append((came_s, values[0], values[1:]))
            elif kind == "picture":
                pictures.append(Picture(came_s, *values))
            else:
                reports.append(Report(came_s, *values))
    return Record(poses_of(poses), pictures, reports)


def poses_of(rows: Iterable[tuple[float, int, list[float]]]) -> Poses:
    """Poses from rows of time, stamp, and position, quaternion and variances in one list."""
    rows = list(rows)
    numbers = np.array([row[2] for row in rows], float).reshape(-1, 13)
    came_s = np.array([row[0] for row in rows], float)
    stamps = [row[1] for row in rows]
    return Poses(came_s, stamps, *np.split(numbers, [3, 7], axis=1))

"""Account for a soak by what was written down: the player's ledger and the witness's record.

overlay_node counts the frames since the first that came (``frames_sent``, by the numbers of their
sender) and what became of them. Between two reports of one life, as many frames must have been
counted as were sent between the newest frames that they name, and every one must have a fate.
What no report can tell: the frames after the last report of a life that was killed, and those
before the first that the next life, or a new sender, was heard of with.
"""

from __future__ import annotations

import json
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from tirgeo_ros.core.frames.rotations import quat_conjugate, quat_multiply, rotvec_from_quat
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose

_MS = 1_000_000
#: Each player that is started has so many numbers of epochs for itself.
EPOCHS = 1000


@dataclass(frozen=True)
class Ledger:
    """Hold what the players have sent, in order."""

    shift_ns: dict[int, int] = field(default_factory=dict)  # by epoch
    stamps_ns: list[int] = field(default_factory=list)  # of each frame
    sent_s: list[float] = field(default_factory=list)  # when, by the steady clock

    def place(self, stamp_ns: int) -> int | None:
        """Return which frame of all it is, from 0 on; None for one that was not sent."""
        return self._places.get(stamp_ns)

    def __post_init__(self) -> None:
        self._places: dict[int, int]
        places = {stamp: place for place, stamp in enumerate(self.stamps_ns)}
        object.__setattr__(self, "_places", places)

    def player(self, place: int) -> int:
        """Return which of the players, from 0 on, has sent a frame."""
        return epoch_of(self.stamps_ns[place]) // EPOCHS

    def sent_before(self, time_s: float) -> int:
        """Return how many frames had been sent at a time."""
        return bisect_right(self.sent_s, time_s)


def epoch_of(stamp_ns: int) -> int:
    """Return the epoch that a stamp is from: the nanoseconds below a whole millisecond."""
    return stamp_ns % _MS


@dataclass(frozen=True)
class Poses:
    """Hold the camera poses that came out, N of them in order of their coming."""

    came_s: Array  # (N,) by the steady clock
    stamps_ns: list[int]
    position_n: Array  # (N, 3) m
    q_nc: Array  # (N, 4) wxyz
    variance: Array  # (N, 6) m2 and rad2


@dataclass(frozen=True)
class Picture:
    """Hold one picture that came out."""

    came_s: float
    stamp_ns: int
    line_pixels: int


@dataclass(frozen=True)
class Report:
    """Hold what overlay_node reported of its frames at a time."""

    came_s: float
    newest_frame_ns: int
    refused: int  # frames that could not be read
    counts: dict[str, int]


@dataclass(frozen=True)
class Record:
    """Hold what the witness saw."""

    poses: Poses
    pictures: list[Picture]
    reports: list[Report]


def read_ledger(path: Path) -> Ledger:
    """Return the ledger of a soak; a last line that a kill has cut is left out."""
    lines = [line.split() for line in path.read_text().splitlines(keepends=True) if "\n" in line]
    frames = [(int(words[1]), float(words[2])) for words in lines if words[0] == "frame"]
    shifts = {int(words[1]): int(words[2]) for words in lines if words[0] == "epoch"}
    return Ledger(shifts, [stamp for stamp, _ in frames], [sent_s for _, sent_s in frames])


def read_record(path: Path) -> Record:
    """Return the record of a soak."""
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
    """Return poses from rows of time, stamp, and position, quaternion, variances in a list."""
    rows = list(rows)
    numbers = np.array([row[2] for row in rows], float).reshape(-1, 13)
    came_s = np.array([row[0] for row in rows], float)
    stamps = [row[1] for row in rows]
    return Poses(came_s, stamps, *np.split(numbers, [3, 7], axis=1))


#: The name of the count, and what it counts.
FATES = {
    "drawn": "drawn",
    "notices": "published with a notice instead of the map",
    "replaced": "replaced by a newer frame while waiting for a pose",
    "frames_missed": "replaced in the queue, or lost by the transport",
    "out_of_order": "rejected: not newer than the previous one",
    "invalid": "rejected: not a picture",
}
#: Reports, one a second.
_LONG = 20


@dataclass
class Balance:
    """Hold where the frames are."""

    sent: int
    fates: Counter[str] = field(default_factory=Counter)  # by the keys of FATES
    died: int = 0  # counted, if at all, after the last report of a life that was killed
    down: int = 0  # sent while overlay_node was down, or had not found its sender
    changed: int = 0  # the last of a sender that was killed, the first of the next one
    unaccounted: int = 0
    blind: int = 0  # lives that have reported for long and never drawn a line
    contradictions: list[str] = field(default_factory=list)

    @property
    def accounted(self) -> int:
        """Return all that have a place; equal to ``sent`` where the books are right."""
        return self.fates.total() + self.died + self.down + self.changed + self.unaccounted


@dataclass(frozen=True)
class _Count:
    """Hold one report: the newest frame's place in the ledger, and the counts."""

    came_s: float
    place: int
    received: int
    fates: Counter[str]
    waiting: int


def balance(
    ledger: Ledger, reports: Iterable[Report], lives: Sequence[tuple[float, float, bool]]
) -> Balance:
    """Return the fates of all frames.

    ``lives``: begin and end of each life of overlay_node, in order, by the steady clock, and
    whether it was killed.
    """
    frames = Balance(len(ledger.stamps_ns))
    counts = _counts(reports, ledger, frames)
    done = 0  # frames before this place have their fate
    for number, (began_s, ended_s, killed) in enumerate(lives):
        next_s = lives[number + 1][0] if number + 1 < len(lives) else float("inf")
        own = [count for count in counts if began_s <= count.came_s < next_s]
        if own:
            done = _add_life(frames, own, ledger, done)
        untold = max(0, ledger.sent_before(ended_s) - done) if own else 0
        if killed:
            frames.died += untold
        else:
            frames.unaccounted += untold
        done += untold
    frames.down += frames.sent - done
    return frames


def _counts(reports: Iterable[Report], ledger: Ledger, frames: Balance) -> list[_Count]:
    counts = []
    for report in reports:
        values, newest_ns = report.counts, report.newest_frame_ns
        if not newest_ns:
            continue
        place = ledger.place(newest_ns)
        if place is None:
            frames.contradictions.append(f"newest frame {newest_ns} was never sent")
            continue
        fates = Counter({key: values[key] for key in FATES})
        fates["invalid"] += report.refused
        received, waiting = values["frames_sent"], values["waiting"]
        counts.append(_Count(report.came_s, place, received, fates, waiting))
        off = received - fates.total() - waiting
        if off:
            frames.contradictions.append(f"{off} of {received} frames have no fate: {values}")
    return counts


def _add_life(frames: Balance, own: Sequence[_Count], ledger: Ledger, done: int) -> int:
    """Account for one life by its reports; return the place behind their last frame."""
    first, last = own[0], own[-1]
    began = first.place + 1 - first.received
    frames.down += max(0, began - done)
    frames.unaccounted += max(0, done - began)  # more than were sent
    for before, after in pairwise(own):
        lacking = (after.place - before.place) - (after.received - before.received)
        if lacking > 0 and ledger.player(before.place) != ledger.player(after.place):
            frames.changed += lacking
        else:
            frames.unaccounted += abs(lacking)
    frames.fates += last.fates
    frames.blind += len(own) >= _LONG and not last.fates["drawn"]
    frames.died += last.waiting
    return last.place + 1


#: Colour on so few pixels is no line.
_LEAST_INK = 20
#: Between two poses so far apart there is a pose, and so long after the last one a prediction:
#: the defaults of PoseHistory and of overlay_node's max_prediction_s.
_BETWEEN_NS, _AHEAD_NS = 250_000_000, 100_000_000


@dataclass(frozen=True)
class Deviations:
    """Hold the poses against the truth."""

    stamps_ns: list[int]  # of those that have a truth
    sigmas: Array  # (N, 6) errors over their sigma: north, east, down, and rotation about these
    strangers: int  # poses at instants of which nothing was sent


def deviations(
    poses: Poses, cameras: Mapping[int, CameraPose], shift_ns: Mapping[int, int], period_ns: int,
    start_ns: int,
) -> Deviations:  # fmt: skip
    """Return the errors of poses; ``cameras`` are the true ones by time in a round."""
    matched, true = [], []
    for k, stamp_ns in enumerate(poses.stamps_ns):
        shift = shift_ns.get(epoch_of(stamp_ns))
        camera = None
        if shift is not None:
            camera = cameras.get((stamp_ns - shift - start_ns) % period_ns)
        if camera is not None:
            matched.append(k)
            true.append(camera)
    position = np.array([camera.position_n for camera in true]).reshape(-1, 3)
    attitude = np.array([camera.q_nc for camera in true]).reshape(-1, 4)
    turned = rotvec_from_quat(quat_multiply(poses.q_nc[matched], quat_conjugate(attitude)))
    errors = np.hstack([poses.position_n[matched] - position, turned])
    with np.errstate(divide="ignore", invalid="ignore"):
        sigmas = np.abs(errors) / np.sqrt(poses.variance[matched])
    stamps = [poses.stamps_ns[k] for k in matched]
    return Deviations(stamps, sigmas, len(poses.stamps_ns) - len(matched))


def witnessed(
    pictures: Sequence[Picture], poses: Poses, gimbals_s: Sequence[float], latency_ns: int
) -> list[Picture]:
    """Return the pictures whose poses the witness has, if there were any.

    ``gimbals_s``: when each gimbal_node was started. overlay_node may have found it, and got its
    poses, before the witness has.
    """
    left_out: set[int] = set()
    for began_s in gimbals_s:
        first = int(np.searchsorted(poses.came_s, began_s))
        exists = first < len(poses.stamps_ns)
        came_s, stamp_ns = (poses.came_s[first], poses.stamps_ns[first]) if exists else (np.inf, 0)
        for number, picture in enumerate(pictures):
            early = epoch_of(picture.stamp_ns) == epoch_of(stamp_ns) and (
                picture.stamp_ns - latency_ns < stamp_ns
            )
            if picture.came_s >= began_s and (picture.came_s <= came_s or early):
                left_out.add(number)
    return [picture for number, picture in enumerate(pictures) if number not in left_out]


def lines_without_pose(
    pictures: Sequence[Picture], stamps_ns: Sequence[int], latency_ns: int
) -> list[Picture]:
    """Return pictures with lines at whose exposure there was no pose, nor one to go on from."""
    by_epoch: defaultdict[int, list[int]] = defaultdict(list)
    for stamp_ns in stamps_ns:
        by_epoch[epoch_of(stamp_ns)].append(stamp_ns)
    for stamps in by_epoch.values():
        stamps.sort()
    return [
        picture
        for picture in pictures
        if has_lines(picture)
        and not _posed(by_epoch[epoch_of(picture.stamp_ns)], picture.stamp_ns - latency_ns)
    ]


def has_lines(picture: Picture) -> bool:
    """Return whether lines are drawn in a picture."""
    return picture.line_pixels >= _LEAST_INK


def _posed(stamps_ns: Sequence[int], exposure_ns: int) -> bool:
    """Return whether a pose can be had at an instant, of poses in order."""
    last = bisect_right(stamps_ns, exposure_ns) - 1
    if last < 0:
        return False
    if exposure_ns - stamps_ns[last] <= _AHEAD_NS:
        return True
    after = bisect_left(stamps_ns, exposure_ns)
    return after < len(stamps_ns) and stamps_ns[after] - stamps_ns[last] <= _BETWEEN_NS

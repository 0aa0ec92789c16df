"""Account for a soak by what was written down: the player's ledger and the witness's record.

overlay_node counts the frames since the first that came (``frames_sent``, by the numbers of their
sender) and what became of them. Between two reports of one life and one sender, as many frames
must have been counted as were sent between the newest frames that they name, and every one must
have a fate. A life that was not killed reports its last frame.
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

    shift_ns: dict[int, int]  # by epoch
    stamps_ns: list[int] = field(default_factory=list)  # of each frame
    sent_s: list[float] = field(default_factory=list)  # when, by the steady clock


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


#: overlay_node's counts of what became of a frame.
FATES = ("drawn", "notices", "replaced", "frames_missed", "out_of_order", "invalid")
#: Reports, one a second.
_LONG = 20


@dataclass
class Balance:
    """Hold where the frames are."""

    fates: Counter[str] = field(default_factory=Counter)  # by FATES, of all lives
    unaccounted: int = 0
    blind: int = 0  # lives that have reported for long and never drawn a line
    contradictions: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class _Count:
    """Hold one report: the newest frame's place in the ledger, and the counts."""

    came_s: float
    place: int
    player: int
    received: int
    fates: Counter[str]


def balance(
    ledger: Ledger, reports: Iterable[Report], lives: Sequence[tuple[float, float, bool]]
) -> Balance:
    """Return the fates of the frames.

    ``lives``: begin and end of each life of overlay_node, in order, by the steady clock, and
    whether it was killed.
    """
    frames = Balance()
    counts = _counts(reports, ledger, frames)
    ends_s = [*(began_s for began_s, _, _ in lives[1:]), float("inf")]
    for (began_s, ended_s, killed), next_s in zip(lives, ends_s, strict=True):
        own = [count for count in counts if began_s <= count.came_s < next_s]
        if not own:
            continue
        for before, after in pairwise(own):
            if before.player == after.player:
                counted = after.received - before.received
                frames.unaccounted += abs(after.place - before.place - counted)
        if not killed:
            sent = bisect_right(ledger.sent_s, ended_s)
            frames.unaccounted += max(0, sent - own[-1].place - 1)
        frames.fates += own[-1].fates
        frames.blind += len(own) >= _LONG and not own[-1].fates["drawn"]
    return frames


def _counts(reports: Iterable[Report], ledger: Ledger, frames: Balance) -> list[_Count]:
    places = {stamp_ns: place for place, stamp_ns in enumerate(ledger.stamps_ns)}
    counts = []
    for report in reports:
        values, newest_ns = report.counts, report.newest_frame_ns
        if newest_ns and newest_ns not in places:
            frames.contradictions.append(f"newest frame {newest_ns} was never sent")
        if newest_ns not in places:
            continue
        fates = Counter({key: values[key] for key in FATES})
        fates["invalid"] += report.refused
        received, player = values["frames_sent"], epoch_of(newest_ns) // EPOCHS
        counts.append(_Count(report.came_s, places[newest_ns], player, received, fates))
        off = received - fates.total() - values["waiting"]
        if off:
            frames.contradictions.append(f"{off} of {received} frames have no fate: {values}")
    return counts


#: A picture's exposure is at most so long before its coming.
_MEET_S = 2.0
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
    pictures: Sequence[Picture], poses: Poses, gimbals_s: Sequence[float]
) -> list[Picture]:
    """Return the pictures whose poses the witness has, if there were any.

    ``gimbals_s``: when each gimbal_node was started. overlay_node may have met it, and got its
    poses, before the witness has.
    """
    firsts = [int(np.searchsorted(poses.came_s, began_s)) for began_s in gimbals_s]
    met_s = [*poses.came_s, np.inf]
    spans = [(began, met_s[k] + _MEET_S) for began, k in zip(gimbals_s, firsts, strict=True)]
    return [p for p in pictures if not any(begin <= p.came_s <= end for begin, end in spans)]


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

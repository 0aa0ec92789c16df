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
"""``make soak`` runs ``python -m dev.soak``: a table, and exit code 1 if a figure is missed.

overlay_node counts the frames since the first that came (``frames_sent``, by the numbers of their
sender) and what became of them. Between two reports of one life and one sender, as many frames
must have been counted as were sent between the newest frames that they name, and every one must
have a fate. A life that was not killed reports its last frame.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import tempfile
from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count, pairwise
from pathlib import Path

import numpy as np

from dev.flights import SoakFlight, make_soak_flight
from dev.judging import Figure, exit_code, print_figures
from dev.soak.run import EPOCHS, LEDGER, RECORD, Event, Life, Lives, run_soak, schedule
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.rotations import quat_conjugate, quat_multiply, rotvec_from_quat
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.tools.cli.main import unwind_on_signals
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

#: What is shorter cannot tell of memory.
_SHORT_S = 300.0
_SETTLED_S = 60.0
#: Means over so long are compared: single samples show what a frame borrows.
_BLOCK_S = 15.0
#: So long may no pose and no picture come, by the clock on the wall: a node is down for 3 s, and
#: on a machine with much other work takes many more to start and to be found.
_SILENCE = "<= 60"
_GROWTH, _SIGMAS, _NONE = "<= 2", "<= 4", "<= 0"
_MS = 1_000_000


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
class FrameReport:
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
    reports: list[FrameReport]


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
                reports.append(FrameReport(came_s, *values))
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
    ledger: Ledger, reports: Iterable[FrameReport], lives: Sequence[tuple[float, float, bool]]
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


def _counts(reports: Iterable[FrameReport], ledger: Ledger, frames: Balance) -> list[_Count]:
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


def growth(samples: Sequence[tuple[float, int]]) -> float:
    """Return how much more memory a life has later than after its first minute: a part of that.

    ``samples``: seconds of life, and the bytes of its own, without the pages of Fast DDS's shared
    memory, of which docs/soak.md tells. Return nan where it was too short to have a later block.
    """
    means: list[float] = []  # of each block
    for number in count():
        begin_s = _SETTLED_S + number * _BLOCK_S
        block = [held for at_s, held in samples if begin_s <= at_s < begin_s + _BLOCK_S]
        if not block or samples[-1][0] < begin_s + _BLOCK_S:
            break
        means.append(float(np.mean(block)))
    return max(means[1:]) / means[0] - 1 if len(means) > 1 else math.nan


def memory_figures(lives: Sequence[Life], *, short: bool = False) -> Iterator[Figure]:
    """Yield each node's largest growth; the soak's own are not judged, nor any in a short soak."""
    for node in dict.fromkeys(life.node for life in lives):
        grown = [growth(life.memory) for life in lives if life.node == node]
        most = max((item for item in grown if not math.isnan(item)), default=math.nan)
        judged = not node.startswith("soak_") and not (short and math.isnan(most))
        asked = _GROWTH if judged else ""
        yield Figure(f"{node}: memory grown after its first minute", 100 * most, "%", asked)


def leftover_figures(lives: Lives) -> Iterator[Figure]:
    """Yield what is left, and who went without being asked."""
    ended = len(lives.by_themselves)
    yield Figure("segments left in shared memory", len(lives.left_files()), "", _NONE)
    yield Figure("processes left", len(lives.left_processes()), "", _NONE)
    yield Figure("nodes that ended by themselves or with an error", ended, "", _NONE)


def frame_figures(frames: Balance, sent: int) -> Iterator[Figure]:
    """Yield what became of the frames."""
    yield Figure("frames sent", sent)
    yield from (Figure(f"  {fate}", frames.fates[fate]) for fate in FATES)
    yield Figure("  without account", frames.unaccounted, "", _NONE)
    yield Figure("reports that contradict themselves", len(frames.contradictions), "", _NONE)
    yield Figure("lives of overlay_node of 20 s and more without a line", frames.blind, "", _NONE)


def pose_figures(record: Record, ledger: Ledger, flight: SoakFlight) -> Iterator[Figure]:
    """Yield the poses against the truth, in sigmas, axis by axis."""
    against = deviations(
        record.poses, flight.cameras, ledger.shift_ns, flight.period_ns, flight.start_ns
    )
    sigmas = against.sigmas if len(against.sigmas) else np.full((1, 6), math.nan)
    position, attitude = float(sigmas[:, :3].max()), float(sigmas[:, 3:].max())
    yield Figure("camera poses", len(against.stamps_ns))
    yield Figure("  at times of which nothing was sent", against.strangers, "", _NONE)
    yield Figure("  farthest from the truth, position", position, "sigma", _SIGMAS)
    yield Figure("  farthest from the truth, attitude", attitude, "sigma", _SIGMAS)
    yield Figure("longest time without a pose", _silence_s(record.poses.came_s), "s", _SILENCE)


def picture_figures(record: Record, lives: Sequence[Life]) -> Iterator[Figure]:
    """Yield the pictures with lines, and those of them that had no pose."""
    latency_ns = round(OverlayConfig().video_latency_s * 1e9)
    gimbals = [life.began_s for life in lives if life.node == "gimbal_node"]
    judged = witnessed(record.pictures, record.poses, gimbals)
    wrong = lines_without_pose(judged, record.poses.stamps_ns, latency_ns)
    came_s = np.array([picture.came_s for picture in record.pictures])
    yield Figure("pictures with lines", sum(map(has_lines, judged)))
    yield Figure("  where there is no pose", len(wrong), "", _NONE)
    left_out = len(record.pictures) - len(judged)
    yield Figure("pictures not judged: the witness had not found the poses", left_out)
    yield Figure("longest time without a picture", _silence_s(came_s), "s", _SILENCE)


def _silence_s(came_s: Array) -> float:
    """Return the longest time between two that came; infinite where none or one did."""
    return float(np.diff(came_s).max()) if len(came_s) > 1 else math.inf


def judged(lives: Lives, folder: Path, flight: SoakFlight, *, short: bool) -> list[Figure]:
    """Return all figures of a soak."""
    ledger, record = read_ledger(folder / LEDGER), read_record(folder / RECORD)
    overlays = [life for life in lives.all if life.node == "overlay_node"]
    spans = [(life.began_s, life.ended_s or math.inf, life.killed) for life in overlays]
    return [
        *memory_figures(lives.all, short=short),
        *leftover_figures(lives),
        *frame_figures(balance(ledger, record.reports, spans), len(ledger.stamps_ns)),
        *pose_figures(record, ledger, flight),
        *picture_figures(record, lives.all),
    ]


def soak(
    flight: SoakFlight,
    folder: Path,
    duration_s: float,
    events: list[Event],
    progress: Report = silent,
) -> list[Figure]:
    """Run a soak and judge it; ``soak.json`` is left in the folder.

    Raises GraphError for a node that does not start.
    """
    folder.mkdir(parents=True, exist_ok=True)
    lives = run_soak(flight, events, folder, duration_s, progress)
    figures = judged(lives, folder, flight, short=duration_s < _SHORT_S)
    result = {
        "figures": [figure._asdict() | {"missed": figure.missed} for figure in figures],
        "events": [[e.at_s, e.kind.value, e.node, e.lasts_s] for e in events],
        "ended_by_themselves": lives.by_themselves,
        "memory": [{"node": life.node, "s_bytes": life.memory} for life in lives.all],
    }
    (folder / "soak.json").write_text(json.dumps(result, indent=2) + "\n")
    return figures


def _run(minutes: float, seed: int, folder: Path) -> int:
    duration_s = 60 * minutes
    events = schedule(seed, duration_s)
    with tempfile.TemporaryDirectory() as made:
        with Progress("simulating the flight", "s") as bar:
            flight = make_soak_flight(Path(made), bar)
        with Progress("soaking", "s") as bar:
            figures = soak(flight, folder, duration_s, events, bar)
    happened = Counter(event.kind.value for event in events)
    words = ", ".join(f"{number} x {what}" for what, number in happened.items())
    sys.stdout.write(f"{minutes:g} minutes; {words}\n")
    missed = sum(figure.missed for figure in print_figures(figures))
    if missed:
        sys.stdout.write(f"{missed} figures are missed, marked with !: see {folder}\n")
    return 1 if missed else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m dev.soak", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="of the clock on the wall")
    parser.add_argument("--seed", type=int, default=1, help="of what happens when")
    parser.add_argument("-o", "--out", type=Path, default=Path("soak"), metavar="DIR")
    args = parser.parse_args(argv)
    if not args.minutes > 0:
        parser.error("--minutes: more than 0")
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    return exit_code("soak", lambda: _run(args.minutes, args.seed, args.out))


if __name__ == "__main__":
    unwind_on_signals()
    sys.exit(main())

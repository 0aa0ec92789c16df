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
"""Judge the filter on a folder of recorded flights, which have no truth: ``make real-flights``.

Each bag is flown as it is, with RTK hidden for some seconds again and again, and with positions
that are wrong for a second. The references are fixes before they are used, fixes that are held
back, and the autopilot's own tilt; all later than 8 s after the first sample. Prints the results
by bag and by group: bags of one carrier (their name up to the first ``_``) with the same kinds of
RTK data. If a figure is missed, it is marked and the exit code is 1.
"""

from __future__ import annotations

import argparse
import math
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeGuard

import numpy as np
import yaml

from dev.flight_errors import published
from dev.judging import MarkedTable, exit_code, in_processes, print_report
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import euler_from_quat, matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import smoothed
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ConfigError, TirgeoError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    ImuSample,
    NavigationInput,
    PositionSample,
    Source,
)
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import FilterState, Verdict
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import NAVIGATION_INPUTS
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

#: The filter is judged from here on.
SETTLED_S = 8.0
#: RTK is hidden for CUT_S, first FIRST_CUT_S after the start, then every CUT_EVERY_S; at three
#: phases, each a run of its own.
CUT_S, FIRST_CUT_S, CUT_EVERY_S = 5.0, 14.0, 13.0
PHASES_S = (0.0, CUT_EVERY_S / 3, 2 * CUT_EVERY_S / 3)
#: An older pose does not count.
_FRESH_NS = 100_000_000
_RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)


class Miss(NamedTuple):
    """Hold the horizontal distance from a fix to the pose extrapolated to it; nan if no pose."""

    error_m: float
    sigma_m: float  # the filter's own

    def within(self, sigmas: float) -> bool:
        """Return whether the error is within so many of the filter's own sigmas."""
        return self.error_m <= sigmas * self.sigma_m


@dataclass(frozen=True)
class Flown:
    """Hold the results of one flight, later than SETTLED_S."""

    fixes: int  # RTK positions, float or fixed, up to the last IMU sample
    used: int  # of them
    lost_s: float
    resets: int
    pose: float  # share of the time with a fresh pose
    misses: tuple[Miss, ...]  # of every fix that had a fresh pose before it
    tilt: Array  # (n, 2) roll and pitch found less the autopilot's, rad
    nis: dict[Source, tuple[float, int]]  # sum of squares, degrees of freedom
    poses: tuple[NavSolution, ...]


def samples_of(path: str | Path) -> list[NavigationInput]:
    """Return every sample of a bag that is for the filter, in log-time order."""
    cdr = Cdr()
    convert = {f"/{topic}": decode for topic, decode in NAVIGATION_INPUTS.values()}
    return [
        convert[message.topic](cdr.deserialize(message.data, message.typename))
        for message in BagReader(path).messages(convert)
    ]


def fly_bag(config: EkfConfig, samples: Sequence[NavigationInput]) -> Flown:
    """Run the filter over samples and return the results."""
    start_ns = now_ns = samples[0].stamp_ns
    settled_ns = start_ns + round(SETTLED_S * 1e9)
    fresh_ns = lost_ns = used = 0
    squares: defaultdict[Source, float] = defaultdict(float)
    degrees: Counter[Source] = Counter()
    misses, tilt, fixes_ns = list[Miss](), list[Array](), list[int]()
    poses: list[NavSolution] = []

    def count(verdict: Verdict) -> None:
        nonlocal used
        if now_ns <= settled_ns or verdict.source not in _RTK:
            return
        used += verdict.used and verdict.source is Source.RTK_POSITION
        if math.isfinite(verdict.nis):
            squares[verdict.source] += verdict.nis * len(verdict.innovation)
            degrees[verdict.source] += len(verdict.innovation)

    navigation = Navigation(config, count)
    for sample in samples:
        if _is_fix(sample) and now_ns > settled_ns:  # as its verdict is counted
            fixes_ns.append(sample.stamp_ns)
            if _is_fresh(poses, sample.stamp_ns):
                misses.append(_missed(sample, poses[-1], config.aircraft.rtk_lever_b))
        solution = navigation.process(sample).solution
        if solution is not None:
            poses.append(solution)
        if not isinstance(sample, ImuSample):
            continue
        step_ns, now_ns = sample.stamp_ns - now_ns, sample.stamp_ns
        if now_ns > settled_ns:
            fresh_ns += step_ns * _is_fresh(poses, now_ns)
            lost_ns += step_ns * (navigation.status().state is FilterState.LOST)
            tilt += _tilt(sample, solution)
    return Flown(
        sum(stamp_ns <= now_ns for stamp_ns in fixes_ns),
        used,
        lost_ns * 1e-9,
        sum(navigation.status().resets.values()),
        fresh_ns / (now_ns - settled_ns),
        tuple(misses),
        np.array(tilt).reshape(-1, 2),
        {source: (squares[source], n) for source, n in degrees.items()},
        tuple(poses),
    )


def _is_fresh(poses: Sequence[NavSolution], stamp_ns: int) -> bool:
    return bool(poses) and stamp_ns - poses[-1].stamp_ns <= _FRESH_NS


def _tilt(sample: ImuSample, solution: NavSolution | None) -> list[Array]:
    """Return roll and pitch less the autopilot's, rad; nothing where one is missing."""
    if solution is None or sample.autopilot_q_nb is None:
        return []
    return [(euler_from_quat(solution.q_nb) - euler_from_quat(sample.autopilot_q_nb))[:2]]


def _is_fix(sample: NavigationInput) -> TypeGuard[PositionSample]:
    """Return whether a sample is an RTK position, float or fixed."""
    return (
        isinstance(sample, PositionSample)
        and sample.source is Source.RTK_POSITION
        and sample.status >= FixStatus.FLOAT
    )


def _missed(fix: PositionSample, pose: NavSolution, lever_b: Array) -> Miss:
    plane = TangentPlane(fix.latitude_rad, fix.longitude_rad, fix.height_m)
    found_n = plane.ned_from_geodetic(pose.latitude_rad, pose.longitude_rad, pose.height_m)
    found_n = found_n + (fix.stamp_ns - pose.stamp_ns) * 1e-9 * pose.velocity_n
    found_n = found_n + matrix_from_quat(pose.q_nb) @ lever_b
    sigma_m = math.sqrt(pose.covariance[0, 0] + pose.covariance[1, 1])
    return Miss(math.hypot(found_n[0], found_n[1]), sigma_m)


def hidden_fixes(
    config: EkfConfig, samples: Sequence[NavigationInput], *, smooth: bool = False
) -> list[list[Miss]]:
    """Return, for every cut, the pose's errors at all fixes that were held back.

    All RTK data are held back; ordinary GPS, where there is some, goes on.
    """
    cuts: list[list[Miss]] = []
    for phase_s in PHASES_S:
        cut = [_cut_at(sample, samples, phase_s) for sample in samples]
        kept = [sample for sample, number in zip(samples, cut, strict=True) if number is None]
        navigation, pose = smoothed(config, kept) if smooth else Navigation(config), None
        hidden: defaultdict[int, list[Miss]] = defaultdict(list)
        for sample, number in zip(samples, cut, strict=True):
            if number is None:
                pose = navigation.process(sample).solution or pose
            elif _is_fix(sample):
                hidden[number].append(_missed_by(sample, pose, config))
        cuts += hidden.values()
    return cuts


def _cut_at(
    sample: NavigationInput, samples: Sequence[NavigationInput], phase_s: float
) -> int | None:
    """Return the number of the cut that hides a sample, None for one that is kept."""
    if sample.source not in _RTK:
        return None
    since_s = (sample.stamp_ns - samples[0].stamp_ns) * 1e-9 - FIRST_CUT_S - phase_s
    number, inside_s = divmod(since_s, CUT_EVERY_S)
    length_s = (samples[-1].stamp_ns - samples[0].stamp_ns) * 1e-9
    begins_s = since_s - inside_s + FIRST_CUT_S + phase_s
    whole = number >= 0 and begins_s < length_s - CUT_S
    return int(number) if whole and inside_s < CUT_S else None


def _missed_by(fix: PositionSample, pose: NavSolution | None, config: EkfConfig) -> Miss:
    """Return how far a fix is from the pose before it; the sigma is that of the difference."""
    if pose is None or fix.stamp_ns - pose.stamp_ns > _FRESH_NS:
        return Miss(math.nan, math.nan)
    error_m, sigma_m = _missed(fix, pose, config.aircraft.rtk_lever_b)
    least_m2 = config.rtk.position_sigma_floor_m**2
    own_m2 = np.maximum(fix.covariance_n.diagonal()[:2], least_m2).sum()
    return Miss(error_m, math.sqrt(sigma_m * sigma_m + own_m2))


def moved_east(
    samples: Sequence[NavigationInput], begin_s: float, seconds: float, metres: float
) -> list[NavigationInput]:
    """Return the samples with the RTK positions of some seconds moved east by ``metres``."""
    begin_ns = samples[0].stamp_ns + round(begin_s * 1e9)
    end_ns = begin_ns + round(seconds * 1e9)

    def moved(sample: NavigationInput) -> NavigationInput:
        if not _is_fix(sample) or not begin_ns <= sample.stamp_ns < end_ns:
            return sample
        plane = TangentPlane(sample.latitude_rad, sample.longitude_rad, sample.height_m)
        lat, lon, height_m = map(float, plane.geodetic_from_ned(np.array([0.0, metres, 0.0])))
        return replace(sample, latitude_rad=lat, longitude_rad=lon, height_m=height_m)

    return [moved(sample) for sample in samples]


def largest_change_m(a: Sequence[NavSolution], b: Sequence[NavSolution]) -> float:
    """Return the largest horizontal distance between two runs over the same IMU samples, m."""
    others = {pose.stamp_ns: pose for pose in b}
    largest = 0.0
    for pose in a:
        other = others.get(pose.stamp_ns)
        if other is not None:
            north_m = (other.latitude_rad - pose.latitude_rad) * 6.37e6
            east_m = (other.longitude_rad - pose.longitude_rad) * 6.37e6
            largest = max(largest, math.hypot(north_m, east_m * math.cos(pose.latitude_rad)))
    return largest


#: Positions are wrong by this much, this long, from one time and from shares of the flight.
MOVED_M, MOVED_FOR_S = 0.5, 1.0
MOVED_AT_S, MOVED_AT_SHARES = 16.0, (0.4, 0.75)


@dataclass(frozen=True)
class Judged:
    """Hold the results of one bag."""

    name: str
    aids: str
    flown: Flown  # without its poses
    cuts: tuple[Miss, ...]
    moved_m: tuple[float, ...]  # by a wrong position, of each

    @property
    def group(self) -> str:
        """Return carrier and aids."""
        return f"{self.name.partition('_')[0]}, {self.aids}"


def config_of(samples: Sequence[NavigationInput], values: Mapping[str, object]) -> EkfConfig:
    """Return the defaults with ``values`` and, unless they set it, the method for the aids."""
    headings = any(sample.source is Source.RTK_HEADING for sample in samples)
    method = "ekf_heading" if headings else "ekf"
    return config_from(EkfConfig, {"method": method} | dict(values))


def judge(path: Path, values: Mapping[str, object]) -> Judged:
    """Fly a bag in every way. Raises TirgeoError if it cannot be read or is too short."""
    samples = samples_of(path)
    length_s = (samples[-1].stamp_ns - samples[0].stamp_ns) * 1e-9 if samples else 0.0
    if length_s <= SETTLED_S + MOVED_FOR_S:
        raise TirgeoError(f"{path}: {length_s:.1f} s of samples for the filter are too few")
    config = config_of(samples, values)
    flown = fly_bag(config, samples)
    moved_m = [
        largest_change_m(
            flown.poses,
            published(Navigation(config), moved_east(samples, t_s, MOVED_FOR_S, MOVED_M)),
        )
        for t_s in (MOVED_AT_S, *(max(share * length_s, SETTLED_S) for share in MOVED_AT_SHARES))
    ]
    cuts = tuple(misses[-1] for misses in hidden_fixes(config, samples))
    sources = {sample.source for sample in samples}
    kinds = {"velocities": Source.RTK_VELOCITY, "headings": Source.RTK_HEADING}
    aids = ["positions", *(name for name, source in kinds.items() if source in sources)]
    return Judged(path.stem, ", ".join(aids), replace(flown, poses=()), cuts, tuple(moved_m))


def judge_all(
    bags: Sequence[Path],
    values: Mapping[str, object],
    workers: int = 1,
    progress: Report = silent,
) -> list[Judged]:
    """Judge bags in ``workers`` processes; return the results in the order of the bags."""
    return in_processes(partial(judge, values=values), bags, workers, progress)


def groups(judged: Sequence[Judged]) -> dict[str, list[Judged]]:
    """Return bags by carrier and aids, in their order."""
    named: dict[str, list[Judged]] = {}
    for each in judged:
        named.setdefault(each.group, []).append(each)
    return named


def median(values: Sequence[float]) -> float:
    """Return the median, with nan as infinity; nan if there are no values."""
    return float(np.median(np.nan_to_num(values, nan=math.inf))) if len(values) else math.nan


def used_of(bags: Sequence[Judged]) -> float:
    """Return the share of the fixes of several bags that was used; nan without a fix."""
    fixes = sum(each.flown.fixes for each in bags)
    return sum(each.flown.used for each in bags) / fixes if fixes else math.nan


def beyond(bags: Sequence[Judged]) -> float:
    """Return the share of poses that are more than 5 of their sigmas off their fix."""
    misses = [miss for each in bags for miss in each.flown.misses]
    return float(np.mean([not miss.within(5) for miss in misses])) if misses else math.nan


#: Least share of fixes used in each bag and in all; least share of the time with a pose.
#: Largest share of poses beyond 5 sigma, in all bags; largest move by a wrong position, m.
ASKED_USED_EACH, ASKED_USED, ASKED_POSE = 0.94, 0.97, 0.95
ASKED_BEYOND, ASKED_MOVED_M = 0.01, 0.5


_TIMES = 1 + len(MOVED_AT_SHARES)


@dataclass(frozen=True)
class Asked:
    """Hold the required figures of a group: means and medians over its bags."""

    used: float = 0.0  # share
    roll_pitch_deg: tuple[float, float] = (math.inf, math.inf)
    nis: tuple[float, float] = (-math.inf, math.inf)  # of positions, over degrees of freedom
    cut_m: float = math.inf
    within: float = 0.0  # share of the cuts within 3 sigma
    sigma_m: float = math.inf
    #: Median error over median sigma. A consistent filter has 0.67 where errors lie along one
    #: line, and 0.83 where they are as large in all horizontal directions.
    ratio: tuple[float, float] = (-math.inf, math.inf)


#: Groups with figures of their own: the recordings of ../shared/real_flights.
ASKED = {
    "p4rtk, positions": Asked(0.0, (1.3, 1.6), (0.5, 1.5), 2.0, 0.95, 3.2, (0.6, 1.2)),
    "walk, positions, velocities": Asked(0.98, cut_m=0.4),
}


def report(judged: Sequence[Judged]) -> tuple[list[str], int]:
    """Return the lines of the report and the number of missed figures."""
    table = MarkedTable(46, 10)
    lines = [*_fixes(table, judged), "", *_tilt_and_nis(table, judged), "", *_cuts(table, judged)]
    return lines, table.missed


def _fixes(table: MarkedTable, judged: Sequence[Judged]) -> Iterator[str]:
    yield f"fixes and poses later than {SETTLED_S:g} s; moved: the largest change of a pose by"
    yield f"positions that are {MOVED_M:g} m wrong for {MOVED_FOR_S:g} s ({_TIMES} times a flight)"
    yield table.row("", ["used ", "lost ", "resets ", "pose ", ">5 sigma ", "moved "])
    yield table.row("", ["% ", "s ", "", "% ", "% ", "m "])
    asked = [f">={100 * ASKED_USED_EACH:g} ", "0 ", "0 ", f">={100 * ASKED_POSE:g} ", ""]
    yield table.row("asked of each bag", [*asked, f"<={ASKED_MOVED_M:g} "])
    for each in judged:
        flown = each.flown
        cells = [
            table.cell(100 * used_of([each]), 100 * ASKED_USED_EACH, digits=1),
            table.cell(flown.lost_s, high=0.0, digits=1),
            table.cell(flown.resets, high=0, digits=0),
            table.cell(100 * flown.pose, 100 * ASKED_POSE, digits=1),
            table.cell(100 * beyond([each])),
            table.cell(max(each.moved_m), high=ASKED_MOVED_M),
        ]
        yield table.row(each.name, cells)
    for name, bags in groups(judged).items():
        least = ASKED.get(name, Asked()).used
        words = f"{name} (>={100 * least:g} %)" if least else name
        yield table.row(words, _together(table, bags, least or -math.inf, math.inf))
    yield table.row(
        f"all (>={100 * ASKED_USED:g} %, >5 sigma <={100 * ASKED_BEYOND:g} %)",
        _together(table, judged, ASKED_USED, ASKED_BEYOND),
    )


def _together(table: MarkedTable, bags: Sequence[Judged], used: float, most: float) -> list[str]:
    share = table.cell(100 * used_of(bags), 100 * used, digits=1)
    return [share, "", "", "", table.cell(100 * beyond(bags), high=100 * most)]


def _tilt_and_nis(table: MarkedTable, judged: Sequence[Judged]) -> Iterator[str]:
    yield "roll and pitch less the autopilot's, rms; NIS over its degrees of freedom"
    yield table.row("", ["roll ", "pitch ", *("NIS " for _ in _RTK)])
    yield table.row("", ["deg ", "deg ", "position ", "velocity ", "heading "])
    for name, bags in groups(judged).items():
        asked = ASKED.get(name, Asked())
        low, high = asked.nis
        if math.isfinite(high):
            most = [f"<={deg:g} " for deg in asked.roll_pitch_deg]
            yield table.row(f"asked, {name}", [*most, f"{low:g}..{high:g} "])
        no_tilt = np.full(2, math.nan)
        tilts = [rms(tilt) if len(tilt := each.flown.tilt) else no_tilt for each in bags]
        means = np.degrees(np.mean(tilts, axis=0))
        nis = [
            [np.divide(*each.flown.nis.get(source, (math.nan, 1))) for each in bags]
            for source in _RTK
        ]
        first, *others = np.mean(nis, axis=1).tolist()
        cells = [table.cell(means[k], high=asked.roll_pitch_deg[k]) for k in range(2)]
        cells += [table.cell(first, low, high), *map(table.cell, others)]
        yield table.row(f"mean, {name}", cells)


def _cuts(table: MarkedTable, judged: Sequence[Judged]) -> Iterator[str]:
    yield f"RTK hidden for {CUT_S:g} s: the pose at the last hidden fix, medians, horizontal"
    yield table.row("", ["cuts ", "error ", "<3 sigma ", "sigma ", "ratio "])
    yield table.row("", ["", "m ", "% ", "m ", ""])
    for name, bags in groups(judged).items():
        asked = ASKED.get(name, Asked())
        if asked != Asked():
            within = f">={100 * asked.within:g} " if asked.within else ""
            sigma = f"<={asked.sigma_m:g} " if math.isfinite(asked.sigma_m) else ""
            low, high = asked.ratio
            ratio = f"{low:g}..{high:g} " if math.isfinite(high) else ""
            yield table.row(f"asked, {name}", ["", f"<={asked.cut_m:g} ", within, sigma, ratio])
        cuts = [cut for each in bags for cut in each.cuts]
        share = float(np.mean([cut.within(3) for cut in cuts])) if cuts else math.nan
        error_m = median([cut.error_m for cut in cuts])
        sigma_m = median([cut.sigma_m for cut in cuts])
        cells = [
            f"{len(cuts)} ",
            table.cell(error_m, high=asked.cut_m),
            table.cell(100 * share, 100 * asked.within or -math.inf, digits=1),
            table.cell(sigma_m, high=asked.sigma_m),
            table.cell(error_m / sigma_m, *asked.ratio),
        ]
        yield table.row(f"all, {name}", cells)


def values_from(pairs: Sequence[Sequence[str]]) -> dict[str, object]:
    """Return parameters from pairs of name and YAML value. Raises ConfigError."""
    try:
        values = {name: yaml.safe_load(text) for name, text in pairs}
    except yaml.YAMLError as error:
        raise ConfigError(f"a value is not YAML: {error}") from None
    config_from(EkfConfig, values)
    return values


def bags_in(folder: Path) -> list[Path]:
    """Return the bags of a folder that have an IMU, sorted. Raises TirgeoError where none has."""
    paths = sorted(folder.glob("*.mcap"))
    bags = [path for path in paths if "/imu/data" in BagReader(path).topics()]
    if not bags:
        raise TirgeoError(f"{folder}: no bags (*.mcap) with /imu/data in it")
    return bags


def main(argv: Sequence[str] | None = None) -> int:
    """Fly all bags and print the report."""
    parser = argparse.ArgumentParser(prog="python -m dev.real_flights")
    parser.add_argument("folder", type=Path, help="bags (*.mcap) of recorded flights")
    parser.add_argument(
        "--set",
        nargs=2,
        action="append",
        default=[],
        metavar=("NAME", "VALUE"),
        help="a parameter of ekf_node, its value as YAML writes it; may be repeated",
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes")
    args = parser.parse_args(argv)

    def run() -> int:
        values, bags = values_from(args.set), bags_in(args.folder)
        with Progress("flying", "bags") as bar:
            return print_report(*report(judge_all(bags, values, args.workers, bar)))

    return exit_code("real_flights", run)


if __name__ == "__main__":
    sys.exit(main())

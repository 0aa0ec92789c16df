"""Judge the filter on recorded flights, which have no truth.

The references are fixes before they are used, fixes that are held back for some seconds, positions
moved on purpose, and the autopilot's own tilt; all later than 8 s after the first sample.
"""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeGuard

import numpy as np

from dev.flight_errors import published
from dev.judging import in_processes
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import euler_from_quat, matrix_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.estimator.estimator import Navigation
from tirgeo_ros.core.navigation.smoothing.smoothed_navigation import smoothed
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import FilterState, Verdict
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import NAVIGATION_INPUTS
from tirgeo_ros.tools.presentation.progress import Report, silent

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


class _Run:
    """Run the filter over samples and collect the results."""

    def __init__(self, config: EkfConfig, samples: Sequence[NavigationInput]) -> None:
        self._lever_b = config.aircraft.rtk_lever_b
        self._navigation = Navigation(config, self._heard)
        self._settled_ns = samples[0].stamp_ns + round(SETTLED_S * 1e9)
        self._now_ns = samples[0].stamp_ns
        self._fresh_ns = self._lost_ns = self._used = 0
        self._squares: Counter[Source] = Counter()
        self._degrees: Counter[Source] = Counter()
        self._misses: list[Miss] = []
        self._tilt: list[Array] = []
        self._poses: list[NavSolution] = []
        self._fixes: list[int] = []
        for sample in samples:
            self._take(sample)

    def _heard(self, verdict: Verdict) -> None:
        if self._now_ns <= self._settled_ns or verdict.source not in _RTK:
            return
        self._used += verdict.used and verdict.source is Source.RTK_POSITION
        if math.isfinite(verdict.nis):
            degrees = len(verdict.innovation)
            self._squares[verdict.source] += verdict.nis * degrees  # type: ignore[assignment]
            self._degrees[verdict.source] += degrees

    def _take(self, sample: NavigationInput) -> None:
        settled = sample.stamp_ns > self._settled_ns
        if _is_fix(sample) and self._now_ns > self._settled_ns:  # as its verdict is counted
            self._fixes.append(sample.stamp_ns)
            pose = self._poses[-1] if self._poses else None
            if pose is not None and sample.stamp_ns - pose.stamp_ns <= _FRESH_NS:
                self._misses.append(_missed(sample, pose, self._lever_b))
        solution = self._navigation.process(sample).solution
        if solution is not None:
            self._poses.append(solution)
        if isinstance(sample, ImuSample):
            self._took(sample, solution, settled=settled)

    def _took(self, sample: ImuSample, solution: NavSolution | None, *, settled: bool) -> None:
        step_ns, self._now_ns = sample.stamp_ns - self._now_ns, sample.stamp_ns
        if not settled:
            return
        if self._poses and sample.stamp_ns - self._poses[-1].stamp_ns <= _FRESH_NS:
            self._fresh_ns += step_ns
        if self._navigation.status().state is FilterState.LOST:
            self._lost_ns += step_ns
        if solution is not None and sample.autopilot_q_nb is not None:
            rpy, autopilot = map(euler_from_quat, (solution.q_nb, sample.autopilot_q_nb))
            self._tilt.append(rpy[:2] - autopilot[:2])

    def flown(self) -> Flown:
        """Return the results."""
        return Flown(
            sum(stamp_ns <= self._now_ns for stamp_ns in self._fixes),
            self._used,
            self._lost_ns * 1e-9,
            sum(self._navigation.status().resets.values()),
            self._fresh_ns / (self._now_ns - self._settled_ns),
            tuple(self._misses),
            np.array(self._tilt).reshape(-1, 2),
            {source: (self._squares[source], n) for source, n in self._degrees.items()},
            tuple(self._poses),
        )


def _is_fix(sample: NavigationInput) -> TypeGuard[PositionSample]:
    """Return whether a sample is an RTK position, float or fixed."""
    return (
        isinstance(sample, PositionSample)
        and sample.source is Source.RTK_POSITION
        and sample.status >= FixStatus.FLOAT
    )


def _is_rtk(sample: NavigationInput) -> bool:
    return isinstance(sample, HeadingSample) or (
        isinstance(sample, PositionSample | VelocitySample) and sample.source in _RTK
    )


def fly(config: EkfConfig, samples: Sequence[NavigationInput]) -> Flown:
    """Run the filter over samples."""
    return _Run(config, samples).flown()


def _missed(fix: PositionSample, pose: NavSolution, lever_b: Array) -> Miss:
    plane = TangentPlane(fix.latitude_rad, fix.longitude_rad, fix.height_m)
    found_n = plane.ned_from_geodetic(pose.latitude_rad, pose.longitude_rad, pose.height_m)
    found_n = found_n + (fix.stamp_ns - pose.stamp_ns) * 1e-9 * pose.velocity_n
    found_n = found_n + matrix_from_quat(pose.q_nb) @ lever_b
    sigma_m = math.sqrt(pose.covariance[0, 0] + pose.covariance[1, 1])
    return Miss(math.hypot(found_n[0], found_n[1]), sigma_m)


def cuts_of(config: EkfConfig, samples: Sequence[NavigationInput]) -> list[Miss]:
    """Return, for every cut, the pose's error at the last fix that was held back.

    All RTK data are held back; ordinary GPS, where there is some, goes on.
    """
    return [misses[-1] for misses in hidden_fixes(config, samples)]


def hidden_fixes(
    config: EkfConfig, samples: Sequence[NavigationInput], *, smooth: bool = False
) -> list[list[Miss]]:
    """Return, for every cut, the pose's errors at all fixes that were held back."""
    return [
        misses
        for phase_s in PHASES_S
        for misses in _cuts_at(config, samples, phase_s, smooth=smooth)
    ]


def _cuts_at(
    config: EkfConfig, samples: Sequence[NavigationInput], phase_s: float, *, smooth: bool
) -> Iterator[list[Miss]]:
    cut = _cut_of(samples, phase_s)
    kept = [sample for sample, number in zip(samples, cut, strict=True) if number is None]
    navigation, pose = smoothed(config, kept) if smooth else Navigation(config), None
    hidden: defaultdict[int, list[tuple[PositionSample, NavSolution | None]]] = defaultdict(list)
    for sample, number in zip(samples, cut, strict=True):
        if number is None:
            pose = navigation.process(sample).solution or pose
        elif _is_fix(sample):
            hidden[number].append((sample, pose))
    for fixes in hidden.values():
        yield [_missed_by(fix, last, config) for fix, last in fixes]


def _cut_of(samples: Sequence[NavigationInput], phase_s: float) -> list[int | None]:
    """Return the number of the cut that hides each sample, None for one that is kept."""
    start_ns = samples[0].stamp_ns
    length_s = (samples[-1].stamp_ns - start_ns) * 1e-9
    begins_s = np.arange(FIRST_CUT_S + phase_s, length_s - CUT_S, CUT_EVERY_S)

    def number(sample: NavigationInput) -> int | None:
        since_s = (sample.stamp_ns - start_ns) * 1e-9 - begins_s
        inside = np.flatnonzero((since_s >= 0) & (since_s < CUT_S)).tolist()
        return inside[0] if inside else None

    return [number(sample) if _is_rtk(sample) else None for sample in samples]


def _missed_by(fix: PositionSample, pose: NavSolution | None, config: EkfConfig) -> Miss:
    """Return how far a fix is from the pose before it; the sigma is that of the difference."""
    if pose is None or fix.stamp_ns - pose.stamp_ns > _FRESH_NS:
        return _NO_POSE
    error_m, sigma_m = _missed(fix, pose, config.aircraft.rtk_lever_b)
    least_m2 = config.rtk.position_sigma_floor_m**2
    own_m2 = np.maximum(fix.covariance_n.diagonal()[:2], least_m2).sum()
    return Miss(error_m, math.sqrt(sigma_m * sigma_m + own_m2))


_NO_POSE = Miss(math.nan, math.nan)


def moved_east(
    samples: Sequence[NavigationInput], begin_s: float, seconds: float, metres: float
) -> list[NavigationInput]:
    """Return the samples with the RTK positions of some seconds moved east by ``metres``."""
    begin_ns = samples[0].stamp_ns + round(begin_s * 1e9)
    end_ns = begin_ns + round(seconds * 1e9)
    return [
        _moved(sample, metres)
        if _is_fix(sample) and begin_ns <= sample.stamp_ns < end_ns
        else sample
        for sample in samples
    ]


def _moved(sample: PositionSample, metres: float) -> PositionSample:
    plane = TangentPlane(sample.latitude_rad, sample.longitude_rad, sample.height_m)
    latitude, longitude, height = plane.geodetic_from_ned(np.array([0.0, metres, 0.0]))
    return replace(
        sample,
        latitude_rad=float(latitude),
        longitude_rad=float(longitude),
        height_m=float(height),
    )


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

    @property
    def used(self) -> float:
        """Return the share of the fixes that was used."""
        return self.flown.used / self.flown.fixes if self.flown.fixes else math.nan

    @property
    def tilt_deg(self) -> Array:
        """Return the rms of roll and pitch less the autopilot's, (2,); nan without one."""
        tilt = self.flown.tilt
        return np.degrees(rms(tilt)) if len(tilt) else np.full(2, math.nan)

    def nis(self, source: Source) -> float:
        """Return the NIS over its degrees of freedom; nan if there is none."""
        square, degrees = self.flown.nis.get(source, (math.nan, 1))
        return square / degrees


def config_of(samples: Sequence[NavigationInput], values: Mapping[str, object]) -> EkfConfig:
    """Return the defaults with ``values`` and, unless they set it, the method for the aids."""
    headings = any(isinstance(sample, HeadingSample) for sample in samples)
    method = "ekf_heading" if headings else "ekf"
    return config_from(EkfConfig, {"method": method} | dict(values))


def judge(path: Path, values: Mapping[str, object]) -> Judged:
    """Fly a bag in every way. Raises TirgeoError if it cannot be read or is too short."""
    samples = samples_of(path)
    length_s = (samples[-1].stamp_ns - samples[0].stamp_ns) * 1e-9 if samples else 0.0
    if length_s <= SETTLED_S + MOVED_FOR_S:
        raise TirgeoError(f"{path}: {length_s:.1f} s of samples for the filter are too few")
    config = config_of(samples, values)
    flown = fly(config, samples)
    moved_m = [
        largest_change_m(
            flown.poses,
            published(Navigation(config), moved_east(samples, t_s, MOVED_FOR_S, MOVED_M)),
        )
        for t_s in (MOVED_AT_S, *(max(share * length_s, SETTLED_S) for share in MOVED_AT_SHARES))
    ]
    cuts = tuple(cuts_of(config, samples))
    return Judged(path.stem, _aids(samples), replace(flown, poses=()), cuts, tuple(moved_m))


def _aids(samples: Sequence[NavigationInput]) -> str:
    kinds = {
        "velocities": any(
            isinstance(s, VelocitySample) and s.source is Source.RTK_VELOCITY for s in samples
        ),
        "headings": any(isinstance(s, HeadingSample) for s in samples),
    }
    return ", ".join(["positions", *(name for name, there in kinds.items() if there)])


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


def mean_tilt_deg(bags: Sequence[Judged]) -> Array:
    """Return the mean over bags of the rms of roll and pitch, (2,), deg."""
    return np.asarray(np.mean([each.tilt_deg for each in bags], axis=0))


def mean_nis(bags: Sequence[Judged], source: Source) -> float:
    """Return the mean over bags of the NIS over its degrees of freedom."""
    return float(np.mean([each.nis(source) for each in bags]))

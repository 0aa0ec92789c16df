"""What the filter makes of a recorded flight, flown in every way that ``real_flights`` has.

As it is, with RTK hidden for some seconds again and again, and with positions that are wrong for a
second; then the same of several bags together.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from dev.flight_errors import published
from dev.judging import in_processes
from dev.real_flights import (
    SETTLED_S,
    Flown,
    Miss,
    cuts_of,
    fly,
    largest_change_m,
    moved_east,
    samples_of,
)
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.measurements import (
    HeadingSample,
    NavigationInput,
    Source,
    VelocitySample,
)
from tirgeo_ros.tools.presentation.progress import Report, silent

#: Positions are wrong by so much for so long, from there on: a time, and shares of the flight.
MOVED_M, MOVED_FOR_S = 0.5, 1.0
MOVED_AT_S, MOVED_AT_SHARES = 16.0, (0.4, 0.75)


@dataclass(frozen=True)
class Judged:
    """What came of one bag."""

    name: str
    aids: str
    flown: Flown  # without its poses
    cuts: tuple[Miss, ...]
    moved_m: tuple[float, ...]  # by a wrong position, of each

    @property
    def group(self) -> str:
        """Carrier and aids."""
        return f"{self.name.partition('_')[0]}, {self.aids}"

    @property
    def used(self) -> float:
        """Share of the fixes."""
        return self.flown.used / self.flown.fixes if self.flown.fixes else math.nan

    @property
    def tilt_deg(self) -> Array:
        """(2,) rms of roll and pitch less the autopilot's; nan without one."""
        tilt = self.flown.tilt
        return np.degrees(rms(tilt)) if len(tilt) else np.full(2, math.nan)

    def nis(self, source: Source) -> float:
        """Over its degrees of freedom; nan where there is none."""
        square, degrees = self.flown.nis.get(source, (math.nan, 1))
        return square / degrees


def config_of(samples: Sequence[NavigationInput], values: Mapping[str, object]) -> EkfConfig:
    """The defaults with ``values``, and the method that fits the aids, unless they say one."""
    headings = any(isinstance(sample, HeadingSample) for sample in samples)
    method = "ekf_heading" if headings else "ekf"
    return config_from(EkfConfig, {"method": method} | dict(values))


def judge(path: Path, values: Mapping[str, object]) -> Judged:
    """Fly a bag in every way. Raises TirgeoError where it cannot be read or is too short."""
    samples = samples_of(path)
    length_s = (samples[-1].stamp_ns - samples[0].stamp_ns) * 1e-9 if samples else 0.0
    if length_s <= SETTLED_S + MOVED_FOR_S:
        raise TirgeoError(f"{path}: {length_s:.1f} s of samples for the filter are too few")
    config = config_of(samples, values)
    flown = fly(config, samples)
    moved_m = [
        largest_change_m(
            flown.poses, published(config, moved_east(samples, t_s, MOVED_FOR_S, MOVED_M))
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
    """Judge bags, in ``workers`` processes; in the order of the bags."""
    return in_processes(partial(judge, values=values), bags, workers, progress)


def groups(found: Sequence[Judged]) -> dict[str, list[Judged]]:
    """Bags by carrier and aids, in the order in which they come."""
    named: dict[str, list[Judged]] = {}
    for each in found:
        named.setdefault(each.group, []).append(each)
    return named


def median(values: Sequence[float]) -> float:
    """The median, in which what there is not (nan) is infinite; nan of nothing."""
    return float(np.median(np.nan_to_num(values, nan=math.inf))) if len(values) else math.nan


def used_of(bags: Sequence[Judged]) -> float:
    """Share of the fixes of some bags that were used; nan without a fix."""
    fixes = sum(each.flown.fixes for each in bags)
    return sum(each.flown.used for each in bags) / fixes if fixes else math.nan


def beyond(bags: Sequence[Judged]) -> float:
    """Share of the poses of some bags that are off their fix by more than 5 of their sigmas."""
    misses = [miss for each in bags for miss in each.flown.misses]
    return float(np.mean([not miss.within(5) for miss in misses])) if misses else math.nan


def mean_tilt_deg(bags: Sequence[Judged]) -> Array:
    """(2,) mean over bags of the rms of roll and pitch."""
    return np.asarray(np.mean([each.tilt_deg for each in bags], axis=0))


def mean_nis(bags: Sequence[Judged], source: Source) -> float:
    """Mean over bags of NIS over its degrees of freedom."""
    return float(np.mean([each.nis(source) for each in bags]))

"""Judge recorded flights in every way that ``real_flights`` has.

Each is flown as it is, with RTK hidden for some seconds again and again, and with positions that
are wrong for a second. Figures are also pooled over several bags.
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
    """Judge bags in ``workers`` processes; return the results in the order of the bags."""
    return in_processes(partial(judge, values=values), bags, workers, progress)


def groups(found: Sequence[Judged]) -> dict[str, list[Judged]]:
    """Return bags by carrier and aids, in their order."""
    named: dict[str, list[Judged]] = {}
    for each in found:
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

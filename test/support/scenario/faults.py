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
"""Samples that do not come, or late, or twice, or with other stamps, in the interval of a fault.

Each call gives a ``Fault``, which takes the deliveries of a flight and the interval, leaves what
is outside as it is, and draws its random numbers from a seed of its own.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from scenario.runs import RTK, Deliveries, Delivery, Fault, Interval, each, in_order

from tirgeo_ros.core.frames.wgs84 import radii_of_curvature
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.tools.simulate.processes import gauss_markov

_SEED = 41


def nothing(samples: Deliveries, interval: Interval) -> Deliveries:
    """No fault at all."""
    return samples


def both(*faults: Fault) -> Fault:
    """One fault after the other, in the same interval."""

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        for item in faults:
            result = item(result, interval)
        return result

    return fault


def between(start_s: float, end_s: float, item: Fault) -> Fault:
    """A fault for a part of the interval, in seconds from its start."""

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        first_ns = interval.start_ns
        part = Interval(first_ns + round(start_s * 1e9), first_ns + round(end_s * 1e9))
        return item(result, part)

    return fault


def drop(*sources: Source) -> Fault:
    """Nothing comes."""
    return each(sources, lambda _: [])


def lossy(share: float, *sources: Source) -> Fault:
    """A share of the samples is missing, at random."""

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        rng = np.random.default_rng(_SEED)
        some = each(sources, lambda delivery: [delivery] if rng.random() > share else [])
        return some(result, interval)

    return fault


def late(extra_s: float, *sources: Source) -> Fault:
    """Samples come later, with the right stamps."""
    return _delayed(sources, lambda: extra_s)


def shuffled(largest_s: float, *sources: Source) -> Fault:
    """Samples come later by random times, so that they overtake each other."""

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        rng = np.random.default_rng(_SEED)
        return _delayed(sources, lambda: rng.uniform(0, largest_s))(result, interval)

    return fault


def duplicated(*sources: Source) -> Fault:
    """Each sample comes twice."""
    return each(sources, lambda delivery: [delivery, delivery])


def swapped(source: Source) -> Fault:
    """Each second sample comes just after the one that follows it."""

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        mine = [d for d in result if d.source is source and interval.holds(d)]
        turned = {
            id(first): replace(first, arrival_ns=second.arrival_ns + 1)
            for first, second in zip(mine[::2], mine[1::2], strict=False)
        }
        return in_order(turned.get(id(d), d) for d in result)

    return fault


def polled(rate_hz: float, *sources: Source) -> Fault:
    """A receiver that is asked more often than it measures: old values with new stamps."""
    step_ns = round(1e9 / rate_hz)

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        again: Deliveries = []
        for source in sources:
            mine = [d for d in result if d.source is source and interval.holds(d)]
            for first, second in pairwise(mine):
                ages_ns = range(step_ns, second.true_ns - first.true_ns, step_ns)
                for age_ns in ages_ns:
                    later = first.with_sample(stamp_ns=first.sample.stamp_ns + age_ns)
                    again.append(replace(later, arrival_ns=first.arrival_ns + age_ns))
        return in_order([*result, *again])

    return fault


def clock(shift_s: float, *sources: Source) -> Fault:
    """Stamps of another clock: later by ``shift_s``, or earlier where that is negative."""
    shift_ns = round(shift_s * 1e9)
    moved_on = misstamped(shift_s, *sources)

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        return [
            replace(d, clock_ns=shift_ns) if d.source in sources and interval.holds(d) else d
            for d in moved_on(result, interval)
        ]

    return fault


def misstamped(shift_s: float, *sources: Source) -> Fault:
    """The clock stays what it was, but stamps are wrong by ``shift_s``."""
    shift_ns = round(shift_s * 1e9)
    return each(sources, lambda d: [d.with_sample(stamp_ns=d.sample.stamp_ns + shift_ns)])


def _delayed(sources: tuple[Source, ...], extra_s: Callable[[], float]) -> Fault:
    return each(sources, lambda d: [replace(d, arrival_ns=d.arrival_ns + round(extra_s() * 1e9))])


_G = 9.80665


def frozen(*sources: Source) -> Fault:
    """The last value before the fault again and again, with new stamps."""

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        last: dict[Source, Delivery] = {}
        out = []
        for delivery in result:
            if delivery.source not in sources or not interval.holds(delivery):
                last[delivery.source] = delivery
                out.append(delivery)
            else:
                stuck = last[delivery.source].sample
                out.append(
                    replace(delivery, sample=replace(stuck, stamp_ns=delivery.sample.stamp_ns))
                )
        return out

    return fault


def values(*sources: Source, **changes: Callable[[Any], Any]) -> Fault:
    """Fields of samples are functions of themselves."""

    def change(sample: Any) -> Any:
        new = {name: function(getattr(sample, name)) for name, function in changes.items()}
        return replace(sample, **new)

    return _changed(sources, change)


def moved(north_m: float, east_m: float, down_m: float, source: Source) -> Fault:
    """Positions elsewhere, with the covariance of good ones."""
    return _changed((source,), lambda s: shifted(s, np.array([north_m, east_m, down_m])))


def faster(north_m_s: float, east_m_s: float, down_m_s: float, source: Source) -> Fault:
    """Velocities off by a vector."""
    return values(source, velocity_n=lambda v: v + np.array([north_m_s, east_m_s, down_m_s]))


def turned(angle_deg: float) -> Fault:
    """Headings off by an angle; 180: the antennas are taken for each other."""
    angle = math.radians(angle_deg)
    return values(Source.RTK_HEADING, heading_rad=lambda rad: (rad + angle) % (2 * math.pi))


def saturated() -> Fault:
    """Every axis of the IMU at the end of its scale, 16 g and 2000 deg/s."""
    return values(
        Source.IMU,
        specific_force_b=lambda f: np.full_like(f, 16 * _G),
        angular_rate_b=lambda w: np.full_like(w, math.radians(2000)),
    )


def not_a_number(*sources: Source) -> Fault:
    """NaN for values."""
    return _changed(sources, _nan_values)


def covariance_not_a_number(*sources: Source) -> Fault:
    """NaN for variances."""
    return _changed(sources, _nan_variance)


def fix(status: FixStatus) -> Fault:
    """The RTK receiver gives its fixes another status, and nothing else."""
    return values(Source.RTK_POSITION, status=lambda _: status)


def wandering(status: FixStatus, sigma_m: float, time_s: float, claimed_m: float) -> Fault:
    """Fixes of a lesser status, whose errors wander; the message claims ``claimed_m`` (1 sigma).

    The error is a Gauss-Markov process of ``sigma_m`` per axis and ``time_s``, which begins at
    zero, as the ambiguities do when they are let go.
    """

    def fault(result: Deliveries, interval: Interval) -> Deliveries:
        mine = [d for d in result if d.source is Source.RTK_POSITION and interval.holds(d)]
        rng, step_s = np.random.default_rng(_SEED), 0.2
        walk = gauss_markov(rng, len(mine), step_s, np.full(3, time_s), np.full(3, sigma_m))
        walk -= walk[0] * np.exp(-step_s * np.arange(len(mine)) / time_s)[:, None]
        worse = {
            id(delivery): replace(
                delivery,
                sample=replace(
                    shifted(delivery.sample, off_n),
                    status=status,
                    covariance_n=np.eye(3) * claimed_m**2,
                ),
            )
            for delivery, off_n in zip(mine, walk, strict=True)
        }
        return [worse.get(id(d), d) for d in result]

    return fault


def rtk_without_fix() -> Fault:
    """The receiver goes on talking, at 5 Hz, of a status that says it knows nothing."""
    return both(fix(FixStatus.NONE), drop(*RTK[1:]))


def shifted(sample: PositionSample, off_n: np.ndarray) -> PositionSample:
    """A position (3,) metres north, east, down from where it is."""
    meridian, transverse = radii_of_curvature(sample.latitude_rad)
    across_m = (transverse + sample.height_m) * math.cos(sample.latitude_rad)
    return replace(
        sample,
        latitude_rad=sample.latitude_rad + float(off_n[0]) / (meridian + sample.height_m),
        longitude_rad=sample.longitude_rad + float(off_n[1]) / across_m,
        height_m=sample.height_m - float(off_n[2]),
    )


def _changed(sources: tuple[Source, ...], change: Callable) -> Fault:
    return each(sources, lambda delivery: [replace(delivery, sample=change(delivery.sample))])


def _nan_values(sample):
    nan3 = np.full(3, math.nan)
    if isinstance(sample, ImuSample):
        return replace(sample, specific_force_b=nan3, angular_rate_b=nan3)
    if isinstance(sample, PositionSample):
        return replace(sample, latitude_rad=math.nan, longitude_rad=math.nan, height_m=math.nan)
    if isinstance(sample, VelocitySample):
        return replace(sample, velocity_n=nan3)
    return replace(sample, heading_rad=math.nan)


def _nan_variance(sample):
    if isinstance(sample, HeadingSample):
        return replace(sample, variance_rad2=math.nan)
    return replace(sample, covariance_n=np.full((3, 3), math.nan))

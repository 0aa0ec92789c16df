"""Samples whose values are wrong, in the interval of a fault; see ``time_faults``."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scenario.deliveries import RTK, Deliveries, Delivery, Fault, Interval, each
from scenario.time_faults import both, drop

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
_G = 9.80665


def frozen(*sources: Source) -> Fault:
    """The last value before the fault again and again, with new stamps."""

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        last: dict[Source, Delivery] = {}
        out = []
        for delivery in found:
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

    def fault(found: Deliveries, interval: Interval) -> Deliveries:
        mine = [d for d in found if d.source is Source.RTK_POSITION and interval.holds(d)]
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
        return [worse.get(id(d), d) for d in found]

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

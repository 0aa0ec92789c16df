"""Flights for tests of the filter, and its error against their truth."""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from tirgeo_ros.core.attitude import (
    euler_from_quat,
    quat_conjugate,
    quat_multiply,
    rotvec_from_quat,
    wrap_pi,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.geodesy import radii_of_curvature
from tirgeo_ros.core.navigation import Navigation
from tirgeo_ros.core.parameter import config_from
from tirgeo_ros.core.samples import (
    HeadingSample,
    ImuSample,
    NavSolution,
    PositionSample,
    VelocitySample,
)
from tirgeo_ros.tools.simulate.flight import Flight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario

NAVIGATION_SAMPLES = (ImuSample, PositionSample, VelocitySample, HeadingSample)


@functools.lru_cache(maxsize=8)
def flight(seed: int | None = None, duration_s: float = 107.0, shape: str = "lawnmower") -> Flight:
    """A flight of the paper's scenario, cut short."""
    base = Scenario()
    return fly(replace(base, duration_s=duration_s, route=replace(base.route, shape=shape)), seed)


def config_for(flown: Flight, **values: object) -> EkfConfig:
    """The filter's parameters that fit a flight."""
    fitting = {
        "rtk.lever_arm_m": flown.scenario.rtk.lever_arm_m,
        "gps.lever_arm_m": flown.scenario.gps.lever_arm_m,
    }
    return config_from(
        EkfConfig, {**fitting, **{k.replace("__", "."): v for k, v in values.items()}}
    )


def navigation_samples(flown: Flight) -> list:
    """Every sample for the filter, in order of arrival."""
    return [sample for _, sample in flown.samples if isinstance(sample, NAVIGATION_SAMPLES)]


def solutions(flown: Flight, config: EkfConfig, samples: list | None = None) -> list[NavSolution]:
    """What the filter publishes over a flight."""
    navigation = Navigation(config)
    steps = [navigation.process(s) for s in (samples or navigation_samples(flown))]
    return [step.solution for step in steps if step.solution is not None]


@dataclass(frozen=True)
class Errors:
    """Errors of solutions: truth minus estimate."""

    t_s: np.ndarray
    state: np.ndarray  # (N, 9) position NED m, attitude phi_n rad, velocity NED m/s
    sigma: np.ndarray  # (N, 9) the filter's own
    rpy: np.ndarray  # (N, 3) roll, pitch, heading, rad

    def after(self, t_s: float) -> Errors:
        keep = self.t_s > t_s
        return Errors(self.t_s[keep], self.state[keep], self.sigma[keep], self.rpy[keep])


def errors(flown: Flight, found: list[NavSolution]) -> Errors:
    truth = flown.truth
    index = {stamp: i for i, stamp in enumerate(truth.stamp_ns)}
    rows = [_error(truth, index[s.stamp_ns], s) for s in found]
    return Errors(
        np.array([truth.t_s[index[s.stamp_ns]] for s in found]),
        np.array([row[:9] for row in rows]),
        np.array([np.sqrt(np.diag(s.covariance)) for s in found]),
        np.array([row[9:] for row in rows]),
    )


def _error(truth, i: int, s: NavSolution) -> np.ndarray:
    meridian, transverse = radii_of_curvature(s.latitude_rad)
    return np.concatenate(
        [
            [
                (truth.latitude_rad[i] - s.latitude_rad) * (meridian + s.height_m),
                (truth.longitude_rad[i] - s.longitude_rad)
                * (transverse + s.height_m)
                * np.cos(s.latitude_rad),
                s.height_m - truth.height_m[i],
            ],
            rotvec_from_quat(quat_multiply(truth.q_nb[i], quat_conjugate(s.q_nb))),
            truth.velocity_n[i] - s.velocity_n,
            wrap_pi(euler_from_quat(truth.q_nb[i]) - euler_from_quat(s.q_nb)),
        ]
    )


def rms(values: np.ndarray) -> np.ndarray:
    return np.sqrt(np.mean(np.square(values), axis=0))

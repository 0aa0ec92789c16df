"""Simulate the errors of an IMU: biases and white noise of Table 5 of Ren et al. 2022."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.simulate.processes import gauss_markov, generator
from tirgeo_ros.tools.simulate.scenario_aircraft import ImuScenario


@dataclass(frozen=True)
class ImuBias:
    """Hold the true biases (N, 3) of the IMU at its samples, FRD."""

    gyro_b: Array  # rad/s
    accel_b: Array  # m/s2


def imu_bias(scenario: ImuScenario, seed: int, count: int) -> ImuBias:
    """Return a constant turn-on bias plus a Gauss-Markov part of Table 5's size and time."""
    noise, step_s = scenario.noise, 1 / scenario.rate_hz
    rng = generator(seed, "imu bias")
    turn_on = rng.standard_normal((2, 3))
    gyro = gauss_markov(rng, count, step_s, noise.gyro_bias_time_s, noise.gyro_bias_instability)
    accel = gauss_markov(rng, count, step_s, noise.accel_bias_time_s, noise.accel_bias_instability)
    gyro += scenario.gyro_turn_on_bias_rad_s * turn_on[0]
    accel += scenario.accel_turn_on_bias_m_s2 * turn_on[1]
    return ImuBias(scenario.noise_scale * gyro, scenario.noise_scale * accel)


def imu_white(scenario: ImuScenario, seed: int, count: int) -> tuple[Array, Array]:
    """Return white noise (count, 3) of rate (rad/s) and specific force (m/s2), FRD.

    Its random walks are those of Table 5.
    """
    # A random walk of N per root second is white noise of N / sqrt(dt) per sample.
    scale = scenario.noise_scale * math.sqrt(scenario.rate_hz)
    draws = scale * generator(seed, "imu white").standard_normal((2, count, 3))
    walks = scenario.noise.angle_random_walk, scenario.noise.velocity_random_walk
    return draws[0] * np.array(walks[0]), draws[1] * np.array(walks[1])

"""The noise of an IMU from its own readings: white noise, motion, gaps."""

from __future__ import annotations

import numpy as np
import pytest

from tirgeo_ros.core.config import EkfConfig, ImuConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.navigation.ins_error_model import NoisePowers
from tirgeo_ros.core.navigation.vibration_noise import STILL, VibrationMeter, densities

RATE_HZ = 100.0
GYRO, ACCEL = np.array([1e-3, 3e-3, 5e-4]), np.array([0.1, 0.05, 0.4])


def white(seconds, seed=0, rate_hz=RATE_HZ):
    """Readings (n, 3) of both sensors with the densities GYRO and ACCEL."""
    rng = np.random.default_rng(seed)
    n = round(seconds * rate_hz)
    return tuple(rng.normal(size=(n, 3)) * density * np.sqrt(rate_hz) for density in (GYRO, ACCEL))


def measured(rates, forces, step_s=1 / RATE_HZ, meter=None):
    meter = meter or VibrationMeter()
    for rate, force in zip(rates.tolist(), forces.tolist(), strict=True):
        powers = meter.add(step_s, tuple(force), tuple(rate))
    return np.array(densities(powers))


# The squares of second differences of white noise are correlated: the mean of n has the relative
# spread sqrt(2 (1 + 2 (4/6)^2 + 2 (1/6)^2) / n), and a density has half of it. Of 3 s at 100 Hz
# with a decay that halves what counts: 0.08; five of these.
MEMORY_SPREAD = 5 * 0.5 * np.sqrt(2 * (1 + 2 * (4 / 6) ** 2 + 2 / 36) / 600)


@pytest.mark.parametrize("rate_hz", [50.0, 100.0, 400.0])
def test_white_noise_is_measured_whatever_the_rate(rate_hz):
    found = measured(*white(12.0, 1, rate_hz), 1 / rate_hz)
    assert found == pytest.approx(
        [*GYRO, *ACCEL], rel=MEMORY_SPREAD * np.sqrt(max(100 / rate_hz, 1))
    )


def test_motion_is_no_noise():
    """A roll of 30 deg in half a second and a push of 5 m/s2 beside the shipped densities."""
    t_s = np.arange(0, 6, 1 / RATE_HZ)
    turn = np.outer(np.sin(2 * np.pi * t_s), [1.0, 0.5, 0.6])
    push = np.outer(np.cos(2 * np.pi * t_s), [5.0, 3.0, 2.0])
    imu = ImuConfig()
    found = measured(turn, push)
    assert np.all(found[:3] * imu.gyro_vibration_share < imu.angle_random_walk)
    assert np.all(found[3:] * imu.accel_vibration_share < imu.velocity_random_walk)


def test_calm_is_believed_again_after_some_seconds():
    meter = VibrationMeter()
    shaken = measured(*white(6.0, 3), meter=meter)
    calm = measured(np.zeros((900, 3)), np.zeros((900, 3)), meter=meter)
    # Nine seconds are three memories: exp(-3) of the power.
    assert calm == pytest.approx(shaken * np.exp(-1.5), rel=0.15)


def test_a_step_across_lost_samples_is_left_out():
    meter = VibrationMeter()
    for k in range(50):
        before = meter.add(0.01, (0.0, 0.0, 0.1 * (k % 2)), (0.0, 0.0, 0.0))
    after = meter.add(0.1, (50.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    assert after == before
    meter.add(0.01, (50.0, 0.0, 0.0), (2.0, 0.0, 0.0))
    assert meter.add(0.01, (50.0, 0.0, 0.0), (2.0, 0.0, 0.0)) == before


def test_never_below_the_configured_noise():
    config = config_from(EkfConfig, {"imu.velocity_random_walk": (0.01, 0.02, 0.03)})
    powers = NoisePowers(config.imu)
    still = np.square([*config.imu.angle_random_walk, 0.01, 0.02, 0.03])
    assert powers.under(STILL) == pytest.approx(still)
    shaken = np.array(powers.under((1.0,) * 6))
    shares = config.imu.gyro_vibration_share, config.imu.accel_vibration_share
    assert shaken == pytest.approx(np.repeat(shares, 3) ** 2)

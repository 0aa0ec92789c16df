"""Measure how noisy the IMU is in flight, from its own readings.

Noise measured at rest is far too small on an airframe whose rotors shake. Second differences
``d = x_k - 2 x_(k-1) + x_(k-2)`` of white noise with the power density ``s`` (per Hz, two-sided)
have the variance ``6 s / dt``, and contain hardly any of the aircraft's motion. So the mean of
``d^2 dt / 6`` is the density of a white noise as strong as the vibration.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.measurements import ImuSample

#: Power densities: gyroscopes x, y, z in rad2/s, accelerometers x, y, z in m2/s3.
Powers = tuple[float, float, float, float, float, float]
STILL: Powers = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

#: Length of the running mean.
_MEMORY_S = 3.0
#: A longer step has lost samples: a difference across it would contain motion.
_LONGEST_STEP_S = 0.035
#: While clipped PX4's EKF2 uses 4.9 m/s2 a step of 10 ms: 0.49 m/s/sqrt(s); this in m2/s3.
_CLIPPED = 0.49**2


class VibrationMeter:
    """Measure the power densities of an IMU, sample by sample."""

    def __init__(self, initial: Powers = STILL, initial_s: float = 0.0) -> None:
        """Begin with ``initial`` densities, the mean over ``initial_s`` seconds."""
        self._means: Powers = initial
        self._seconds = min(initial_s, _MEMORY_S)
        self._run = 0  # samples since the last gap, up to 2
        self._force: Vector = (0.0, 0.0, 0.0)
        self._rate: Vector = (0.0, 0.0, 0.0)
        self._force_step: Vector = (0.0, 0.0, 0.0)
        self._rate_step: Vector = (0.0, 0.0, 0.0)

    def add(self, step_s: float, force_b: Vector, rate_b: Vector) -> Powers:
        """Take a reading ``step_s`` after the one before (m/s2, rad/s); return the means."""
        fx, fy, fz = force_b
        wx, wy, wz = rate_b
        px, py, pz = self._force
        qx, qy, qz = self._rate
        f0, f1, f2 = force_step = fx - px, fy - py, fz - pz
        w0, w1, w2 = rate_step = wx - qx, wy - qy, wz - qz
        if step_s > _LONGEST_STEP_S:
            self._run = 0
        elif self._run == 2:
            a0, a1, a2 = self._force_step
            b0, b1, b2 = self._rate_step
            seconds = self._seconds
            if seconds < _MEMORY_S:
                self._seconds = seconds = min(seconds + step_s, _MEMORY_S)
            share = step_s / seconds
            scale, keep = share * step_s / 6, 1 - share
            m0, m1, m2, m3, m4, m5 = self._means
            w0 -= b0
            w1 -= b1
            w2 -= b2
            f0 -= a0
            f1 -= a1
            f2 -= a2
            self._means = (
                keep * m0 + scale * w0 * w0,
                keep * m1 + scale * w1 * w1,
                keep * m2 + scale * w2 * w2,
                keep * m3 + scale * f0 * f0,
                keep * m4 + scale * f1 * f1,
                keep * m5 + scale * f2 * f2,
            )
        else:
            self._run += 1
        self._force, self._rate = force_b, rate_b
        self._force_step, self._rate_step = force_step, rate_step
        return self._means


def mean_powers(imu: Sequence[ImuSample]) -> Powers:
    """Return the mean densities over consecutive samples; zeros for fewer than three."""
    if len(imu) < 3:
        return STILL
    readings = np.array([[*s.angular_rate_b, *s.specific_force_b] for s in imu])
    steps_s = np.diff([s.stamp_ns for s in imu]) * 1e-9
    differences = np.diff(readings, 2, axis=0)
    near = np.maximum(steps_s[1:], steps_s[:-1]) <= _LONGEST_STEP_S
    if not near.any():
        return STILL
    powers: Array = (differences[near] ** 2 * steps_s[1:][near, None] / 6).mean(axis=0)
    return tuple(powers.tolist())


def clipped_powers(powers: Powers) -> Powers:
    """Return densities that hold where the accelerometers are shaken beyond their range."""
    x, y, z, a, b, c = powers
    return x, y, z, max(a, _CLIPPED), max(b, _CLIPPED), max(c, _CLIPPED)


def densities(powers: Powers) -> Powers:
    """Return square roots: rad/sqrt(s) of the gyroscopes, m/s/sqrt(s) of the accelerometers."""
    return tuple(map(math.sqrt, powers))  # type: ignore[return-value]

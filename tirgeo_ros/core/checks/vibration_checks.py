"""Check how strongly the airframe shakes the IMU, and whether beyond its range."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.checks.imu_blocks import NO_NUMBER
from tirgeo_ros.core.config import ImuConfig
from tirgeo_ros.core.navigation.imu_clipping import Clipping
from tirgeo_ros.core.navigation.vibration_noise import densities, mean_powers
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import ImuSample

#: The vibration of one second in five is measured.
_LOOK_NS, _EVERY_NS = 1_000_000_000, 5_000_000_000
_LEAST_NUMBER = 3
#: Ratio of measured to configured noise density; the filter allows for it with larger covariances.
_STRONG = 10.0
#: More clipped samples than one knock gives, and the share of samples that harms the filter.
_LEAST_CLIPPED, _MOST_CLIPPED = 5, 1e-4


class VibrationChecks:
    """Check every IMU sample for clipping, and one second in five for vibration."""

    def __init__(self, config: ImuConfig) -> None:
        self._known = np.array((*config.angle_random_walk, *config.velocity_random_walk))
        self._clipping = Clipping()
        self._count = 0
        self._samples: list[ImuSample] = []
        self._begin_ns = 0
        self._sums = np.zeros(6)  # of the power densities of the measured seconds
        self._number = 0

    def add(self, sample: ImuSample) -> None:
        """Take the next sample, as it arrived."""
        self._count += 1
        since_ns = sample.stamp_ns - self._begin_ns
        if not 0 <= since_ns < _EVERY_NS:
            self._begin_ns = sample.stamp_ns
            self._samples = [sample]
        elif since_ns < _LOOK_NS:
            self._samples.append(sample)
        elif self._samples:
            usable = [one for one in self._samples if not fault_of(one)]
            self._samples = []
            if len(usable) > 2:
                self._sums += mean_powers(usable)
                self._number += 1
        x, y, z = sample.specific_force_b.tolist()
        p, q, r = sample.angular_rate_b.tolist()
        if abs(x + y + z) + abs(p + q + r) < NO_NUMBER:  # false for nan
            self._clipping.add(sample)

    def findings(self) -> list[Finding]:
        """Return the findings on vibration and on clipping."""
        found = []
        if self._number >= _LEAST_NUMBER:
            powers = tuple((self._sums / self._number).tolist())
            found += _strong(np.array(densities(powers)), self._known)
        counts = self._clipping.counts
        total = sum(counts.values())
        if total >= max(_LEAST_CLIPPED, _MOST_CLIPPED * self._count):
            listed = ", ".join(f"{name} {number}" for name, number in counts.items())
            evidence = f"imu/data is at the end of its range: {listed} of {self._count} samples"
            mend = "damp the IMU's mount or choose a larger range; balance the rotors"
            found.append(Finding("imu_clipping", Severity.CAUTION, evidence, "imu/data", mend))
        return found


def _strong(measured: Array, known: Array) -> list[Finding]:
    """Return a finding if densities (6,), rad/sqrt(s) and m/s/sqrt(s), are far above ``known``."""
    ratios = np.divide(measured, known, out=np.zeros(6), where=known > 0)
    if ratios.max() < _STRONG:
        return []
    gyro, accel = float(ratios[:3].max()), float(ratios[3:].max())
    evidence = (
        f"vibration is {gyro:.0f} times the gyroscopes' configured noise and {accel:.0f} times "
        "the accelerometers'; the filter takes it in"
    )
    where = "ekf_node imu.angle_random_walk, imu.velocity_random_walk"
    mend = "damp the IMU's mount; measure the noise with tirgeo calibrate allan"
    return [Finding("vibration", Severity.NOTE, evidence, where, mend)]

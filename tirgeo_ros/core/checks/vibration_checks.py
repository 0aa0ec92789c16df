"""Check how strongly the airframe shakes the IMU, and whether beyond its range."""

from __future__ import annotations

from collections import deque

import numpy as np

from tirgeo_ros.core.config import ImuConfig
from tirgeo_ros.core.navigation.imu_clipping import Clipping
from tirgeo_ros.core.navigation.vibration_noise import mean_powers
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import ImuSample

#: The vibration of one second in five is measured.
_LOOK_NS, _EVERY_NS = 1_000_000_000, 5_000_000_000
_LEAST_NUMBER = 3
#: Ratio of measured to configured noise density; they are in its model with larger covariances.
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
        # of the measured seconds, six each, for an hour
        self._powers: deque[tuple[float, ...]] = deque(maxlen=720)

    def add(self, sample: ImuSample) -> None:
        """Take the next sample, as it arrived; an invalid one is ignored."""
        if fault_of(sample):
            return
        self._count += 1
        self._clipping.add(sample)
        since_ns = sample.stamp_ns - self._begin_ns
        if not 0 <= since_ns < _EVERY_NS:
            self._begin_ns, self._samples = sample.stamp_ns, [sample]
        elif since_ns < _LOOK_NS:
            self._samples.append(sample)
        elif len(self._samples) > 2:
            self._powers.append(mean_powers(self._samples))
            self._samples = []

    def findings(self) -> list[Finding]:
        """Return the findings on vibration and on clipping."""
        found = []
        if len(self._powers) >= _LEAST_NUMBER:
            measured = np.sqrt(np.mean(self._powers, axis=0))
            ratios = np.divide(measured, self._known, out=np.zeros(6), where=self._known > 0)
            if ratios.max() > _STRONG:
                evidence = (
                    f"vibration is {ratios[:3].max():.0f} times the gyroscopes' configured noise "
                    f"and {ratios[3:].max():.0f} times the accelerometers'"
                )
                where = "ekf_node imu.angle_random_walk, imu.velocity_random_walk"
                mend = "damp the IMU's mount; measure the noise with tirgeo calibrate allan"
                found.append(Finding("vibration", Severity.NOTE, evidence, where, mend))
        counts = self._clipping.counts
        if sum(counts.values()) >= max(_LEAST_CLIPPED, _MOST_CLIPPED * self._count):
            listed = ", ".join(f"{name} {number}" for name, number in counts.items())
            evidence = f"imu/data reaches the end of its range: {listed} of {self._count} samples"
            mend = "damp the IMU's mount or choose a larger range; balance the rotors"
            found.append(Finding("imu_clipping", Severity.CAUTION, evidence, "imu/data", mend))
        return found

"""Check whether the receivers' stated covariances are plausible."""

from __future__ import annotations

import math
from collections import Counter

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)

_LEAST_NUMBER = 10
_MOST_SHARE = 0.5  # share of a topic's samples at which a finding is made
#: Limits of sigma: no receiver is better than the least, no fixed position worse than the largest.
_LEAST_M, _LARGEST_FIXED_M, _LARGEST_M_S = 5e-4, 1.0, 10.0  # the least of m/s too
_LEAST_RAD, _LARGEST_RAD = math.radians(0.005), math.radians(30)


class CovarianceChecks:
    """Count covariances that are zero, too small or too large, by topic."""

    def __init__(self, config: EkfConfig) -> None:
        rtk, heading = config.rtk, config.heading
        self._taken = {
            "rtk/fix": f"rtk.position_sigma_floor_m, {rtk.position_sigma_floor_m:g} m",
            "rtk/vel": f"rtk.velocity_sigma_floor_m_s, {rtk.velocity_sigma_floor_m_s:g} m/s",
            "rtk/heading": f"heading.sigma_floor_deg, {heading.sigma_floor_deg:g} deg",
            "gps/fix": "gps.position_sigma_m",
            "gps/vel": "gps.velocity_sigma_floor_m_s",
        }
        self._count: Counter[str] = Counter()
        self._wrong: Counter[tuple[str, str]] = Counter()  # by what is wrong, and topic

    def take(self, topic: str, sample: PositionSample | VelocitySample | HeadingSample) -> None:
        """Take a sample as it arrived."""
        if isinstance(sample, PositionSample) and sample.status is FixStatus.NONE:
            return
        self._count[topic] += 1
        self._wrong[_wrong(sample), topic] += 1

    def findings(self) -> list[Finding]:
        """Return one finding for each fault, naming all topics that have it."""
        by_fault: dict[str, list[str]] = {}
        for (what, topic), number in self._wrong.items():
            if what and number >= max(_LEAST_NUMBER, _MOST_SHARE * self._count[topic]):
                by_fault.setdefault(what, []).append(topic)
        return [self._finding(what, topics) for what, topics in by_fault.items()]

    def _finding(self, what: str, topics: list[str]) -> Finding:
        numbers = (f"{t} ({self._wrong[what, t]} of {self._count[t]})" for t in topics)
        evidence = f"covariances are {what}: {', '.join(numbers)}"
        if what != "too large":
            evidence += f"; {'; '.join(self._taken.get(topic, '') for topic in topics)} is taken"
        ordinary = all(topic.startswith("gps/") for topic in topics)
        severity = Severity.NOTE if ordinary else Severity.CAUTION
        mend = "let the driver fill it with the receiver's own accuracy (m2, (m/s)2, rad2)"
        name = f"covariance_{what.replace(' ', '_')}"
        return Finding(name, severity, evidence, f"{topics[0]} covariance", mend)


def _wrong(sample: PositionSample | VelocitySample | HeadingSample) -> str:
    """Return ``zero``, ``too small``, ``too large``, or an empty string."""
    if isinstance(sample, HeadingSample):
        variances, least, largest = [sample.variance_rad2], _LEAST_RAD, _LARGEST_RAD
    else:
        variances, least, largest = sample.covariance_n.diagonal().tolist(), _LEAST_M, math.inf
    if isinstance(sample, VelocitySample):
        largest = _LARGEST_M_S
    elif isinstance(sample, PositionSample) and sample.source is Source.RTK_POSITION:
        largest = _LARGEST_FIXED_M if sample.status is FixStatus.FIXED else math.inf
    if min(variances) <= 0:
        return "zero"
    if min(variances) < least**2:
        return "too small"
    return "too large" if max(variances) > largest**2 else ""

"""What is wrong with a sample by itself: numbers that are no measurement."""

from __future__ import annotations

import math

from tirgeo_ros.core.samples import (
    Array,
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
)

LARGEST_HEIGHT_M = 50_000.0
# Beyond the full scale of any IMU on an aircraft (40 g, 4000 deg/s), and its fastest flight.
_LARGEST_FORCE_M_S2 = 400.0
_LARGEST_RATE_RAD_S = 70.0
_LARGEST_SPEED_M_S = 1e3
_LARGEST_VARIANCE = 1e30
_ROUNDING = 1e-6  # of a covariance that was sent in single precision


def fault_of(sample: NavigationInput) -> str:
    """Why a sample cannot be used, or an empty string."""
    if isinstance(sample, ImuSample):
        return _imu_fault(sample)
    if isinstance(sample, HeadingSample):
        finite = math.isfinite(sample.heading_rad) and math.isfinite(sample.variance_rad2)
        return "" if finite else "heading is not finite"
    if isinstance(sample, PositionSample):
        return _position_fault(sample) or _covariance_fault(sample.covariance_n)
    velocity_n = sample.velocity_n.tolist()
    if not _within(velocity_n, _LARGEST_SPEED_M_S):
        finite = all(map(math.isfinite, velocity_n))
        return f"velocity is {'out of range' if finite else 'not finite'}"
    return _covariance_fault(sample.covariance_n)


def usable_attitude(q: Array | None) -> bool:
    """Whether a quaternion (4,) is there, finite and of unit norm within 1 %."""
    return q is not None and abs(math.hypot(*q) - 1.0) < 0.01


def _imu_fault(sample: ImuSample) -> str:
    force_b, rate_b = sample.specific_force_b.tolist(), sample.angular_rate_b.tolist()
    if _within(force_b, _LARGEST_FORCE_M_S2) and _within(rate_b, _LARGEST_RATE_RAD_S):
        return ""
    finite = all(map(math.isfinite, force_b + rate_b))
    return f"force or rate is {'out of range' if finite else 'not finite'}"


def _within(vector: list[float], limit: float) -> bool:
    """Whether no entry is larger; false for a NaN."""
    x, y, z = vector
    return -limit <= x <= limit and -limit <= y <= limit and -limit <= z <= limit


def _position_fault(sample: PositionSample) -> str:
    place = (sample.latitude_rad, sample.longitude_rad, sample.height_m)
    if not all(math.isfinite(value) for value in place):
        return "position is not finite"
    if abs(sample.latitude_rad) > math.pi / 2 or abs(sample.longitude_rad) > 2 * math.pi:
        return "latitude or longitude is out of range"
    if sample.latitude_rad == 0 and sample.longitude_rad == 0:
        return "position is 0, 0: receivers say so when they have none"
    return "" if abs(sample.height_m) < LARGEST_HEIGHT_M else "height is out of range"


def _covariance_fault(covariance: Array) -> str:
    rows = covariance.tolist()
    if not all(-_LARGEST_VARIANCE < value < _LARGEST_VARIANCE for row in rows for value in row):
        return "covariance is not finite"
    (a, b, c), (b2, d, e), (c2, e2, f) = rows
    if a <= 0 or d <= 0 or f <= 0:  # the message says that it does not know
        return ""
    largest = max(a, d, f)
    b, c, e = 0.5 * (b + b2) / largest, 0.5 * (c + c2) / largest, 0.5 * (e + e2) / largest
    a, d, f = a / largest + _ROUNDING, d / largest + _ROUNDING, f / largest + _ROUNDING
    # Sylvester: the leading minors of a positive matrix are positive.
    second = a * d - b * b
    third = second * f - a * e * e + 2 * b * c * e - d * c * c
    return "" if second > 0 and third > 0 else "covariance is not positive"

"""Measure the camera's motion up to an exposure, and extrapolate its pose beyond the newest one.

The newest pose continues at constant linear and angular rates, which are the slopes of a straight
line fitted to the last tenth of a second. The extrapolation error is measured, not assumed: the
poses of the last second are predicted in the same way from the poses before them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.frames.rotations import (
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.poses import CameraPose

#: Less than a turn takes, enough for the noise.
RATES_S = 0.1


def rates_up_to(pose: CameraPose, poses: PoseBuffer[CameraPose]) -> CameraRates | None:
    """Return the camera's rates up to a pose; None if they are not known."""
    before = poses.at(pose.stamp_ns - round(RATES_S * 1e9))
    return None if isinstance(before, Miss) else CameraRates.between(before, pose)


#: The length of the fitted line, and the least span that a fit needs. On simulated flights a
#: shorter line passes on the poses' noise (with 20 ms a predicted attitude is twice as wrong as
#: with 100 ms); a longer line lags behind turns.
FIT_S, _LEAST_FIT_S = 0.1, 0.05
#: The poses of this time span are predicted to measure the extrapolation error.
TRIAL_S = 1.0
_FEWEST_TRIALS = 5
#: The least manoeuvre that is assumed to begin after the newest pose, where no past pose shows it:
#: standard deviations of the camera's acceleration (m/s2) and angular acceleration (rad/s2), those
#: of an aircraft that corrects its course in light wind.
_ACCELERATION, _ANGULAR_ACCELERATION = 0.5, 0.2
_ROUNDING_S = 1e-9


def predicted(poses: Sequence[CameraPose], stamp_ns: int, max_gap_s: float) -> CameraPose | None:
    """Return the pose at a stamp after the last of ``poses``, which are in order of their stamps.

    Its covariance is the last pose's plus that of the extrapolation. None if the poses after the
    last gap longer than ``max_gap_s`` span less than 0.05 s.
    """
    stamps = np.array([pose.stamp_ns for pose in poses], np.int64)
    gaps = np.flatnonzero(np.diff(stamps) > max_gap_s * 1e9)
    first = int(gaps[-1]) + 1 if len(gaps) else 0
    poses, stamps = poses[first:], stamps[first:]
    if len(poses) < 2:
        return None
    last, times_s, places = poses[-1], (stamps - stamps[-1]) * 1e-9, _places(poses)
    first_of = np.searchsorted(times_s, times_s - FIT_S - _ROUNDING_S)
    first_of = np.minimum(first_of, np.maximum(np.arange(len(times_s)) - 1, 0))
    is_fitted = times_s - times_s[first_of] >= _LEAST_FIT_S - _ROUNDING_S
    if not is_fitted[-1]:
        return None
    rates = _slopes(times_s, places, first_of)
    ahead_s = (stamp_ns - last.stamp_ns) * 1e-9
    step = rates[-1] * ahead_s
    turned = quat_multiply(quat_from_rotvec(step[3:]), last.q_nc)
    tried = np.flatnonzero((times_s <= -ahead_s) & is_fitted)
    reached = [np.interp(times_s[tried] + ahead_s, times_s, column) for column in places.T]
    missed = np.stack(reached, axis=-1) - places[tried] - rates[tried] * ahead_s
    covariance = last.covariance + _spread(missed, ahead_s, last.covariance)
    return CameraPose(stamp_ns, last.position_n + step[:3], turned, covariance)


def _places(poses: Sequence[CameraPose]) -> Array:
    """Return (N, 6) positions and angles in NED, relative to the last and to the first pose.

    The angles are sums of the turns from each pose to the next. Over a tenth of a second their
    differences are the turn itself, to second order.
    """
    q_nc = np.array([pose.q_nc for pose in poses])
    turns = rotvec_from_quat(quat_multiply(q_nc[1:], quat_conjugate(q_nc[:-1])))
    places = np.zeros((len(poses), 6))
    places[:, :3] = [pose.position_n - poses[-1].position_n for pose in poses]
    places[1:, 3:] = turns.cumsum(axis=0)
    return places


def _slopes(times_s: Array, places: Array, first: IntArray) -> Array:
    """Return slopes (N, 6) of lines fitted to ``places[first[k]]`` to ``places[k]``; 0 for one."""

    def total(values: Array) -> Array:
        sums = np.concatenate([np.zeros((1, values.shape[1])), values.cumsum(axis=0)])
        return np.asarray(sums[1:] - sums[first])

    t = times_s[:, None]
    count = (np.arange(len(t)) + 1 - first)[:, None]
    sum_t, sum_x = total(t), total(places)
    above = total(t * places) - sum_t * sum_x / count
    below = total(t * t) - sum_t * sum_t / count
    return above / np.where(below > _ROUNDING_S, below, np.inf)


def _spread(missed: Array, ahead_s: float, covariance: Array) -> Array:
    """Return the (6, 6) mean square error of a prediction over ``ahead_s``, plus a floor.

    ``missed`` (N, 6) are the errors of predictions from past poses over the same time. With too
    few of them, both ends of the fitted line are assumed to have independent errors with the last
    pose's covariance.
    """
    floor = np.repeat([_ACCELERATION, _ANGULAR_ACCELERATION], 3) * ahead_s**2 / 2
    spread = np.diag(floor**2)
    if len(missed) < _FEWEST_TRIALS:
        return spread + 2 * (ahead_s / _LEAST_FIT_S) ** 2 * covariance
    return np.asarray(spread + missed.T @ missed / len(missed))

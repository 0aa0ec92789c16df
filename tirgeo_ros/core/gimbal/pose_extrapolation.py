"""The camera's pose a little after the newest one that is known.

The newest pose goes on at the rates, linear and angular, of a straight line through the last
tenth of a second. How far that misses is measured, not assumed: the poses of the last second are
predicted in the same way from those before them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.frames.rotations import (
    quat_conjugate,
    quat_from_rotvec,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.core.types.arrays import Array, BoolArray, IntArray
from tirgeo_ros.core.types.poses import CameraPose

#: The line's length, and the least that a line needs. On simulated flights a shorter one hands on
#: the poses' noise (a predicted attitude is twice as wrong with 20 ms as with 100 ms), a longer
#: one lags behind turns.
FIT_S, _LEAST_FIT_S = 0.1, 0.05
#: Poses of this long are predicted to see by how much the prediction misses.
TRIAL_S = 1.0
_FEWEST_TRIALS = 5
#: The least that is assumed of a manoeuvre's beginning, which no look back can see: standard
#: deviations of the camera's acceleration (m/s2) and angular acceleration (rad/s2), those of an
#: aircraft that corrects its course in light wind.
_ACCELERATION, _ANGULAR_ACCELERATION = 0.5, 0.2
_ROUNDING_S = 1e-9


def predicted(poses: Sequence[CameraPose], stamp_ns: int, max_gap_s: float) -> CameraPose | None:
    """The pose at a time after the last of ``poses``, which are in order of their stamps.

    Its covariance is the last pose's and that of the prediction itself. None where the poses after
    the last gap of more than ``max_gap_s`` do not span half a tenth of a second.
    """
    poses = _unbroken(poses, max_gap_s)
    if len(poses) < 2:
        return None
    last = poses[-1]
    ahead_s = (stamp_ns - last.stamp_ns) * 1e-9
    track = _Track.through(poses)
    if not track.is_fitted[-1]:
        return None
    step = track.rates[-1] * ahead_s
    turned = quat_multiply(quat_from_rotvec(step[3:]), last.q_nc)
    covariance = last.covariance + _spread(track, ahead_s, last.covariance)
    return CameraPose(stamp_ns, last.position_n + step[:3], turned, covariance)


def _unbroken(poses: Sequence[CameraPose], max_gap_s: float) -> Sequence[CameraPose]:
    """Those after the last gap."""
    stamps = np.array([pose.stamp_ns for pose in poses], np.int64)
    gaps = np.flatnonzero(np.diff(stamps) > max_gap_s * 1e9)
    return poses[int(gaps[-1]) + 1 :] if len(gaps) else poses


@dataclass(frozen=True)
class _Track:
    """Where N poses were, and the rates at each."""

    times_s: Array  # (N,) up to the last
    places: Array  # (N, 6) position and angle in NED
    rates: Array  # (N, 6) slopes of the lines that end there
    is_fitted: BoolArray  # (N,) whether that line is long enough

    @classmethod
    def through(cls, poses: Sequence[CameraPose]) -> _Track:
        """The angles are sums of the turns from each pose to the next.

        Over a tenth of a second their differences are the turn itself, to the second order.
        """
        stamps = np.array([pose.stamp_ns for pose in poses], np.int64)
        q_nc = np.array([pose.q_nc for pose in poses])
        turns = rotvec_from_quat(quat_multiply(q_nc[1:], quat_conjugate(q_nc[:-1])))
        places = np.zeros((len(poses), 6))
        places[:, :3] = [pose.position_n - poses[-1].position_n for pose in poses]
        places[1:, 3:] = turns.cumsum(axis=0)
        times_s = (stamps - stamps[-1]) * 1e-9
        first = np.searchsorted(times_s, times_s - FIT_S - _ROUNDING_S)
        first = np.minimum(first, np.maximum(np.arange(len(times_s)) - 1, 0))
        is_fitted = times_s - times_s[first] >= _LEAST_FIT_S - _ROUNDING_S
        return cls(times_s, places, _slopes(times_s, places, first), is_fitted)


def _slopes(times_s: Array, places: Array, first: IntArray) -> Array:
    """Slopes (N, 6) of the lines fitted to ``places[first[k]]`` to ``places[k]``; 0 for one."""

    def total(values: Array) -> Array:
        sums = np.concatenate([np.zeros((1, values.shape[1])), values.cumsum(axis=0)])
        return np.asarray(sums[1:] - sums[first])

    t = times_s[:, None]
    count = (np.arange(len(t)) + 1 - first)[:, None]
    sum_t, sum_x = total(t), total(places)
    above = total(t * places) - sum_t * sum_x / count
    below = total(t * t) - sum_t * sum_t / count
    return above / np.where(below > _ROUNDING_S, below, np.inf)


def _spread(track: _Track, ahead_s: float, covariance: Array) -> Array:
    """(6, 6) mean square of what a prediction over ``ahead_s`` misses, never less than the floor.

    The pose that it should have met is interpolated. With too few poses to see it, both ends of
    the line are taken to be as wrong as the last pose may be, each for itself.
    """
    floor = np.repeat([_ACCELERATION, _ANGULAR_ACCELERATION], 3) * ahead_s**2 / 2
    spread = np.diag(floor**2)
    times_s = track.times_s
    tried = np.flatnonzero((times_s <= -ahead_s) & track.is_fitted)
    if len(tried) < _FEWEST_TRIALS:
        return spread + 2 * (ahead_s / _LEAST_FIT_S) ** 2 * covariance
    met = [np.interp(times_s[tried] + ahead_s, times_s, column) for column in track.places.T]
    missed = np.stack(met, axis=-1) - track.places[tried] - track.rates[tried] * ahead_s
    return np.asarray(spread + missed.T @ missed / len(tried))

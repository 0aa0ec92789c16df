"""Buffer the autopilot's attitudes as one stream, and return the attitude at any instant."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np

from tirgeo_ros.core.frames.rotations import quat_multiply, slerp
from tirgeo_ros.core.gimbal.pose_buffer import Miss, StampedBuffer
from tirgeo_ros.core.navigation.ins.strapdown import quaternion_of
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.dji.sources.readings import Quaternion, Vector

_SPAN_S = 2.0
#: No interpolation between two attitudes further apart than this, the limit of gimbal_node too.
_LONGEST_GAP_S = 0.25
#: An attitude is propagated by the rate for no longer than this: five steps of the broadcast at
#: 100 Hz. At 10 rad/s2, as fast as a large aircraft starts to turn, the rate's change leaves 0.7
#: deg.
_CARRIED_NS = 50_000_000
#: A better stream counts as silent after this time; then attitudes of others are taken.
_SILENT_NS = 100_000_000
#: A stamp that goes back further comes from another clock, not from another stream.
_CLOCK_NS = 1_000_000_000
#: Largest difference of a quaternion's norm from one, as in the core.
_NORM_SLACK = 0.01


def unit_quaternion(q: Quaternion) -> Array | None:
    """Return q as (4,) wxyz of unit norm, w >= 0; None if it is not finite or not of unit norm."""
    w, x, y, z = q
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    if not abs(norm - 1.0) < _NORM_SLACK:  # true for NaN and infinity as well
        return None
    scale = math.copysign(1.0 / norm, w)
    return np.array((w * scale, x * scale, y * scale, z * scale))


class AutopilotAttitudes:
    """Buffer the newest attitudes: of the IMU stream in use, else of all other streams."""

    def __init__(self, counts: Counter[str]) -> None:
        """Take ``counts``, where ``attitude_unused`` counts attitudes beside a better stream."""
        self._counts = counts
        self._history: StampedBuffer[Array] = StampedBuffer(_SPAN_S, _LONGEST_GAP_S)
        self._best_ns: int | None = None

    def put(self, stamp_ns: int, q_nb: Array) -> None:
        """Take an attitude (4,) from the IMU stream in use."""
        self._best_ns = stamp_ns
        self._add(stamp_ns, q_nb)

    def offer(self, stamp_ns: int, q_nb: Array) -> None:
        """Take an attitude (4,) of another stream; it is used while the better one is silent.

        Two streams differ by milliseconds of delay: mixed, they would jitter while the aircraft
        turns.
        """
        best_ns = self._best_ns
        if best_ns is not None and -_CLOCK_NS < stamp_ns - best_ns <= _SILENT_NS:
            self._counts["attitude_unused"] += 1
            return
        self._add(stamp_ns, q_nb)

    def _add(self, stamp_ns: int, q_nb: Array) -> None:
        newest_ns = self._history.newest_ns
        if newest_ns is not None and 0 <= newest_ns - stamp_ns < _CLOCK_NS:
            self._counts["attitude_unused"] += 1
            return
        self._history.put(stamp_ns, q_nb)

    def at(self, stamp_ns: int) -> Array | Miss:
        """Return the interpolated attitude (4,) at an instant, or the reason why there is none."""
        found = self._history.around(stamp_ns)
        if isinstance(found, Miss):
            return found
        return found[0] if found[2] == 0.0 else slerp(*found)

    def carried(self, stamp_ns: int, angular_rate_b: Vector) -> Array | None:
        """Return the newest attitude (4,) propagated by the rate (b, rad/s).

        Returns None if the newest attitude is too far from the instant.
        """
        newest_ns = self._history.newest_ns
        if newest_ns is None or abs(stamp_ns - newest_ns) > _CARRIED_NS:
            return None
        newest = self.at(newest_ns)
        assert not isinstance(newest, Miss)
        step_s = (stamp_ns - newest_ns) * 1e-9
        x, y, z = angular_rate_b
        turn = quaternion_of(x * step_s, y * step_s, z * step_s)
        return unit_quaternion(quat_multiply(tuple(newest.tolist()), turn))

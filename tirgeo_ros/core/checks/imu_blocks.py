"""Average the IMU over short blocks, which the checks use in place of every sample."""

from __future__ import annotations

from typing import NamedTuple

from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.measurements import ImuSample

_BLOCK_NS = 50_000_000
#: After a longer step samples were lost, and a block across the step would not be a mean.
_LONGEST_STEP_NS = 40_000_000
#: A sample with a larger sum of components is invalid, whatever the unit.
NO_NUMBER = 1e7


class ImuMean(NamedTuple):
    """Hold means over an interval that ends at ``stamp_ns``, in the IMU's own axes, FRD."""

    stamp_ns: int
    step_s: float
    force_b: Vector  # m/s2
    rate_b: Vector  # rad/s
    autopilot_q_nb: Array | None  # at the interval's end
    joined: bool  # whether it begins where the previous block ended


class ImuBlocks:
    """Collect samples into blocks; a sample costs about 2 us."""

    def __init__(self) -> None:
        self._begin_ns = self._newest_ns = 0
        self._force: Vector = (0.0, 0.0, 0.0)
        self._rate: Vector = (0.0, 0.0, 0.0)
        self._count = 0
        self._joined = False

    def add(self, sample: ImuSample) -> ImuMean | None:
        """Take the next sample; return the block that it completes, or None.

        A sample represents the interval before its stamp. An invalid sample is ignored.
        """
        stamp_ns = sample.stamp_ns
        step_ns, self._newest_ns = stamp_ns - self._newest_ns, stamp_ns
        if not 0 < step_ns <= _LONGEST_STEP_NS:
            self._begin(stamp_ns, joined=False)
            return None
        a, b, c = self._force
        p, q, r = self._rate
        x, y, z = sample.specific_force_b.tolist()
        u, v, w = sample.angular_rate_b.tolist()
        if not abs(x + y + z) + abs(u + v + w) < NO_NUMBER:  # also true for nan
            return None
        self._force = a + x, b + y, c + z
        self._rate = p + u, q + v, r + w
        self._count += 1
        if stamp_ns - self._begin_ns < _BLOCK_NS:
            return None
        return self._ended(stamp_ns, sample.autopilot_q_nb)

    def _ended(self, stamp_ns: int, autopilot_q_nb: Array | None) -> ImuMean:
        share = 1.0 / self._count
        a, b, c = self._force
        p, q, r = self._rate
        block = ImuMean(
            stamp_ns,
            (stamp_ns - self._begin_ns) * 1e-9,
            (a * share, b * share, c * share),
            (p * share, q * share, r * share),
            autopilot_q_nb,
            self._joined,
        )
        self._begin(stamp_ns, joined=True)
        return block

    def _begin(self, stamp_ns: int, *, joined: bool) -> None:
        self._begin_ns, self._count, self._joined = stamp_ns, 0, joined
        self._force = self._rate = (0.0, 0.0, 0.0)

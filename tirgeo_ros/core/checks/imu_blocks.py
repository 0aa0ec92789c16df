"""Average the IMU over short blocks, which the checks use in place of every sample."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import ImuSample

_BLOCK_NS = 50_000_000
#: After a longer step samples were lost, and a block across the step would not be a mean.
_LONGEST_STEP_NS = 40_000_000
_NO_NUMBER = 1e7  # no force or rate is as large, whatever its unit


class ImuMean(NamedTuple):
    """Hold means over an interval that ends at ``stamp_ns``, in body axes, FRD."""

    stamp_ns: int
    step_s: float
    force_b: Array  # (3,) m/s2
    rate_b: Array  # (3,) rad/s
    autopilot_q_nb: Array | None  # (4,) at the interval's end; None without a usable one
    joined: bool  # whether it begins where the previous block ended


class ImuBlocks:
    """Collect samples into blocks; ``rotation_bi`` (3, 3) turns the IMU's axes into the body's."""

    def __init__(self, rotation_bi: Array | None) -> None:
        self._rotation_bi = np.eye(3) if rotation_bi is None else rotation_bi
        self._samples: list[ImuSample] = []
        self._begin_ns = self._newest_ns = 0
        self._joined = False

    def add(self, sample: ImuSample) -> ImuMean | None:
        """Take the next sample; return the block that it completes, or None.

        A sample represents the interval before its stamp. A block with invalid values is left out.
        """
        stamp_ns = sample.stamp_ns
        step_ns, self._newest_ns = stamp_ns - self._newest_ns, stamp_ns
        if not 0 < step_ns <= _LONGEST_STEP_NS:
            self._begin(stamp_ns, joined=False)
            return None
        self._samples.append(sample)
        if stamp_ns - self._begin_ns < _BLOCK_NS:
            return None
        pairs = [(s.specific_force_b, s.angular_rate_b) for s in self._samples]
        with np.errstate(invalid="ignore", over="ignore"):
            sums = np.add.reduce(pairs) @ self._rotation_bi.T
            force_b, rate_b = sums / len(pairs)
            good = bool(np.vdot(sums, sums) < _NO_NUMBER**2)  # False for nan
        q_nb = sample.autopilot_q_nb if usable_attitude(sample.autopilot_q_nb) else None
        step_s = (stamp_ns - self._begin_ns) * 1e-9
        block = ImuMean(stamp_ns, step_s, force_b, rate_b, q_nb, self._joined)
        self._begin(stamp_ns, joined=good)
        return block if good else None

    def _begin(self, stamp_ns: int, *, joined: bool) -> None:
        self._begin_ns, self._samples, self._joined = stamp_ns, [], joined

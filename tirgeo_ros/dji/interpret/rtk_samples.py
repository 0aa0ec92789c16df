"""Convert RTK readings: flags to status and covariance, baseline azimuth to the nose's heading."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.measurements import HeadingSample
from tirgeo_ros.dji.interpret.antenna_baseline import BaselineCheck, baseline_deg
from tirgeo_ros.dji.interpret.imu_stream_selection import Sequence
from tirgeo_ros.dji.interpret.receiver import Held, Receiver
from tirgeo_ros.dji.interpret.receiver_epochs import Value
from tirgeo_ros.dji.interpret.rtk_status import FIXED_FLAG, NO_FIX, Quality, flag_text, qualities
from tirgeo_ros.dji.sources.readings import RtkReading


class RtkInterpreter(Receiver[RtkReading]):
    """Convert the RTK receiver's readings to samples.

    If a reading lacks a flag, the newest one is used for up to 1.5 s; after that there is no fix.
    Counted in addition to what ``Receiver`` counts: ``rtk_yaw_not_fixed``, headings dropped
    because of their flag.
    """

    def __init__(
        self, config: DjiConfig, undulation_m: float, baseline: BaselineCheck, counts: Counter[str]
    ) -> None:
        super().__init__("rtk", config.rtk.delay_s, undulation_m, counts)
        self._baseline = baseline
        self._offset_deg = baseline_deg(config.aircraft)
        self._heading_variance = math.radians(config.heading.sigma_deg) ** 2
        self._qualities = qualities(config.rtk)
        self._position_flag: Held[int] = Held()
        self._yaw_flag: Held[int] = Held()
        self._headings = Sequence()

    def take(self, reading: RtkReading) -> list[Any]:
        """Return the samples of what is new in a reading."""
        stamp_ns, yaw_deg = reading.stamp_ns - self._delay_ns, reading.yaw_deg
        yaw: dict[str, Value] = {} if yaw_deg is None else {"yaw": (float(yaw_deg),)}
        fresh, samples = self._taken(stamp_ns, reading, yaw)
        if yaw_deg is not None and "yaw" in fresh:
            samples += self._heading(stamp_ns, yaw_deg)
        return samples

    def _hear(self, stamp_ns: int, reading: RtkReading) -> None:
        self._position_flag.hear(stamp_ns, reading.position_flag)
        self._yaw_flag.hear(stamp_ns, reading.yaw_flag)

    def _quality(self, stamp_ns: int) -> Quality:
        flag = self._position_flag.at(stamp_ns)
        return NO_FIX if flag is None else self._qualities.get(flag, NO_FIX)

    def _heading(self, stamp_ns: int, yaw_deg: float) -> list[HeadingSample]:
        if self._yaw_flag.at(stamp_ns) != FIXED_FLAG:
            self._count("yaw_not_fixed")
            return []
        self._baseline.add(stamp_ns, math.radians(yaw_deg))
        heading_rad = math.radians((yaw_deg - self._offset_deg) % 360.0)
        stamp_ns = self._headings.after(stamp_ns)
        return [HeadingSample(stamp_ns, heading_rad, self._heading_variance)]

    def diagnostics(self, now_ns: int) -> dict[str, str]:
        """Return flags in words, age of the newest epoch, and whether the receiver is frozen."""
        flags = {"rtk_flag": self._position_flag, "rtk_yaw_flag": self._yaw_flag}
        return {name: flag_text(flag.newest) for name, flag in flags.items()} | self._age(now_ns)

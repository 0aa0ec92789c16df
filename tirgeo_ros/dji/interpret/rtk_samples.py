"""Convert RTK readings: flags to status and covariance, baseline azimuth to the nose's heading."""

from __future__ import annotations

import math
from collections import Counter

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.measurements import HeadingSample, PositionSample, VelocitySample
from tirgeo_ros.dji.interpret.antenna_baseline import BaselineCheck, baseline_deg
from tirgeo_ros.dji.interpret.receiver import Held, Receiver
from tirgeo_ros.dji.interpret.receiver_epochs import Value
from tirgeo_ros.dji.interpret.rtk_status import FIXED_FLAG, NO_FIX, Quality, flag_text, qualities
from tirgeo_ros.dji.interpret.sequence_stamps import Sequence
from tirgeo_ros.dji.sources.readings import RtkReading

RtkSample = PositionSample | VelocitySample | HeadingSample


class RtkInterpreter:
    """Convert the RTK receiver's readings to samples.

    If a reading lacks a flag, the newest one is used for up to 1.5 s; after that there is no fix.
    Counted in addition to what ``Receiver`` counts: ``rtk_yaw_not_fixed``, headings dropped
    because of their flag.
    """

    def __init__(
        self, config: DjiConfig, undulation_m: float, baseline: BaselineCheck, counts: Counter[str]
    ) -> None:
        self._receiver = Receiver("rtk", undulation_m, counts)
        self._baseline = baseline
        self._counts = counts
        self._delay_ns = round(config.rtk.delay_s * 1e9)
        self._offset_deg = baseline_deg(config.aircraft)
        self._heading_variance = math.radians(config.heading.sigma_deg) ** 2
        self._qualities = qualities(config.rtk)
        self._position_flag: Held[int] = Held()
        self._yaw_flag: Held[int] = Held()
        self._headings = Sequence()

    def take(self, reading: RtkReading) -> list[RtkSample]:
        """Return the samples of what is new in a reading."""
        receiver, stamp_ns = self._receiver, reading.stamp_ns - self._delay_ns
        place = receiver.usable_place(reading.place)
        if receiver.is_late(stamp_ns, place):
            return []
        velocity_n = receiver.usable_velocity(reading.velocity_n)
        self._position_flag.hear(stamp_ns, reading.position_flag)
        self._yaw_flag.hear(stamp_ns, reading.yaw_flag)
        yaw_deg = reading.yaw_deg
        parts: dict[str, Value | None] = {
            "place": place,
            "velocity": velocity_n,
            "yaw": None if yaw_deg is None else (float(yaw_deg),),
        }
        there = {part: value for part, value in parts.items() if value is not None}
        fresh = receiver.news(stamp_ns, there)
        quality = self._quality(stamp_ns)
        samples: list[RtkSample] = list(
            receiver.samples(stamp_ns, fresh, place, velocity_n, quality)
        )
        if yaw_deg is not None and "yaw" in fresh:
            samples += self._heading(stamp_ns, yaw_deg)
        return samples

    def _quality(self, stamp_ns: int) -> Quality:
        flag = self._position_flag.at(stamp_ns)
        return NO_FIX if flag is None else self._qualities.get(flag, NO_FIX)

    def _heading(self, stamp_ns: int, yaw_deg: float) -> list[HeadingSample]:
        if self._yaw_flag.at(stamp_ns) != FIXED_FLAG:
            self._counts["rtk_yaw_not_fixed"] += 1
            return []
        self._baseline.add(stamp_ns, math.radians(yaw_deg))
        heading_rad = math.radians((yaw_deg - self._offset_deg) % 360.0)
        stamp_ns = self._headings.after(stamp_ns)
        return [HeadingSample(stamp_ns, heading_rad, self._heading_variance)]

    def diagnostics(self, now_ns: int) -> dict[str, str]:
        """Return flags in words, age of the newest epoch, and whether the receiver is frozen."""
        epoch_ns = self._receiver.epoch_ns
        found = {
            "rtk_flag": flag_text(self._position_flag.newest),
            "rtk_yaw_flag": flag_text(self._yaw_flag.newest),
        }
        if epoch_ns is not None:
            found["rtk_age_s"] = f"{(now_ns - self._delay_ns - epoch_ns) * 1e-9:.2f}"
            found["rtk_frozen"] = "yes" if self._receiver.frozen else "no"
        return found

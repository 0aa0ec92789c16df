"""Convert RTK readings: flags to status and covariance, baseline azimuth to the nose's heading.

RTK yaw is the azimuth of the line from the first antenna to the second. Its angle from the nose
follows from the positions of the two; ``core.checks.heading_checks`` compares the result with the
autopilot's heading.
"""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from tirgeo_ros.core.config import AircraftConfig, DjiConfig
from tirgeo_ros.core.config.dji_parameters import DjiRtkConfig
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample
from tirgeo_ros.dji.interpret.imu_samples import Sequence
from tirgeo_ros.dji.interpret.receiver import NO_FIX, Held, Quality, Receiver
from tirgeo_ros.dji.interpret.receiver_epochs import Value
from tirgeo_ros.dji.sources.readings import RtkReading

#: The receiver's status numbers, which are NovAtel's position types, of position and yaw.
FLAG_NAMES = {
    0: "no solution",
    1: "fixed by command",
    2: "height fixed",
    8: "Doppler velocity",
    16: "single point",
    17: "pseudorange differential",
    18: "SBAS",
    19: "propagated",
    20: "OmniSTAR VBS",
    32: "L1 float",
    33: "ionosphere-free float",
    34: "narrow-lane float",
    48: "L1 integer",
    49: "wide-lane integer",
    50: "narrow-lane integer",
}
FIXED_FLAG = 50
#: Flags; status; horizontal and vertical sigma (m); velocity sigma relative to a fixed solution's.
#: Wrong integers of the wide lane are 0.86 m apart, and their carrier noise is a few times the
#: narrow lane's. A float solution has settled to some decimetres. Code is good to a metre with
#: corrections, to some metres without. Velocities come from Doppler and need no integers: they get
#: worse with the signals alone.
_CLASSES = (
    ((FIXED_FLAG,), FixStatus.FIXED, (0.0, 0.0), 1.0),
    ((48, 49), FixStatus.FLOAT, (0.2, 0.4), 1.0),
    ((32, 33, 34), FixStatus.FLOAT, (0.5, 1.0), 2.0),
    ((17, 18, 20), FixStatus.FLOAT, (1.0, 2.0), 4.0),
    ((16, 19), FixStatus.SINGLE, (2.5, 5.0), 4.0),
)


#: Direction of the baseline of DJI's kit from the nose: first antenna left, second right.
_KIT_DEG = 90.0
NOT_SET = (
    "aircraft.second_antenna_m is not set: RTK yaw is taken as from DJI's kit, with the first "
    "antenna left and the second right; set aircraft.rtk_antenna_m and aircraft.second_antenna_m"
)


def baseline_deg(aircraft: AircraftConfig) -> float:
    """Return the direction from the first antenna to the second, from the nose, clockwise.

    DJI's kit where there is no second place. Raises ConfigError where the two give no heading.
    """
    known_deg = aircraft.baseline_deg
    return _KIT_DEG if known_deg is None else known_deg


class RtkInterpreter(Receiver[RtkReading]):
    """Convert the RTK receiver's readings to samples.

    If a reading lacks a flag, the newest one is used for up to 1.5 s; after that there is no fix.
    Counted in addition to what ``Receiver`` counts: ``rtk_yaw_not_fixed``, headings dropped
    because of their flag.
    """

    def __init__(self, config: DjiConfig, undulation_m: float, counts: Counter[str]) -> None:
        super().__init__("rtk", config.rtk.delay_s, undulation_m, counts)
        self._offset_deg = baseline_deg(config.aircraft)
        self.configure(config)
        self._position_flag: Held[int] = Held()
        self._yaw_flag: Held[int] = Held()
        self._headings = Sequence()

    def configure(self, config: DjiConfig) -> None:
        """Take sigmas and delay, also others in flight."""
        self._delay_ns = round(config.rtk.delay_s * 1e9)
        self._heading_variance = math.radians(config.heading.sigma_deg) ** 2
        self._qualities = _qualities(config.rtk)

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
        heading_rad = math.radians((yaw_deg - self._offset_deg) % 360.0)
        stamp_ns = self._headings.after(stamp_ns)
        return [HeadingSample(stamp_ns, heading_rad, self._heading_variance)]

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return the newest flags of position and yaw, in words."""
        flags = {
            "rtk_flag": self._position_flag.newest,
            "rtk_yaw_flag": self._yaw_flag.newest,
        }
        return {
            name: "not told" if flag is None else f"{flag} {FLAG_NAMES.get(flag, 'unknown')}"
            for name, flag in flags.items()
        }


def _qualities(config: DjiRtkConfig) -> dict[int, Quality]:
    """Return the flags that are a fix, each with its quality.

    No flag's sigmas are smaller than those of the fixed one.
    """
    found = {}
    for flags, status, sigmas_m, factor in _CLASSES:
        horizontal, vertical = (
            max(pair) ** 2 for pair in zip(sigmas_m, config.fixed_sigma_m, strict=True)
        )
        velocity_variance = (factor * config.velocity_sigma_m_s) ** 2
        quality = Quality(status, (horizontal, horizontal, vertical), velocity_variance)
        found.update(dict.fromkeys(flags, quality))
    return found

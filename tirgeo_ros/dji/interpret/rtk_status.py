"""Map the RTK receiver's status numbers (NovAtel's position types) to fix status and accuracy."""

from __future__ import annotations

from typing import NamedTuple

from tirgeo_ros.core.config.dji import DjiRtkConfig
from tirgeo_ros.core.types.measurements import FixStatus

#: Position and yaw use the same list.
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


class Quality(NamedTuple):
    """Hold status and variances of a satellite solution."""

    status: FixStatus
    position_variance: tuple[float, float, float]  # north, east, down, m2; zeros: not known
    velocity_variance: float  # of each axis, (m/s)2; zero: not known


#: Sigma of a place of which nothing is known: no weight, but finite in sums.
UNKNOWN_SIGMA_M = 1e5

NO_FIX = Quality(FixStatus.NONE, (UNKNOWN_SIGMA_M**2,) * 3, UNKNOWN_SIGMA_M**2)

#: Flags; status; horizontal and vertical sigma (m); velocity sigma relative to a fixed solution's.
#: Wrong integers of the wide lane are 0.86 m apart, and their carrier noise is a few times the
#: narrow lane's. A float solution has settled to some decimetres. Code is good to a metre with
#: corrections, to some metres without. Velocities come from Doppler and need no integers: they get
#: worse with the signals alone.
_CLASSES = (
    ((48, 49), FixStatus.FLOAT, (0.2, 0.4), 1.0),
    ((32, 33, 34), FixStatus.FLOAT, (0.5, 1.0), 2.0),
    ((17, 18, 20), FixStatus.FLOAT, (1.0, 2.0), 4.0),
    ((16, 19), FixStatus.SINGLE, (2.5, 5.0), 4.0),
)


def qualities(config: DjiRtkConfig) -> dict[int, Quality]:
    """Return the flags that are a fix, each with its quality.

    No flag's sigmas are smaller than those of the fixed one.
    """
    fixed = (config.fixed_sigma_m[0], config.fixed_sigma_m[1])
    speed = config.velocity_sigma_m_s
    found = {FIXED_FLAG: _quality(FixStatus.FIXED, fixed, speed)}
    for flags, status, (horizontal, vertical), factor in _CLASSES:
        sigmas = max(horizontal, fixed[0]), max(vertical, fixed[1])
        found.update(dict.fromkeys(flags, _quality(status, sigmas, factor * speed)))
    return found


def _quality(status: FixStatus, sigma_m: tuple[float, float], sigma_m_s: float) -> Quality:
    horizontal, vertical = sigma_m[0] ** 2, sigma_m[1] ** 2
    return Quality(status, (horizontal, horizontal, vertical), sigma_m_s**2)


def flag_text(flag: int | None) -> str:
    """Return a flag for people."""
    if flag is None:
        return "not told"
    return f"{flag} {FLAG_NAMES.get(flag, 'unknown')}"

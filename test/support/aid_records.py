"""Times, a level state and receivers that were heard, for tests of the aids' records."""

from __future__ import annotations

from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.types.measurements import FixStatus

SECOND_NS = 1_000_000_000
TIMEOUT_NS = SECOND_NS
HOME = (0.695, 2.04, 31.5)
LEVEL = NavState((1.0, 0.0, 0.0, 0.0), (0.0,) * 3, *HOME, *[(0.0,) * 3] * 3)


def ns(seconds: float) -> int:
    return 1000 * SECOND_NS + round(seconds * SECOND_NS)


def heard(control: AidStatus, t_s: float, status=FixStatus.FIXED) -> AidStatus:
    return control.heard(status, ns(t_s), TIMEOUT_NS)

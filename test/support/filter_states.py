"""What a filter in flight believes, for tests of the aids."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.types.measurements import FixStatus, Source

NOW_NS = 5_000_000_000


def state_of(roll: float, pitch: float, yaw: float) -> NavState:
    """A state in slow flight, in this attitude (rad)."""
    q = tuple(quat_from_euler(roll, pitch, yaw).tolist())
    return NavState(q, (3.0, -1.0, 0.2), 0.695, 2.04, 31.5, *[(0.0,) * 3] * 3)


#: The antenna's place is known: 18 states.
MEASURED = config_from(EkfConfig, {"aircraft.rtk_antenna_sigma_m": (0.0, 0.0, 0.0)})


def belief_of(state: NavState, states: int = 18, covariance=None) -> StateEstimate:
    """RTK fixed and its position, velocity and heading used just now, for long."""
    control = AidStatus(Receivers(NOW_NS)).heard(FixStatus.FIXED, 0, NOW_NS)
    control = control.heard(FixStatus.FIXED, NOW_NS, NOW_NS)
    for source in (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING):
        control = control.with_track(source, AidTrack(NOW_NS, NOW_NS))
    return StateEstimate(state, np.eye(states) if covariance is None else covariance, control)

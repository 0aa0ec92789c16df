"""What goes into the core and what comes out of it: immutable records with frames and units.

All stamps are integer nanoseconds of the measurement. Frames as in the charter
(``tirgeo_ros/__init__.py``). Arrays are float64 unless said otherwise.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum, IntEnum
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class FixStatus(IntEnum):
    """Quality of a satellite fix, numbered as the status of ``rtk/fix``."""

    NONE = -1
    SINGLE = 0
    FLOAT = 1
    FIXED = 2


class Source(Enum):
    """Where a sample comes from; the value is its name in diagnostics and verdicts."""

    IMU = "imu"
    RTK_POSITION = "rtk_position"
    RTK_VELOCITY = "rtk_velocity"
    RTK_HEADING = "rtk_heading"
    GPS_POSITION = "gps_position"
    GPS_VELOCITY = "gps_velocity"
    AUTOPILOT_HEADING = "autopilot_heading"

    # Members are single objects: Enum's own hash, of the name, costs ten times as much.
    __hash__ = object.__hash__


@dataclass(frozen=True, slots=True)
class ImuSample:
    """Body specific force and rate at ``stamp_ns``, with the autopilot's own attitude if known."""

    stamp_ns: int
    specific_force_b: Array  # (3,) FRD, m/s2; (0, 0, -9.8) at rest
    angular_rate_b: Array  # (3,) FRD, rad/s
    autopilot_q_nb: Array | None = None  # (4,) wxyz; None where the message says it is absent


@dataclass(frozen=True, slots=True)
class PositionSample:
    """A satellite position of an antenna."""

    stamp_ns: int
    source: Source  # RTK_POSITION or GPS_POSITION
    status: FixStatus
    latitude_rad: float
    longitude_rad: float
    height_m: float  # ellipsoidal
    covariance_n: Array  # (3, 3) NED, m2


@dataclass(frozen=True, slots=True)
class VelocitySample:
    """A satellite velocity of an antenna."""

    stamp_ns: int
    source: Source  # RTK_VELOCITY or GPS_VELOCITY
    velocity_n: Array  # (3,) NED, m/s
    covariance_n: Array  # (3, 3) NED, m2/s2


@dataclass(frozen=True, slots=True)
class HeadingSample:
    """The heading that two antennas give."""

    stamp_ns: int
    heading_rad: float  # 0 = true north, clockwise
    variance_rad2: float  # not positive: not known


@dataclass(frozen=True, slots=True)
class AutopilotHeading:
    """The nose's azimuth by the autopilot's own attitude; the filter's last resort."""

    stamp_ns: int
    heading_rad: float  # 0 = true north, clockwise
    variance_rad2: float


NavigationInput = ImuSample | PositionSample | VelocitySample | HeadingSample


@dataclass(frozen=True, slots=True)
class JointSample:
    """Gimbal encoder angles: ``R_bg = Rz(yaw) Rx(roll) Ry(pitch)``, FRD axes, radians."""

    stamp_ns: int
    yaw_rad: float  # clockwise from above
    roll_rad: float  # right side down
    pitch_rad: float  # camera up
    computed: bool = False  # from the reported attitudes: no encoder saw them


@dataclass(frozen=True, slots=True)
class CameraAttitudeSample:
    """Camera attitude as the flight controller reports it: camera body (FRD) to NED."""

    stamp_ns: int
    q_ng: Array  # (4,) wxyz


class NavSolution(NamedTuple):
    """The aircraft's navigation state: the IMU's position, ``n`` at the aircraft."""

    stamp_ns: int
    latitude_rad: float
    longitude_rad: float
    height_m: float
    velocity_n: Array  # (3,) m/s
    q_nb: Array  # (4,) wxyz
    angular_rate_b: Array  # (3,) rad/s, bias removed
    rate_variance_b: tuple[float, float, float]  # of the angular rate, (rad/s)^2
    covariance: Array  # (9, 9) position NED m2, attitude phi_n rad2, velocity NED m2/s2

    @property
    def pose_covariance(self) -> Array:
        """(6, 6): position NED in m2, attitude phi_n in rad2."""
        return self.covariance[:6, :6]


@dataclass(frozen=True, slots=True)
class BodyPose:
    """Pose of the body in the ``map`` tangent plane, NED axes."""

    stamp_ns: int
    position_n: Array  # (3,) m from the map's origin
    q_nb: Array  # (4,) wxyz
    covariance: Array  # (6, 6) position m2, attitude phi_n rad2


@dataclass(frozen=True, slots=True)
class CameraPose:
    """Pose of the camera's optical frame in the ``map`` tangent plane, NED axes."""

    stamp_ns: int
    position_n: Array  # (3,) m from the map's origin
    q_nc: Array  # (4,) wxyz, optical frame to NED
    covariance: Array  # (6, 6) position m2, attitude phi_n rad2


class Outcome(Enum):
    """What became of a sample; the value is its name in diagnostics."""

    USED = "used"
    WAITING = "waiting"  # not aligned yet: kept or only looked at
    GATED = "gated"  # the innovation is larger than the gate allows
    TOO_OLD = "too_old"  # older than the history
    TOO_NEW = "too_new"  # measured after the newest IMU sample can reach
    TOO_MANY = "too_many"  # more of them wait for the IMU than are kept: given up
    OUT_OF_ORDER = "out_of_order"  # an IMU stamp not later than the one before
    TIME_JUMP = "time_jump"  # the clock went back: the filter starts again
    GAP = "gap"  # IMU samples missing for too long: the filter starts again
    RESET = "reset"  # the last of many refusals that agree: the state was set to it
    RESTART = "restart"  # the last of many refusals: the filter starts again
    REPEATED = "repeated"  # the same measurement again
    INVALID = "invalid"  # not finite, zero quaternion, impossible covariance
    NOT_FIXED = "not_fixed"  # the fix is not good enough for this use
    STANDBY = "standby"  # ordinary GPS, not needed while RTK is there
    UNUSED = "unused"  # the chosen method does not use this source

    __hash__ = object.__hash__  # as Source


class Verdict(NamedTuple):
    """The answer to one sample: what became of it, with numbers."""

    source: Source
    outcome: Outcome
    reason: str = ""
    test_ratio: float = float("nan")  # innovation over gate, squared; > 1 is refused
    innovation: tuple[float, ...] = ()
    nis: float = float("nan")  # normalised innovation squared over its degrees of freedom

    @property
    def used(self) -> bool:
        """Whether the sample entered the state."""
        return self.outcome is Outcome.USED


class FilterState(Enum):
    """Where the estimator stands; the value is shown in diagnostics and on the picture."""

    WAITING = "waiting"  # nothing to start from yet
    ALIGNING = "aligning"
    RUNNING = "running"
    DEGRADED = "degraded"  # an aid of the method is missing, the position is still measured
    DEAD_RECKONING = "dead_reckoning"  # nothing measures the position
    LOST = "lost"  # not to be trusted any more; nothing is published

    @property
    def navigating(self) -> bool:
        """Whether there is a solution with an honest covariance."""
        return self in _NAVIGATING


_NAVIGATING = {FilterState.RUNNING, FilterState.DEGRADED, FilterState.DEAD_RECKONING}


@dataclass(frozen=True, slots=True)
class NavigationStatus:
    """What the estimator says of itself, for diagnostics and the overlay's status line."""

    method: str
    state: FilterState
    reason: str  # why it is not running (the aids that are missing), else empty
    rtk_status: FixStatus
    heading_sigma_rad: float  # nan while there is no solution
    counts: dict[tuple[str, str], int]  # (source, outcome) -> number
    test_ratios: dict[str, float]  # source -> newest test ratio
    state_s: float = 0.0  # for how long it has been in this state
    resets: dict[str, int] = field(default_factory=dict)  # source -> number
    last_reset: str = ""  # what the newest reset changed, and by how much
    clipped: dict[str, int] = field(default_factory=dict)  # channel of the IMU -> samples
    warnings: tuple[str, ...] = ()  # what is wrong although it navigates, with reasons
    nis: dict[str, float] = field(default_factory=dict)  # source -> mean of 30 s over degrees
    process_noise: str = ""  # where the filter's noise of the IMU comes from
    vibration: tuple[
        float, ...
    ] = ()  # densities: rad/sqrt(s) of gyroscopes, m/s/sqrt(s) of accel.

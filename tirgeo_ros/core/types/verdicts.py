"""Define what becomes of samples, and what the estimator says of itself."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from typing import NamedTuple

from tirgeo_ros.core.types.measurements import FixStatus, Source


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

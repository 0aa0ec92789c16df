# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Define the verdict on a sample, and the state and status of the estimator."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple

from tirgeo_ros.core.types.measurements import FixStatus, Source


class Outcome(Enum):
    """Name what the estimator did with a sample; the value is its name in diagnostics."""

    USED = "used"
    WAITING = "waiting"  # used for alignment only, or held until later IMU samples decide
    GATED = "gated"  # the innovation failed the gate
    TOO_OLD = "too_old"  # older than the filter's history
    TOO_NEW = "too_new"  # too far ahead of the newest IMU sample
    TOO_MANY = "too_many"  # discarded: the queue of samples that wait for the IMU is full
    OUT_OF_ORDER = "out_of_order"  # an IMU stamp not later than the previous one
    TIME_JUMP = "time_jump"  # the clock went back: the filter starts again
    GAP = "gap"  # IMU samples missing for too long: the filter starts again
    RESET = "reset"  # the last of many refused samples that agree: the state was set to it
    RESTART = "restart"  # the last of many refused samples: the filter starts again
    REPEATED = "repeated"  # the same measurement as before
    INVALID = "invalid"  # not finite, zero quaternion, impossible covariance
    NOT_FIXED = "not_fixed"  # the quality of the fix is too low for this use
    STANDBY = "standby"  # not needed: another source or the state is better
    UNUSED = "unused"  # the selected method does not use this source

    __hash__ = object.__hash__  # for speed, as in Source


#: Outcomes of a measurement that are not reported to people.
QUIET = {
    Outcome.USED,
    Outcome.WAITING,
    Outcome.REPEATED,
    Outcome.STANDBY,
    Outcome.UNUSED,
    Outcome.NOT_FIXED,
}


class Verdict(NamedTuple):
    """Hold the estimator's answer to one sample: the outcome, the reason and the numbers."""

    source: Source
    outcome: Outcome
    reason: str = ""
    test_ratio: float = float("nan")  # (innovation / gate) squared; > 1 is refused
    innovation: tuple[float, ...] = ()
    nis: float = float("nan")  # normalised innovation squared / its degrees of freedom

    @property
    def used(self) -> bool:
        """Return whether the sample updated the state."""
        return self.outcome is Outcome.USED


class FilterState(Enum):
    """Name the estimator's state; the value is shown in diagnostics and on the picture."""

    WAITING = "waiting"  # no data to start from yet
    ALIGNING = "aligning"
    RUNNING = "running"
    DEGRADED = "degraded"  # an aid of the method is missing; position still measured
    DEAD_RECKONING = "dead_reckoning"  # the position is not measured, only integrated
    LOST = "lost"  # the state cannot be trusted; nothing is published

    @property
    def navigating(self) -> bool:
        """Return whether there is a solution whose covariance can be trusted."""
        return self in _NAVIGATING


_NAVIGATING = {FilterState.RUNNING, FilterState.DEGRADED, FilterState.DEAD_RECKONING}


@dataclass(frozen=True, slots=True)
class NavigationStatus:
    """Hold the estimator's status for diagnostics and the overlay's status line."""

    method: str
    state: FilterState
    reason: str  # why it is not running (the missing aids), otherwise empty
    rtk_status: FixStatus
    heading_sigma_rad: float  # nan while there is no solution
    counts: dict[tuple[str, str], int]  # (source, outcome) -> number of samples
    test_ratios: dict[str, float]  # source -> newest test ratio
    state_s: float = 0.0  # time in this state
    resets: dict[str, int] = field(default_factory=dict)  # source -> number of resets
    last_reset: str = ""  # what the newest reset changed, and by how much
    clipped: dict[str, int] = field(default_factory=dict)  # IMU channel -> clipped samples
    warnings: tuple[str, ...] = ()  # faults that do not stop the navigation, with reasons
    nis: dict[str, float] = field(default_factory=dict)  # source -> mean Verdict.nis over 30 s
    process_noise: str = ""  # the source of the filter's IMU noise: parameters or vibration
    #: Noise densities: gyroscopes rad/sqrt(s), accelerometers m/s/sqrt(s).
    vibration: tuple[float, ...] = ()
    began_again: Outcome | None = None  # GAP, TIME_JUMP or RESTART, until the filter runs again
    #: What the flight shows of the delay of the IMU's stamps, without the prior, and its sigma,
    #: enlarged if the NIS is. nan if that is less than the prior tells, if a NIS is above 2, or if
    #: the delay is exact.
    imu_delay_s: float = math.nan
    imu_delay_sigma_s: float = math.nan
    gps_sigmas: float = 0.0  # largest slow difference of gps/fix from the state, over its sigma

    def late_imu(self, configured_s: float) -> dict[str, Any]:
        """Return how far the IMU's delay is from the configured one; empty up to 3 sigma."""
        off_s, sigma_s = self.imu_delay_s - configured_s, self.imu_delay_sigma_s
        if not abs(off_s) > 3 * sigma_s:
            return {}
        sizes = {"size_s": abs(off_s), "size_ms": 1e3 * abs(off_s), "sigma_ms": 1e3 * sigma_s}
        return sizes | {"way": "later" if off_s > 0 else "earlier", "delay_s": self.imu_delay_s}

    @property
    def for_operator(self) -> str:
        """Return the state in words for an operator; empty while running. ``reason`` says more."""
        return _AGAIN.get(self.began_again) or _STATES.get(self.state, "")


_STATES = {
    FilterState.WAITING: "No position, as sensor data are missing",
    FilterState.ALIGNING: "No position yet, the filter aligns itself",
    FilterState.DEGRADED: "Less accurate, as a receiver is not fixed or is silent",
    FilterState.DEAD_RECKONING: "Nothing measures the position, it drifts",
    FilterState.LOST: "No position, as the filter's errors grew too large",
}
_AGAIN: dict[Outcome | None, str] = {
    Outcome.TIME_JUMP: "No position, as the IMU's time went back",
    Outcome.GAP: "No position, as the IMU was silent for too long",
    Outcome.RESTART: _STATES[FilterState.LOST],
}

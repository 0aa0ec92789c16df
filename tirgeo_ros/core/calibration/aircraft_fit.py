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
"""Fit the aircraft's parameters so that the filter's innovations of a flight are smallest.

Maximum likelihood by Gauss-Newton over whitened innovations and their slopes (``aircraft_run``),
with Huber's weights. The first steps use larger noise floors, so that the filter also runs with
values that are far off.

The IMU's mounting angles follow from the mean difference between the filter's vertical in the
IMU's axes and the autopilot's in the body's, by a small turn ``phi``:
``d_body - d_imu = phi x d_imu``. An error of the autopilot's heading has no effect.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.aircraft_parameters import (
    AZIMUTH,
    DELAYS,
    LIMITS,
    PARAMETERS,
    PRIOR_SIGMA,
    TABLE,
    Floors,
    reported_direction_rad,
    values_of_config,
)
from tirgeo_ros.core.calibration.aircraft_run import FilterRun, FlightRuns, huber_weight, squared
from tirgeo_ros.core.frames.rotations import euler_from_quat, matrix_from_quat
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.measurements import HeadingSample, ImuSample, Source

PARTS = 6  # of a flight; each is left out in turn, for the standard deviations
#: Noise floors of the coarse steps, and the largest number of steps with each.
_COARSE = ((Floors(0.5, 0.5, math.radians(5)), 3), (Floors(0.1, 0.1, math.radians(1.5)), 2))
_MOST_STEPS = 8
_SETTLED = 0.02  # of LIMITS
_LARGEST_STEP = np.array([1.0, 1.0, 1.0, 0.5, 0.2, 0.2, 0.2])  # m, rad, s
_HEADING = [AZIMUTH, DELAYS[Source.RTK_HEADING]]
_TRIED_DELAYS_S = np.arange(-0.5, 0.501, 0.02)

#: Called after each run of the filter with the number of runs so far.
Report = Callable[[int], None]

_BY_SPEED = ("antenna_up", "baseline_azimuth", "position_delay", "velocity_delay")
_LEAST_TURNED_RAD = math.radians(90)
_LEAST_TILT_RAD = math.radians(1.5)  # rms about the mean
_LEAST_SPEED_M_S = 1.0  # rms about the mean
_LEAST_TURN_RATE_RAD_S = math.radians(3.0)  # rms

# Roll and pitch of the IMU in its mount.
LEVEL = ("level_roll", "level_pitch")
LEVEL_LIMIT_RAD = math.radians(0.3)
LEVEL_ADVICE = (
    "three minutes with orientation in imu/data, legs in several directions and rests between"
)
_LEAST_PART = 20  # attitudes
_NEAR_NS = 30_000_000


@dataclass(frozen=True)
class AircraftFit:
    """Hold the values of PARAMETERS that a flight has determined."""

    values: Array  # (7,) unchanged where held or not observed
    sigma: Array  # (7,) nan where held
    determined: tuple[str, ...]
    undetermined: dict[str, str]  # parameter -> why, and what to fly
    first: Array  # (7,) before the fit
    before: FilterRun
    after: FilterRun


@dataclass
class _Search:
    """Search the values by runs of the filter; measurements keep their weights from run to run."""

    runs: FlightRuns
    anchor: Array  # (7,) the prior's means
    report: Report
    weights: Array = field(init=False)
    done: int = 0

    def __post_init__(self) -> None:
        self.weights = np.ones(len(self.runs.recorded.aids))

    def run(self, values: Array, floors: Floors, *, without: Source | None = None) -> FilterRun:
        recorded = self.runs.recorded
        by_antennas = not recorded.has_attitude and recorded.has(Source.RTK_HEADING)
        start = self.runs.aligned(values, by_antennas=by_antennas)
        run = self.runs.run(values, start, floors, self.weights, without)
        self.done += 1
        self.report(self.done)
        return run

    def weigh(self, run: FilterRun) -> None:
        """Set the weights for the next run."""
        before = self.weights[[white.number for white in run.white]]
        plain = np.sqrt([squared(white) for white in run.white] / before)
        scale = max(1.0, float(np.median(plain)))
        for white, off in zip(run.white, plain, strict=True):
            self.weights[white.number] = huber_weight(float(off), scale)

    def step(self, run: FilterRun, free: list[int], keep: Array | None = None) -> Array:
        """Return the Gauss-Newton step (7,) from a run; ``keep`` (M,) selects the rows to use."""
        rows = slice(None) if keep is None else keep
        slope, error = run.slope[rows][:, free], run.error[rows]
        prior = PRIOR_SIGMA[free] ** -2
        off = run.values[free] - self.anchor[free]
        change = np.zeros(len(PARAMETERS))
        information = slope.T @ slope + np.diag(prior)
        change[free] = -np.linalg.solve(information, slope.T @ error + prior * off)
        return change

    def over_scale(self, change: Array, run: FilterRun, free: list[int]) -> float:
        """Return the largest ratio of a change (7,) to its limit, or to its sigma if larger."""
        scale = LIMITS.copy()
        scale[free] = np.maximum(LIMITS[free], np.sqrt(_covariance(run, free).diagonal()))
        return float(np.max(np.abs(change / scale)))

    def settled(self, values: Array, free: list[int], floors: Floors, most: int) -> FilterRun:
        """Iterate until a step is small, or ``most`` times; return the run at the last values."""
        for _ in range(most):
            run = self.run(values, floors)
            self.weigh(run)
            change = self.step(run, free)
            if self.over_scale(change, run, free) < _SETTLED:
                break
            change /= max(1.0, float(np.max(np.abs(change) / _LARGEST_STEP)))
            values = values + change
        return self.run(values, floors)


def fit(runs: FlightRuns, hold: Collection[str], report: Report = lambda _: None) -> AircraftFit:
    """Fit all parameters that the flight observes, except those in ``hold``.

    Raises CalibrationError where the filter cannot run, or the fit does not converge.
    """
    first = values_of_config(runs.config)
    undetermined: dict[int, str] = {}
    if not runs.recorded.has(Source.RTK_VELOCITY):
        undetermined[DELAYS[Source.RTK_VELOCITY]] = "no rtk/vel in the bag"
    if not runs.recorded.has(Source.RTK_HEADING):
        undetermined |= dict.fromkeys(_HEADING, "no rtk/heading in the bag")
    search = _Search(runs, first, report)
    free = [
        k for k in range(len(PARAMETERS)) if k not in undetermined and PARAMETERS[k] not in hold
    ]
    values = first.copy()
    if AZIMUTH in free and runs.recorded.has_attitude:
        values[_HEADING] = _heading_guess(search, first)
        values = np.where(np.isin(np.arange(len(first)), free), values, first)
        search.anchor = values
    for floors, most in _COARSE:
        values = search.settled(values, free, floors, most).values
    run = search.settled(values, free, Floors(), _MOST_STEPS)
    if free and search.over_scale(search.step(run, free), run, free) > 1.0:
        raise CalibrationError(
            "the fit does not converge: check that the topics are those of one aircraft, and the "
            "IMU's axes those of base_link"
        )
    sigma = _sigma(search, run, free)
    why_not = _unobserved(run, free, sigma)
    determined = [k for k in free if k not in why_not]
    undetermined |= {k: f"{why}; fly {TABLE[PARAMETERS[k]].advice}" for k, why in why_not.items()}
    return AircraftFit(
        values=np.where(np.isin(np.arange(len(first)), determined), run.values, first),
        sigma=sigma,
        determined=tuple(PARAMETERS[k] for k in determined),
        undetermined={PARAMETERS[k]: reason for k, reason in sorted(undetermined.items())},
        first=first,
        before=search.run(first, Floors()),
        after=run,
    )


def _heading_guess(search: _Search, values: Array) -> tuple[float, float]:
    """Return the azimuth and delay with least scatter of headings about a yaw without them."""
    run = search.run(values, _COARSE[0][0], without=Source.RTK_HEADING)
    headings = [s for s in search.runs.recorded.aids if isinstance(s, HeadingSample)]
    first_ns = run.attitude_ns[0]
    times_s = np.array([sample.stamp_ns - first_ns for sample in headings]) * 1e-9
    azimuths = np.array([sample.heading_rad for sample in headings])
    azimuths += reported_direction_rad(search.runs.config)
    yaw_s = np.array([stamp_ns - first_ns for stamp_ns in run.attitude_ns]) * 1e-9
    yaw = np.unwrap(euler_from_quat(run.attitude_q_nb)[:, 2])
    candidates = []
    for delay_s in _TRIED_DELAYS_S.tolist():
        off = np.exp(1j * (azimuths - np.interp(times_s - delay_s, yaw_s, yaw)))
        middle = complex(np.mean(off))
        scatter = float(np.median(np.abs(np.angle(off * middle.conjugate()))))
        candidates.append((scatter, float(np.angle(middle)), delay_s))
    return min(candidates)[1:]


def _unobserved(run: FilterRun, free: list[int], sigma: Array) -> dict[int, str]:
    """Return the parameters that the flight does not observe, and why.

    They stay in the fit as unknowns: one that is held at a wrong value would make the others wrong
    while their sigmas stay small.
    """
    motion = _missing_motion(run)
    reasons = {k: motion[PARAMETERS[k]] for k in free if PARAMETERS[k] in motion}
    for k in free:
        if k not in reasons and not sigma[k] <= LIMITS[k]:
            text = f"{1e3 * sigma[k]:.2g} ms" if k in DELAYS.values() else f"{sigma[k]:.2g} m"
            text = f"{math.degrees(sigma[k]):.2g} deg" if k == AZIMUTH else text
            reasons[k] = f"known to {text} only"
    return reasons


def _covariance(run: FilterRun, free: list[int]) -> Array:
    """Return the covariance (p, p) of the free parameters, if the filter's noise is right."""
    slope = run.slope[:, free]
    return np.asarray(np.linalg.inv(slope.T @ slope + np.diag(PRIOR_SIGMA[free] ** -2)))


def _sigma(search: _Search, run: FilterRun, free: list[int]) -> Array:
    """Return the standard deviations (7,); nan if held.

    Each is the larger of two: that of the information matrix, enlarged where the innovations are
    larger than predicted, and that of the differences between the flight's parts (the jackknife).
    """
    sigma = np.full(len(PARAMETERS), np.nan)
    if free:
        foreseen = _covariance(run, free).diagonal() * max(1.0, float(np.mean(run.error**2)))
        part = np.minimum((PARTS * run.row_ns / (run.row_ns.max() + 1)).astype(int), PARTS - 1)
        changes = np.array([search.step(run, free, part != k)[free] for k in range(PARTS)])
        sigma[free] = np.sqrt(np.maximum(foreseen, (PARTS - 1) * np.var(changes, axis=0)))
    return sigma


def _missing_motion(run: FilterRun) -> dict[str, str]:
    """Return the parameters that the motion of a flight cannot observe, with what was missing.

    Standard deviations alone do not show that: over a hover that drifts by centimetres they shrink
    with time, because they assume that the receiver's errors are white noise.
    """

    def rms_about_mean(vectors: Array) -> float:
        return float(np.sqrt(np.mean(np.sum((vectors - vectors.mean(0)) ** 2, axis=1))))

    yaw = np.unwrap(euler_from_quat(run.attitude_q_nb)[:, 2])
    times_s = np.array([stamp - run.attitude_ns[0] for stamp in run.attitude_ns]) * 1e-9
    turned_rad = float(np.ptp(yaw))
    rate_rad_s = float(np.sqrt(np.mean(np.gradient(yaw, times_s) ** 2)))
    tilt_rad = rms_about_mean(matrix_from_quat(run.attitude_q_nb)[:, 2, :2])
    speed_m_s = rms_about_mean(run.velocity_n[:, :2])
    reasons: dict[str, str] = {}
    if turned_rad < _LEAST_TURNED_RAD:
        reason = f"the nose turned through {math.degrees(turned_rad):.0f} deg only"
        reasons |= dict.fromkeys(PARAMETERS[:2], reason)
    if tilt_rad < _LEAST_TILT_RAD:
        reasons["antenna_up"] = f"the tilt varied by {math.degrees(tilt_rad):.1f} deg rms only"
    if speed_m_s < _LEAST_SPEED_M_S:
        reason = f"the velocity varied by {speed_m_s:.1f} m/s rms only"
        reasons |= dict.fromkeys(_BY_SPEED, reason)
    if rate_rad_s < _LEAST_TURN_RATE_RAD_S:
        reasons["heading_delay"] = f"it turned at {math.degrees(rate_rad_s):.1f} deg/s rms only"
    return reasons


def final_biases(runs: FlightRuns, values: Array) -> Biases:
    """Return the IMU's biases at the end of another flight of the aircraft, ``values`` (7,)."""
    search = _Search(runs, values, lambda _done: None)
    return search.settled(values, [], Floors(), 1).biases  # again, with weights for outliers


def expected_biases(flights: Sequence[Biases]) -> tuple[Array, Array]:
    """Return the mean (2, 3) of several flights' biases and the sigma (2,) of the next flight's.

    Gyroscopes first. The three axes of a sensor have one spread. N flights tell it by
    ``n = 3 (N - 1)`` degrees of freedom: the next bias has Student's distribution, with the
    variance ``n / (n - 2)`` times that of a known spread, and the mean errs by an N-th of it.
    """
    found = np.array([biases.vector for biases in flights]).reshape(-1, 2, 3)
    squares = np.sum((found - found.mean(axis=0)) ** 2, axis=(0, 2))
    spread = squares / (3 * len(flights) - 5) * (1 + 1 / len(flights))
    own = np.mean([biases.covariance.diagonal() for biases in flights], axis=0)
    return found.mean(axis=0), np.sqrt(spread + own.reshape(2, 3).mean(axis=1))


class MountingLevel(NamedTuple):
    """Hold roll and pitch of the IMU's axes against the body's, FRD, rad."""

    angles_rad: Array  # (2,)
    sigma_rad: Array  # (2,)


def mounting_level(run: FilterRun, imu: Sequence[ImuSample], parts: int) -> MountingLevel | None:
    """Return roll and pitch of the mounting; None where there are too few autopilot attitudes.

    The flight is divided in ``parts`` to find the standard deviations.
    """
    stamps = np.array([sample.stamp_ns for sample in imu])
    at = np.searchsorted(stamps, run.attitude_ns).clip(0, len(imu) - 1)
    pairs = [
        (imu[k].autopilot_q_nb, q)
        for k, stamp_ns, q in zip(at, run.attitude_ns, run.attitude_q_nb, strict=True)
        if abs(int(stamps[k]) - stamp_ns) < _NEAR_NS and usable_attitude(imu[k].autopilot_q_nb)
    ]
    if len(pairs) < parts * _LEAST_PART:
        return None
    body_down = matrix_from_quat(np.array([a for a, _ in pairs]))[:, 2, :]
    imu_down = matrix_from_quat(np.array([b for _, b in pairs]))[:, 2, :]
    groups = np.array_split(np.arange(len(pairs)), parts)
    each = np.array([_turn(body_down[rows], imu_down[rows]) for rows in groups])
    sigma = np.hypot(each.std(axis=0, ddof=1) / math.sqrt(parts), run.tilt_sigma_rad)
    return MountingLevel(_turn(body_down, imu_down), sigma)


def _turn(body_down: Array, imu_down: Array) -> Array:
    """Return the least-squares turn (2,) about the first two axes; directions are (N, 3)."""
    x, y, z = imu_down.T
    zero = np.zeros_like(x)
    # phi x d = (phi_y z, -phi_x z, phi_x y - phi_y x) for phi_z = 0
    by_roll = np.stack([zero, -z, y], axis=-1).ravel()
    by_pitch = np.stack([z, zero, -x], axis=-1).ravel()
    design = np.stack([by_roll, by_pitch], axis=-1)
    return np.asarray(np.linalg.lstsq(design, (body_down - imu_down).ravel(), rcond=None)[0])

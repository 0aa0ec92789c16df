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
"""Fit the RTK antenna's lever arm, its stamps' delays, the IMU's tilt and the headings' offset.

The IMU's readings are integrated over windows of some seconds. Positions, velocities and headings
of the receiver differ from that path by errors of the window's start, which are projected out, and
by the unknowns, which all windows share.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Container, Sequence
from typing import Any, NamedTuple

import numpy as np

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.checks.inertial_checks import ImuMean, rpy_text
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import (
    azimuths,
    flu_from_frd,
    matrix_from_quat,
    matrix_from_rotvec,
    skew,
)
from tirgeo_ros.core.navigation.aiding.fusion import Delays
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding
from tirgeo_ros.core.types.measurements import Source

_GRAVITY_N = np.array((0.0, 0.0, 9.81))
_LEAST_ROWS = 8
_CUBIC, _QUADRATIC = 3, 2
Aids = tuple[Array, Array]  # times (N,), s, and values (N, 3) or headings (N,)
#: With fewer windows, their scatter gives no useful sigma.
_LEAST_WINDOWS = 6
_ONCE = 0.5  # weight of a value that is in two windows
#: Prior information (diagonal) keeps unobservable unknowns at 0. The velocities' extra delay is
#: small: a receiver measures both at once, and may smooth the velocity.
_PRIOR = np.diag(1 / np.array((10.0, 10.0, 10.0, 2.0, 0.05)) ** 2)

# Windows of a flight.
#: Blocks of a window, 4 s. With 2 s, delays and the lever arm have the same effect.
_BLOCKS = 80
_STEP = 40  # blocks from one window's start to the next one's
_WAIT = 10  # blocks to wait for measurements of a window that arrive late
_KEPT = 60  # windows: two minutes
_PATHS = 15  # windows kept to compute their equations again: half a minute
_AIDS = 800  # measurements that are kept: 40 s at 20 Hz
#: The equations are linear in the delay only within _LINEAR_S of the one that they are made for.
#: Larger delays are found by iteration, up to _LONGEST_S and in _STEPS.
_LINEAR_S, _LONGEST_S, _STEPS = 0.1, 1.0, 4
_AIDED = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
_AidQueue = deque[tuple[int, Array]]  # stamps without the configured delays, values (3,) or ()

# Findings.
_SIGMAS, _LEAST_M, _LEAST_S = 5.0, 0.15, 0.05
#: With few windows the sigmas vary: in 14 to 30 s of recorded flights, errors reach 7.4 sigmas.
_MANY, _SIGMAS_OF_FEW = 15, 8.0
#: A larger tilt or offset moves the map by more than three ellipses; autopilots err by 1 to 2 deg.
_TILTED_RAD, _OFF_DEG, _OFF_SIGMAS = math.radians(3.0), 2.5, 4.0
_LEVER = "aircraft.rtk_antenna_m"


class LeverChecks:
    """Compare the estimates of ``fit`` with the parameters.

    ``explicit`` are the parameters that were set, None if not known.
    """

    def __init__(self, config: EkfConfig, explicit: Collection[str] | None) -> None:
        self.fit = LeverArmFit(config)
        self._explicit, aircraft = explicit, config.aircraft
        self._lever_b, self._sigma_b = aircraft.rtk_lever_b, aircraft.rtk_lever_sigma_b
        self._is_set = bool(self._lever_b.any()) or _LEVER in (explicit or ())
        self._rotation_bi = aircraft.rotation_bi
        self._attitude_sigma_rad = math.radians(max(config.autopilot.attitude_sigma_deg[:2]))

    def findings(self, topics: Container[str]) -> list[Finding]:
        """Return findings on differences from the parameters; ``topics`` are those that arrive."""
        estimate = self.fit.estimate
        unset = self._unset(topics, estimate)
        if estimate is None:
            return [*unset, finding("imu_tilt:unknown")] if self.fit.blind else unset
        # A tilt of the IMU's axes against the autopilot's attitude turns the lever arm too.
        tilt_rad = float(np.linalg.norm(estimate.tilt_b))
        sigma_rad = math.hypot(estimate.tilt_sigma, self._attitude_sigma_rad)
        if tilt_rad >= max(_TILTED_RAD, _SIGMAS * sigma_rad):
            angles = rpy_text(matrix_from_rotvec(estimate.tilt_b), self._rotation_bi)
            return [finding("imu_tilt", tilt_deg=math.degrees(tilt_rad), angles=angles)]
        findings = unset or self._lever(estimate)
        delays = _delays(estimate)
        off_deg = math.degrees(estimate.heading_off)
        sigma_deg = math.degrees(estimate.heading_sigma)
        if not delays and abs(off_deg) >= max(_OFF_DEG, _OFF_SIGMAS * sigma_deg):
            heading = finding("heading_offset:motion", off_deg=off_deg, sigma_deg=sigma_deg)
            findings = [heading, *findings]
        return [*findings, *delays]

    def _unset(self, topics: Container[str], estimate: LeverArmEstimate | None) -> list[Finding]:
        """Return a finding if there are two antennas and nobody set their places."""
        if self._is_set or "rtk/heading" not in topics:
            return []
        suggestion = f"; this flight suggests about {_place(estimate)}" if estimate else ""
        case = "unread" if self._explicit is None else ""
        return [finding("antenna_place:unset", case, suggestion=suggestion)]

    def _lever(self, estimate: LeverArmEstimate) -> list[Finding]:
        off = estimate.lever_b - self._lever_b
        sigma = np.hypot(estimate.lever_sigma_b, self._sigma_b)
        if not (np.abs(off) > np.maximum(_sigmas(estimate) * sigma, _LEAST_M)).any():
            return []
        set_m = flu_from_frd(self._lever_b)
        turned = np.abs(set_m + flu_from_frd(estimate.lever_b)) < 0.5 * np.abs(set_m)
        turned &= np.abs(set_m) > _LEAST_M
        axes = " and ".join(np.array(("forward", "left", "up"))[turned])
        texts = {"place": _place(estimate), "configured": _numbers(set_m), "axes": axes}
        case = f"{'set' if self._is_set else ''} {'sign' if turned.any() else ''}"
        return [finding("antenna_place", case, **texts)]


def _sigmas(estimate: LeverArmEstimate) -> float:
    """Return the number of sigmas at which a difference is significant."""
    return _SIGMAS if estimate.windows >= _MANY else _SIGMAS_OF_FEW


def _delays(estimate: LeverArmEstimate) -> list[Finding]:
    """Return findings on stamps that are later, or earlier, than the parameters say."""
    delays = zip(estimate.delays_s.tolist(), estimate.delay_sigmas_s.tolist(), strict=True)
    return [
        finding(
            f"{topic.replace('/', '_')}_delay",
            topic=topic,
            size_s=abs(delay_s),
            way="later" if delay_s > 0 else "earlier",
            sigma_s=sigma_s,
        )
        for topic, (delay_s, sigma_s) in zip(("rtk/fix", "rtk/vel"), delays, strict=True)
        if abs(delay_s) >= max(_LEAST_S, _sigmas(estimate) * sigma_s)
    ]


def _place(estimate: LeverArmEstimate) -> str:
    sigma = ", ".join(f"{value:.2f}" for value in estimate.lever_sigma_b)
    place = _numbers(flu_from_frd(estimate.lever_b))
    return f"({place}) m forward, left, up (sigma {sigma})"


def _numbers(values: Array) -> str:
    return ", ".join(f"{value:+.2f}" for value in values)


class LeverArmFit:
    """Fit the unknowns to IMU blocks, fixed positions, velocities and headings, by windows.

    ``blind`` is True while no block had an attitude, and None before the first block.
    """

    def __init__(self, config: EkfConfig) -> None:
        delays = Delays.from_config(config)
        self._lever_b = config.aircraft.rtk_lever_b
        self._late_ns = {source: delays.aid_ns[source] - delays.imu_ns for source in _AIDED}
        self._blocks: list[ImuMean] = []
        self._aids: dict[Source, _AidQueue] = {source: deque(maxlen=_AIDS) for source in _AIDED}
        self._stretches: deque[tuple[int, int, ImuPath]] = deque(maxlen=_PATHS)  # from, to (ns)
        self._windows: deque[Normal] = deque(maxlen=_KEPT)
        self.blind: bool | None = None
        self._delay_s = 0.0  # the delay for which the windows' equations are made
        self._estimate: LeverArmEstimate | None = None
        self._fresh = True

    def take(self, source: Source, stamp_ns: int, value: Array) -> None:
        """Take a fixed position (m, in any NED plane), a velocity (m/s) or a heading (rad)."""
        self._aids[source].append((stamp_ns - self._late_ns[source], value))

    def block(self, block: ImuMean) -> None:
        """Take the next block of the IMU; windows begin with the autopilot's attitude."""
        self.blind = self.blind is not False and block.autopilot_q_nb is None
        if not block.joined or (not self._blocks and block.autopilot_q_nb is None):
            self._blocks = []
            return
        self._blocks.append(block)
        if len(self._blocks) == 1 + _BLOCKS + _WAIT:
            self._add_window(self._blocks[: 1 + _BLOCKS])
            self._blocks = self._blocks[_STEP:]

    def _add_window(self, blocks: list[ImuMean]) -> None:
        """Add a window, which begins at the end of the first block."""
        start = blocks[0]
        if start.autopilot_q_nb is None:
            return
        path = integrated(blocks[1:], start.autopilot_q_nb, self._lever_b)
        self._stretches.append((start.stamp_ns, blocks[-1].stamp_ns, path))
        self._windows.append(self._window(*self._stretches[-1], self._delay_s))
        self._fresh = False

    def _window(self, start_ns: int, end_ns: int, path: ImuPath, delay_s: float) -> Normal:
        """Return a window's equations, made for stamps that are late by ``delay_s``."""
        late_ns = round(delay_s * 1e9)
        inputs = []
        for aids in self._aids.values():
            inside = [aid for aid in aids if start_ns < aid[0] - late_ns < end_ns]
            times_s = np.array([stamp_ns - late_ns - start_ns for stamp_ns, _ in inside]) * 1e-9
            inputs.append((times_s, np.array([value for _, value in inside])))
        return Normal.of(path, *inputs)

    @property
    def estimate(self) -> LeverArmEstimate | None:
        """Return the present estimate; None while the flight is too short."""
        if not self._fresh:
            self._estimate, self._fresh = self._solved(), True
        return self._estimate

    def _solved(self) -> LeverArmEstimate | None:
        """Solve the windows; make them again for the estimated delay while that fits better."""
        estimate = solved(self._windows)
        for _ in range(_STEPS):
            if estimate is None or abs(estimate.delays_s[0]) < _LINEAR_S:
                break
            delay_s = self._delay_s + float(estimate.delays_s[0])
            windows = [self._window(*stretch, delay_s) for stretch in self._stretches]
            before, after = solved(list(self._windows)[-len(windows) :]), solved(windows)
            if before is None or after is None or abs(delay_s) > _LONGEST_S:
                break
            if after.misfit >= before.misfit:
                break
            self._delay_s, estimate = delay_s, after
            self._windows = deque(windows, maxlen=_KEPT)
        taken_s = np.array((self._delay_s, 0.0))  # the second one is already relative
        return estimate and estimate._replace(delays_s=estimate.delays_s + taken_s)


class LeverArmEstimate(NamedTuple):
    """Hold the estimate from a flight."""

    lever_b: Array  # (3,) m, FRD
    lever_sigma_b: Array  # (3,)
    delays_s: Array  # (2,) of stamps after measurements; the extra delay of velocities
    delay_sigmas_s: Array  # (2,)
    windows: int
    misfit: float  # product of the residual variances of positions and of velocities
    tilt_b: Array  # (3,) rotation vector from the IMU's axes to the body's, FRD, without yaw
    tilt_sigma: float
    heading_off: float  # headings less those of the motion, rad
    heading_sigma: float  # large without headings


def solved(windows: Sequence[Normal]) -> LeverArmEstimate | None:
    """Return the solution of consecutive windows, or None if there are too few.

    Each sigma is the larger of the one from the residuals and the one from the scatter between
    windows, because tilts have larger errors than white noise. The scatter is the sandwich
    estimator of White (Econometrica 48, 1980), with the covariance of neighbours, which overlap
    by half, as in Newey and West (Econometrica 55, 1987).
    """
    windows = [window for window in windows if window.degrees.any()]
    number = len(windows)
    if number < _LEAST_WINDOWS:
        return None
    matrices, rights, squares, degrees, turns, weighed = map(np.array, zip(*windows, strict=True))
    used = (degrees > 0).sum(axis=0) >= _LEAST_WINDOWS
    right = rights.sum(axis=0)
    alone = np.linalg.solve(matrices.sum(axis=0) + _PRIOR, right[..., None])[..., 0]
    rest = np.maximum(squares.sum(axis=0) - (right * alone).sum(axis=1), 1e-12)
    variances = rest / np.maximum(degrees.sum(axis=0) - 4, 1)  # of one value about the best fit
    weights = np.where(used, _ONCE / variances, 0.0)
    matrix = np.einsum("k,wkij->wij", weights, matrices)
    right = np.einsum("k,wki->wi", weights, rights)
    inverse = np.linalg.inv(matrix.sum(axis=0) + _PRIOR)
    solution = inverse @ right.sum(axis=0)
    residual = right - matrix @ solution
    shared = residual[1:].T @ residual[:-1]
    spread = residual.T @ residual + 0.5 * (shared + shared.T)  # Bartlett's weight
    scatter = inverse @ spread @ inverse * (number / (number - 4))
    sigma = np.sqrt(np.maximum(inverse.diagonal(), scatter.diagonal()))
    misfit = float(np.prod(variances[used]))
    turned = turns @ np.append(-solution, 1.0)  # (W, 2, 4)
    tilt_b, tilt_sigma, off, off_sigma = _mounted(turned, degrees, weights * weighed)
    return LeverArmEstimate(
        lever_b=solution[:3],
        lever_sigma_b=sigma[:3],
        delays_s=-solution[3:],
        delay_sigmas_s=sigma[3:],
        windows=number,
        misfit=misfit,
        tilt_b=tilt_b,
        tilt_sigma=tilt_sigma,
        heading_off=off,
        heading_sigma=off_sigma,
    )


def _mounted(turned: Array, degrees: Array, weights: Array) -> tuple[Array, float, float, float]:
    """Return the tilt and the headings' offset, with sigmas, from turns (W, 2, 4) of windows.

    The tilt is a median, because an autopilot's attitude errs under strong acceleration.
    """
    kind = int(degrees[:, 1].sum() >= degrees[:, 0].sum())
    sines = turned[degrees[:, kind] > 0, kind, :3]
    sine_b = np.median(sines, axis=0) * (1.0, 1.0, 0.0)  # gravity shows no yaw
    size = float(np.linalg.norm(sine_b))
    tilt_b = sine_b * (math.asin(min(size, 1.0)) / max(size, 1e-9))
    tilt_sigma = float(np.linalg.norm(sines.std(axis=0))) / math.sqrt(_ONCE * len(sines))
    total = max(float(weights.sum()), 1e-9)
    off = float((weights * turned[..., 3]).sum()) / total
    scatter = math.sqrt(((weights * (turned[..., 3] - off)) ** 2).sum() / _ONCE) / total
    return tilt_b, tilt_sigma, off, max(scatter, total**-0.5)


class Normal(NamedTuple):
    """Hold one window's normal equations: those of positions, then those of velocities."""

    matrices: Array  # (2, 5, 5)
    rights: Array  # (2, 5)
    squares: Array  # (2,)
    degrees: Array  # (2,) of freedom; 0 where there are no equations
    #: (2, 4, 6) times [-unknowns, 1]: sine of the IMU's turn (3,), FRD; offset of the headings
    turns: Array = np.zeros((2, 4, 6))
    weights: Array = np.zeros(2)  # of the headings

    @classmethod
    def of(
        cls, path: ImuPath, positions: Aids, velocities: Aids, headings: Aids | None = None
    ) -> Normal:
        """Return the equations for aids of a window: times of the path (N,) and values (N, 3).

        Positions are in any NED plane.
        """
        off_rad = math.nan
        if headings is not None and len(headings[0]):
            yaw_rad = np.unwrap(azimuths(path.rotation_nb[:, :, 0]))
            along = np.interp(headings[0], path.middles_s, yaw_rad)
            off_rad = float(np.angle(np.exp(1j * (headings[1] - along)).mean()))
        both = [_rows(path, *positions, 0, off_rad), _rows(path, *velocities, 1, off_rad)]
        return cls(*map(np.array, zip(*both, strict=True)))


def _rows(
    path: ImuPath, times_s: Array, values_n: Array, kind: int, off_rad: float
) -> tuple[Any, ...]:
    """Return the fields of ``Normal`` for one ``kind`` of aids: positions (0) or velocities (1).

    The unknowns of the window's start are projected out. All fields are zero with too few values,
    or with times that do not increase.
    """
    number = len(times_s)
    if number < _LEAST_ROWS or not (np.diff(times_s) > 0).all():
        return np.zeros((5, 5)), np.zeros(5), 0.0, 0, np.zeros((4, 6)), 0.0
    middles_s = path.middles_s
    lever, antenna = _between(middles_s, path.rotation_nb, times_s), path.antenna_velocity_n
    moved, powers = path.position_n, _CUBIC
    if kind:
        lever = lever @ skew(_between(middles_s, path.rate_b, times_s))
        moved, antenna, powers = path.velocity_n, path.antenna_acceleration_n, _QUADRATIC
    moved = _between(path.times_s, moved, times_s)
    late = _between(middles_s, antenna, times_s)
    design = np.zeros((number, 3, 5))
    design[:, :, :3], design[:, :, 3], design[:, :, 4] = lever, late, kind * late
    scaled = 2 * (times_s - times_s.mean()) / (times_s[-1] - times_s[0])
    columns = [np.kron((scaled**k)[:, None], np.eye(3)) for k in range(powers + 1)]
    # A heading error rotates the whole path.
    turned = np.stack((-moved[:, 1], moved[:, 0], np.zeros(number)), axis=1)
    basis, upper = np.linalg.qr(np.hstack([*columns, turned.reshape(-1, 1)]))
    rows, values = design.reshape(3 * number, 5), (values_n - moved).ravel()
    parts = basis.T @ np.column_stack((rows, values))
    rows, values = rows - basis @ parts[:, :5], values - basis @ parts[:, 5]
    power, half_s = 2 - kind, 0.5 * (times_s[-1] - times_s[0])  # of the acceleration's columns
    lacking = np.linalg.solve(upper[:-1, :-1], parts[:-1])[3 * power : 3 * power + 3]
    force_n = path.velocity_n[-1] / path.times_s[-1] - _GRAVITY_N
    tilt = path.rotation_nb[0].T @ skew(force_n) * (power / half_s**power / (force_n @ force_n))
    weight = 0.0 if math.isnan(off_rad) else float(upper[-1, -1] ** 2)
    turns = np.vstack((tilt @ lacking, -parts[-1] * upper[-1, -1] / max(weight, 1e-9)))
    turns[3, 5] += off_rad if weight else 0.0
    degrees = 3 * number - basis.shape[1]
    return rows.T @ rows, rows.T @ values, float(values @ values), degrees, turns, weight


def _between(grid_s: Array, values: Array, times_s: Array) -> Array:
    """Return values (N, ...), given at the times of a grid, interpolated linearly."""
    at = np.clip(np.searchsorted(grid_s, times_s), 1, len(grid_s) - 1)
    share = (times_s - grid_s[at - 1]) / (grid_s[at] - grid_s[at - 1])
    share = share.reshape(-1, *[1] * (values.ndim - 1))
    return np.asarray((1 - share) * values[at - 1] + share * values[at])


class ImuPath(NamedTuple):
    """Hold the IMU's readings of a window, integrated from zero, at N instants.

    Attitude, rate and the antenna's motion are those in the middle of each block; the IMU's
    velocity and position are those at its end.
    """

    times_s: Array  # (N,) ends of the blocks
    rotation_nb: Array  # (N, 3, 3)
    rate_b: Array  # (N, 3) rad/s
    velocity_n: Array  # (N, 3) m/s
    position_n: Array  # (N, 3) m
    antenna_velocity_n: Array  # (N, 3) m/s
    antenna_acceleration_n: Array  # (N, 3) m/s2

    @property
    def middles_s(self) -> Array:
        """Return (N,) the times of the blocks' middles."""
        return np.asarray(self.times_s - 0.5 * np.diff(self.times_s, prepend=0.0))


def integrated(blocks: Sequence[ImuMean], q_nb: Array, lever_b: Array) -> ImuPath:
    """Return the path over consecutive blocks; ``q_nb`` (4,) is the attitude before the first.

    ``lever_b`` (3,) is an estimate of the lever arm; its motion is small compared with the path.
    """
    forces, rates = np.array([b.force_b for b in blocks]), np.array([b.rate_b for b in blocks])
    steps_s = np.array([b.step_s for b in blocks])
    halves = matrix_from_rotvec(0.5 * steps_s[:, None] * rates)
    rotation = matrix_from_quat(q_nb)
    middles = []
    for half in halves:
        middle = np.dot(rotation, half)
        rotation = np.dot(middle, half)
        middles.append(middle)
    middle_nb = np.array(middles)
    acceleration = np.einsum("nij,nj->ni", middle_nb, forces) + _GRAVITY_N
    change = acceleration * steps_s[:, None]
    velocity = np.cumsum(change, axis=0)
    position = np.cumsum((velocity - 0.5 * change) * steps_s[:, None], axis=0)
    times_s = np.cumsum(steps_s)
    swing = np.einsum("nij,nj->ni", middle_nb, np.cross(rates, lever_b))
    antenna = velocity - 0.5 * change + swing
    pull = acceleration + np.gradient(swing, times_s - 0.5 * steps_s, axis=0)
    return ImuPath(times_s, middle_nb, rates, velocity, position, antenna, pull)

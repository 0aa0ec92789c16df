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
"""Fit corrections of the boresight and related parameters to sightings, robustly, with covariance.

Gauss-Newton over the pixel residuals, each weighted with its expected covariance. During the
iteration Cauchy weights keep wrong clicks from dominating. At the end sightings that are off by
more than ``MOST_SIGMAS`` are left out, and reported.

Pose errors are correlated in time, so that two clicks in one picture give hardly more information
than one. The parameters' covariance models them as a Gauss-Markov process. With H the sum of
J' S^-1 J and g a sighting's J' S^-1, it is H^-1 (sum of g_i E_ij g_j') H^-1 with E_ij the expected
covariance of two residuals. If the residuals are larger than expected, it is scaled accordingly.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.boresight_model import (
    PARAMETERS,
    PointSighting,
    Sight,
    SightedFlight,
    corrected_pose,
    sights,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import locate
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.core.types.errors import CalibrationError

#: Largest sigma with which a parameter counts as found: rad, s, m. An angle of 0.3 deg is 0.2 m on
#: the ground at 40 m; near a picture's edge, 0.35 rad off the axis, so is 0.8 deg of roll; 20 ms
#: are the same angle at 15 deg/s. The rotation about the vertical may be less certain, because the
#: yaw that is found with it compensates for it at the tilts flown.
LIMITS = np.array([*np.radians([0.8, 0.3, 0.3]), 0.02, np.radians(0.5), 0.2])
#: Correlation time of pose errors (s): the gimbal's wander is a few seconds, the filter's heading
#: error longer.
POSE_ERROR_S = 5.0
#: Limit that one of 2000 good clicks exceeds with 8 % probability (chi-square, two degrees of
#: freedom: 4.5 is 4e-5 for each).
MOST_SIGMAS = 4.5
_MEDIAN_SIGMAS = math.sqrt(2 * math.log(2))  # median distance of a two-dimensional normal error
_CAUCHY_SIGMAS = 2.4  # 95 % of the efficiency of least squares if no click is wrong
#: Information of a weak prior (per LIMITS squared): it only keeps the normal equations solvable.
_PRIOR = 1e-6
_MOST_STEPS = 30
#: From this step on steps are halved: the slope by the latency is a mean, and may oscillate.
_DAMPED_FROM = 8
_SETTLED = 1e-3  # of LIMITS
#: Largest change of latency: further from a picture no poses are kept.
_MOST_LATENCY_S = 0.8
LEAST_SHARE = 2 / 3  # of the observations that must agree
_LATENCY = PARAMETERS.index("latency")

# The least that a fit needs, and advice if a parameter cannot be found.
#: With fewer, a wrong point or a wrong pose cannot be distinguished from a boresight.
LEAST_POINTS, LEAST_PICTURES = 3, 3
#: A parameter that was not asked for is estimated only if all sigmas are then within this share of
#: LIMITS: it must add little to the others' uncertainty, compared with their 0.3 deg.
UNASKED_SHARE = 1 / 3
#: A parameter belongs to the inseparable ones if its part of the worst direction is larger than
#: this share of the largest part.
_PART = 0.2
#: Parameter -> why it cannot be found, and what to do; the first that applies is given.
_ADVICE = {
    "gimbal_north": (
        "the camera's tilt hardly varied",
        "fly with at least two tilts 20 deg apart, or --hold it",
    ),
    "ground_height": (
        "the points are seen from about the same height and angle",
        "fly at two heights or two tilts, or --hold ground_height",
    ),
    "latency": (
        "the camera moved in the same way in all pictures, or hardly at all",
        "fly legs in several directions and click during turns too, or --hold latency",
    ),
}
_FEW = "too few observations", "click more points, in more pictures and all over the picture"


@dataclass(frozen=True)
class BoresightFit:
    """Hold the parameters' corrections estimated from sightings, with covariance and residuals."""

    correction: Array  # (6,) of PARAMETERS from their present values: rad, s, m; 0 if held
    covariance: Array  # (p, p) of the estimated parameters, in their order
    estimated: tuple[str, ...]
    used: BoolArray  # (N,) False for sightings that were left out as outliers
    before: Array  # (N, 2) residuals, px; nan if the point is not in view
    after: Array  # (N, 2)
    noise_factor: float  # ratio of actual to expected residuals
    by_point: dict[str, Array]  # (6,) the correction without the sightings of that point

    @property
    def sigma(self) -> dict[str, float]:
        """Return the standard deviation of each estimated parameter, rad, s or m."""
        return dict(zip(self.estimated, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))


class _Normal(NamedTuple):
    """Hold the normal equations in units of LIMITS, and their parts by sighting."""

    weighted: Array  # (N, p, 2) g: design' S^-1, zero where unused
    parts: Array  # (N, p, p) g design
    gradient: Array  # (N, p) g residual

    def information(self, keep: BoolArray | slice = slice(None)) -> Array:
        """Return the information (p, p) of some sightings and the weak prior."""
        return np.asarray(self.parts[keep].sum(0) + _PRIOR * np.eye(self.parts.shape[1]))

    def solved(self, without: BoolArray | None = None) -> Array:
        """Return the step (p,) from all sightings, or from those not in ``without`` (N,)."""
        keep = np.ones(len(self.parts), bool) if without is None else ~without
        return np.asarray(np.linalg.solve(self.information(keep), self.gradient[keep].sum(0)))


def fit(
    flight: SightedFlight, sightings: Sequence[PointSighting], estimated: Sequence[str]
) -> BoresightFit:
    """Fit the parameters in ``estimated``, in any order; hold the others.

    Raises CalibrationError if the sightings do not agree or the fit does not converge.
    """
    chosen = sorted(map(PARAMETERS.index, estimated))
    names = tuple(PARAMETERS[k] for k in chosen)
    start = sights(flight, sightings, np.zeros(len(PARAMETERS)))
    correction, sight, used = _solved(flight, sightings, chosen)
    normal = _normal(sight, chosen, used.astype(float))
    freedom = max(2 * int(used.sum()) - len(chosen), 1)
    factor = math.sqrt(float((_sigmas(sight)[used] ** 2).sum()) / freedom)
    ids = np.array([sighting.id for sighting in sightings])
    by_point = {}
    for name in dict.fromkeys(ids.tolist()):
        by_point[name] = correction.copy()  # one step from the common solution
        by_point[name][chosen] += normal.solved(ids == name) * LIMITS[chosen]
    return BoresightFit(
        correction=correction,
        covariance=_covariance(sight, normal, sightings, chosen) * max(1.0, factor) ** 2,
        estimated=names,
        used=used,
        before=start.residual,
        after=sight.residual,
        noise_factor=factor,
        by_point=by_point,
    )


def foreseen(
    flight: SightedFlight, sightings: Sequence[PointSighting], estimated: Sequence[str]
) -> Array:
    """Predict the covariance (p, p) of a fit whose residuals are all as expected.

    Its rows are in the order of PARAMETERS; rad, s, m.
    """
    chosen = sorted(map(PARAMETERS.index, estimated))
    sight = sights(flight, sightings, np.zeros(len(PARAMETERS)))
    normal = _normal(sight, chosen, np.isfinite(sight.residual[:, 0]).astype(float))
    return _covariance(sight, normal, sightings, chosen)


def _normal(sight: Sight, chosen: list[int], weights: Array) -> _Normal:
    """Return the normal equations of the sightings with positive weight (N,)."""
    use = weights > 0
    design = np.where(use[:, None, None], sight.design[:, :, chosen] * LIMITS[chosen], 0.0)
    residual = np.where(use[:, None], sight.residual, 0.0)
    covariance = np.where(use[:, None, None], sight.covariance, np.eye(2))
    weighted = weights[:, None, None] * np.swapaxes(np.linalg.solve(covariance, design), 1, 2)
    return _Normal(weighted, weighted @ design, np.einsum("npi,ni->np", weighted, residual))


def _sigmas(sight: Sight) -> Array:
    """Return (N,) residuals in their own standard deviations; nan where there is none."""
    in_view = np.isfinite(sight.residual[:, 0])
    covariance = np.where(in_view[:, None, None], sight.covariance, np.eye(2))
    whitened = np.linalg.solve(covariance, sight.residual[:, :, None])[:, :, 0]
    return np.asarray(np.sqrt((sight.residual * whitened).sum(1)))


def _scale(sigmas: Array) -> float:
    """Return the ratio of median to expected residuals, at least 1.

    Raises CalibrationError if there are none: no point is in view.
    """
    if np.isnan(sigmas).all():
        raise CalibrationError(
            "no observed point is in view at the pose of its picture: check that the stamps are "
            "those of this bag's pictures, and boresight_rpy_deg to within some degrees"
        )
    return max(1.0, float(np.nanmedian(sigmas)) / _MEDIAN_SIGMAS)


def _solved(
    flight: SightedFlight, sightings: Sequence[PointSighting], chosen: list[int]
) -> tuple[Array, Sight, BoolArray]:
    """Return the correction (6,), the sightings under it, and which of them it is fitted to (N,).

    Iterate with Cauchy weights first, then with least squares over the sightings that agree, which
    are selected again in every step.
    """
    correction, used = np.zeros(len(PARAMETERS)), np.zeros(len(sightings), bool)
    sight = sights(flight, sightings, correction)
    for robust in (True, False):
        for k in range(_MOST_STEPS):
            sigmas = _sigmas(sight)
            before, used = used, sigmas <= MOST_SIGMAS * _scale(sigmas)  # nan compares false
            ratio = np.nan_to_num(sigmas, nan=np.inf) / (_CAUCHY_SIGMAS * _scale(sigmas))
            if not robust and used.sum() < LEAST_SHARE * len(used):
                raise CalibrationError(
                    f"only {used.sum()} of {len(used)} observations agree with each other: check "
                    "their ids and stamps, the survey's heights (ellipsoidal) and the camera's "
                    "calibration"
                )
            weights = 1 / (1 + ratio**2) if robust else used.astype(float)
            step = _normal(sight, chosen, weights).solved() * (1.0 if k < _DAMPED_FROM else 0.5)
            correction[chosen] += step * LIMITS[chosen]
            change_s = correction[_LATENCY]
            if not abs(change_s) <= _MOST_LATENCY_S:
                raise CalibrationError(
                    f"latency: the fit leads to {flight.latency_s + change_s:.2f} s, which is "
                    "impossible; check that observations have the stamps of the pictures' headers"
                )
            sight = sights(flight, sightings, correction)
            if np.abs(step).max() < _SETTLED and (robust or (used == before).all()):
                break
        else:
            if robust:
                raise CalibrationError(
                    "the fit does not converge: check that most observations have the right id, "
                    "stamp and pixel"
                )
    return correction, sight, used & np.isfinite(sight.residual[:, 0])


def _covariance(
    sight: Sight, normal: _Normal, sightings: Sequence[PointSighting], chosen: list[int]
) -> Array:
    """Return the covariance (p, p) of the chosen parameters, rad, s, m."""
    inverse = np.linalg.inv(normal.information())
    used = normal.parts.any(axis=(1, 2))
    stamps_s = np.array([sighting.stamp_ns for sighting in sightings]) * 1e-9
    weighted, times = normal.weighted[used], stamps_s[used]
    alike = np.exp(-np.abs(times[:, None] - times) / POSE_ERROR_S)
    lasting = weighted @ sight.systematic[used]  # (n, p, 6)
    spread = np.einsum("npi,nqi->pq", lasting, np.tensordot(alike, lasting, 1))
    spread += (weighted @ sight.noise[used] @ np.swapaxes(weighted, 1, 2)).sum(0)
    # Directions that are not observed have the prior's own variance.
    covariance = inverse @ (spread + _PRIOR * np.eye(len(inverse))) @ inverse
    return np.asarray(covariance * np.outer(LIMITS[chosen], LIMITS[chosen]))


def ground_errors(
    flight: SightedFlight,
    plane: TangentPlane,
    sightings: Sequence[PointSighting],
    corrections: Mapping[str, Array],
) -> Array:
    """Return (N, 2) located minus surveyed, north and east, m; nan if a pixel meets no ground.

    The ground is level at each point's own height. ``corrections`` (6,) are by point id.
    """
    errors = np.full((len(sightings), 2), np.nan)
    for k, sighting in enumerate(sightings):
        posed = corrected_pose(flight, sighting.stamp_ns, corrections[sighting.id])
        if posed is None:
            continue
        point_n = sighting.point_n - [0.0, 0.0, corrections[sighting.id][-1]]
        height_m = float(plane.geodetic_from_ned(point_n)[2])
        located_n, _ = locate(flight.camera, posed[0], sighting.uv[None], plane, height_m)
        errors[k] = located_n[0, :2] - point_n[:2]
    return errors


def rmse_m(errors: Array) -> float:
    """Return the root mean square of the known horizontal errors (N, 2), m; nan without any."""
    squares = (errors**2).sum(1)
    return math.sqrt(float(np.nanmean(squares))) if np.isfinite(squares).any() else math.nan


@dataclass(frozen=True)
class Ambiguity:
    """Hold parameters that have the same effect on the picture in this flight."""

    names: tuple[str, ...]
    reason: str
    advice: str

    def __str__(self) -> str:
        """Return one line for the operator."""
        names = " and ".join([", ".join(self.names[:-1]), self.names[-1]]).removeprefix(" and ")
        apart = "cannot be separated" if len(self.names) > 1 else "cannot be found"
        return f"{names} {apart}: {self.reason}; {self.advice}"


def check_numbers(sightings: Sequence[PointSighting]) -> None:
    """Raise CalibrationError if there are too few points or pictures."""
    points = len({sighting.id for sighting in sightings})
    pictures = len({sighting.stamp_ns for sighting in sightings})
    if points < LEAST_POINTS or pictures < LEAST_PICTURES:
        raise CalibrationError(
            f"{points} surveyed points in {pictures} pictures with a pose: at "
            f"least {LEAST_POINTS} points and {LEAST_PICTURES} pictures are needed, better 20 "
            "points in three pictures each, all over the picture and the flight"
        )


def doubt(estimated: Sequence[str], covariance: Array, share: float = 1.0) -> Ambiguity | None:
    """Return the parameters that a covariance (p, p) leaves undetermined; None if there are none.

    A parameter is found if its standard deviation is within ``share`` of LIMITS.
    """
    names = [name for name in PARAMETERS if name in estimated]
    limits = LIMITS[[PARAMETERS.index(name) for name in names]] * share
    relative = covariance / np.outer(limits, limits)
    if (np.diag(relative) <= 1).all():
        return None
    worst = np.abs(np.linalg.eigh(relative)[1][:, -1])
    alike = tuple(n for n, part in zip(names, worst, strict=True) if part > _PART * worst.max())
    reason, advice = next((_ADVICE[name] for name in _ADVICE if name in alike), _FEW)
    return Ambiguity(alike, reason, advice)

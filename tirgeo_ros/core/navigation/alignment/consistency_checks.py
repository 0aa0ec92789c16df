"""Check that the contents of a window agree, so that one wrong measurement spoils no alignment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.config import AutopilotConfig
from tirgeo_ros.core.frames.heading import wrap_pi
from tirgeo_ros.core.frames.rotations import matrix_from_rotvec
from tirgeo_ros.core.navigation.aiding.dual_antenna_heading import LARGE_TURN_RAD
from tirgeo_ros.core.navigation.alignment.batch_least_squares import (
    AlignmentObservation,
    ObservationKind,
    WindowFit,
)
from tirgeo_ros.core.navigation.alignment.imu_preintegration import PreintegratedImu
from tirgeo_ros.core.types.arrays import Array

#: Squared misfit per degree of freedom: six sigma is not chance.
_LARGEST_DISTANCE = 36.0
#: Up to here a linear filter is right: its error, of second order, is a hundredth of the tilt.
_LARGEST_TILT_SIGMA_RAD = np.radians(1.0)
#: Headings are compared before the tilt is known: ten times the default sigma floor.
_HEADINGS_APART_RAD = np.radians(6.0)
#: Mean force over a second or more of flight: between half of gravity and twice it.
_LEAST_FORCE_M_S2, _LARGEST_FORCE_M_S2 = 4.9, 19.6
_AUTOPILOT_TILT_RAD = np.radians(10.0)  # possible error of an autopilot in a hard turn
_AUTOPILOT_SIGMAS = 5.0
_LOOK_AT_ANTENNAS = (
    ": antennas swapped, or is aircraft.second_antenna_m elsewhere? (a compass that errs by so "
    "much: autopilot.attitude_sigma_deg)"
)
_UNITS = {
    ObservationKind.POSITION: "m",
    ObservationKind.VELOCITY: "m/s",
    ObservationKind.AZIMUTH: "deg",
}


class InsufficientError(Exception):
    """Report that something needed is missing; ``stage`` says how far the alignment came."""

    def __init__(self, reason: str, stage: int) -> None:
        """Set the reason and the stage.

        Stages: 0 velocity, 1 position, 2 rtk/heading, 3 any heading, 4 precision, 5 motion.
        """
        super().__init__(reason)
        self.stage = stage


class InconsistentError(Exception):
    """Report a contradiction in the measurements; ``lasting``: waiting does not resolve it."""

    def __init__(self, reason: str, *, lasting: bool = False) -> None:
        super().__init__(reason)
        self.lasting = lasting


def furthest(lacks: Sequence[InsufficientError]) -> InsufficientError:
    """Return what was missing where the alignment came furthest; of equals the first."""
    return max(lacks, key=lambda lack: lack.stage)


def agreeing(
    window: PreintegratedImu, headings: Sequence[AlignmentObservation]
) -> tuple[list[AlignmentObservation], Array]:
    """Return the headings that agree with most others, and a first attitude (3, 3) with them.

    The attitude is found as if at rest. Raises DoubtError where fewer than two thirds agree, or
    the mean force is not gravity.
    """
    level_nb = _shortest_turn(_down_b(window), np.array([0.0, 0.0, 1.0]))
    at = window.at([o.stamp_ns for o in headings])
    turned = [level_nb @ window.to_end[k] @ o.arm_b for k, o in zip(at, headings, strict=True)]
    turns = [o.value[0] - np.arctan2(d[1], d[0]) for o, d in zip(headings, turned, strict=True)]
    apart = np.abs(wrap_pi(np.subtract.outer(turns, turns)))
    middle = int(np.argmin(np.median(apart, axis=1)))
    near = apart[middle] < _HEADINGS_APART_RAD
    if near.sum() * 3 < 2 * len(near):
        raise InconsistentError("the headings of rtk/heading disagree with each other")
    start_nb = matrix_from_rotvec(np.array([0.0, 0.0, turns[middle]])) @ level_nb
    return [o for o, good in zip(headings, near, strict=True) if good], start_nb


def _down_b(window: PreintegratedImu) -> Array:
    """Return the unit vector (3,) against the mean force: down, as if at rest."""
    force = float(np.linalg.norm(window.velocity[0])) / float(window.before_s[0])
    if not _LEAST_FORCE_M_S2 < force < _LARGEST_FORCE_M_S2:
        raise InconsistentError(f"imu/data: a mean force of {force:.1f} m/s2 is not gravity")
    return np.asarray(-window.velocity[0] / np.linalg.norm(window.velocity[0]))


def _shortest_turn(a: Array, b: Array) -> Array:
    """Return the smallest rotation (3, 3) that takes unit vector ``a`` to unit vector ``b``."""
    across = np.cross(a, b)
    angle = np.arctan2(np.linalg.norm(across), a @ b)
    if np.linalg.norm(across) < 1e-9:  # parallel or opposite: take any axis across
        across = np.cross(a, [1.0, 0, 0] if abs(a[0]) < 0.9 else [0, 1.0, 0])
    return matrix_from_rotvec(angle * across / np.linalg.norm(across))


def checked(found: WindowFit, seen: Sequence[AlignmentObservation]) -> WindowFit:
    """Return the fit, where it is near every measurement and the tilt is known well enough.

    Raises DoubtError or LackingError.
    """
    worst = int(np.argmax(found.distances))
    if found.distances[worst] > _LARGEST_DISTANCE:
        raise InconsistentError(
            _misfit(seen[worst], found.residuals[worst], found.distances[worst])
        )
    if not found.settled:
        raise InconsistentError("imu/data does not fit the motion measured")
    if found.rotation_nb[2, 2] <= 0:
        raise InconsistentError("imu/data says upside down: check its axes and signs")
    if found.tilt_sigma_rad > _LARGEST_TILT_SIGMA_RAD:
        raise InsufficientError("the motion is not measured well enough to find the tilt", 4)
    return found


def _misfit(wrong: AlignmentObservation, residual: Array, distance: float) -> str:
    size = float(np.linalg.norm(residual))
    size = np.degrees(size) if wrong.kind is ObservationKind.AZIMUTH else size
    sigmas = np.sqrt(distance)
    return (
        f"imu/data and {wrong.name} differ by {size:.2g} {_UNITS[wrong.kind]} ({sigmas:.0f} sigma)"
    )


def differences(
    found: WindowFit, hint_nb: Array, autopilot: AutopilotConfig
) -> dict[str, InconsistentError]:
    """Return doubts where the fit differs too much from the autopilot's attitude (3, 3).

    The keys are "tilt" and "heading".
    """
    tilt = float(np.arccos(np.clip(found.rotation_nb[2] @ hint_nb[2], -1, 1)))
    heading = abs(float(wrap_pi(_nose(found.rotation_nb) - _nose(hint_nb))))
    own = np.sqrt(found.covariance[2, 2])
    sigma = np.hypot(np.radians(autopilot.attitude_sigma_deg[2]), own)
    text = "{} and the orientation in imu/data differ by {:.0f} deg"
    out = {}
    if tilt > _AUTOPILOT_TILT_RAD:
        out["tilt"] = InconsistentError(text.format("the tilt found", np.degrees(tilt)))
    if heading > _AUTOPILOT_SIGMAS * sigma:
        told = text.format("rtk/heading", np.degrees(heading)) + _LOOK_AT_ANTENNAS
        out["heading"] = InconsistentError(told, lasting=heading > LARGE_TURN_RAD)
    return out


def _nose(rotation_nb: Array) -> float:
    return float(np.arctan2(rotation_nb[1, 0], rotation_nb[0, 0]))

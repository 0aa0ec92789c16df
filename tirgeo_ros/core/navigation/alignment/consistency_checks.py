"""Check that the contents of a window agree, so that one wrong measurement spoils no alignment."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.config import AutopilotConfig
from tirgeo_ros.core.frames.rotations import azimuth, matrix_from_rotvec, wrap_pi
from tirgeo_ros.core.navigation.aiding.aid_status import NEVER_NS
from tirgeo_ros.core.navigation.aiding.gnss_antenna import LARGE_TURN_RAD
from tirgeo_ros.core.navigation.alignment.batch_least_squares import (
    AlignmentObservation,
    ObservationKind,
    WindowFit,
)
from tirgeo_ros.core.navigation.alignment.imu_preintegration import PreintegratedImu
from tirgeo_ros.core.types.arrays import Array, BoolArray

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
_DOUBT_ENDS_NS = 1_000_000_000
_LOOK_AT_ANTENNAS = (
    ": are the antennas swapped, or aircraft.second_antenna_m wrong? (for a compass with such "
    "errors set autopilot.attitude_sigma_deg)"
)
_UNITS = {
    ObservationKind.POSITION: "m",
    ObservationKind.VELOCITY: "m/s",
    ObservationKind.AZIMUTH: "deg",
}


#: Stages of an alignment that lacks nothing but motion, and of one that nothing is lacking.
MOTION_STAGE, CONTRADICTION = 5, 6
#: Stages of one that lacks a heading.
HEADING_STAGES = (2, 3)


class NotAlignedError(Exception):
    """Report why a window gives no alignment, and how far it came.

    Missing by stage: 0 velocity, 1 position, 2 rtk/heading, 3 any heading, 4 precision, 5 motion.
    At 6 the measurements contradict each other; ``lasting``: waiting does not help.
    """

    def __init__(self, reason: str, stage: int = CONTRADICTION, *, lasting: bool = False) -> None:
        super().__init__(reason)
        self.stage, self.lasting = stage, lasting


class Recurrence:
    """Measure for how long a doubt has come again and again, with pauses of a second at most."""

    def __init__(self) -> None:
        self._since_ns = self._latest_ns = NEVER_NS

    def again_s(self, now_ns: int) -> float:
        """Note the doubt; return for how long it has recurred, s."""
        if now_ns - self._latest_ns > _DOUBT_ENDS_NS:
            self._since_ns = now_ns
        self._latest_ns = now_ns
        return (now_ns - self._since_ns) * 1e-9


def furthest(errors: Sequence[NotAlignedError]) -> NotAlignedError:
    """Return the error of the alignment that came furthest; of equals the first."""
    return max(errors, key=lambda error: error.stage)


def central(apart: Array, limit: float) -> tuple[int, BoolArray]:
    """Return the most central of n things ``apart`` (n, n), and which (n,) are near it."""
    middle = int(np.argmin(np.median(apart, axis=1)))
    return middle, apart[middle] < limit


def agreeing(
    window: PreintegratedImu, headings: Sequence[AlignmentObservation]
) -> tuple[list[AlignmentObservation], Array]:
    """Return the headings that agree with most others, and a first attitude (3, 3) with them.

    The attitude is found as if at rest. Raises NotAlignedError where fewer than two thirds agree,
    or the mean force is not gravity.
    """
    against_b, length_s = -window.velocity[0], float(window.before_s[0])  # the mean force
    force = float(np.linalg.norm(against_b)) / length_s
    if not _LEAST_FORCE_M_S2 < force < _LARGEST_FORCE_M_S2:
        raise NotAlignedError(f"imu/data: a mean force of {force:.1f} m/s2 is not gravity")
    down_b = against_b / np.linalg.norm(against_b)
    level_nb = _shortest_turn(down_b, np.array([0.0, 0.0, 1.0]))
    at = window.at([o.stamp_ns for o in headings])
    turned = [level_nb @ window.to_end[k] @ o.arm_b for k, o in zip(at, headings, strict=True)]
    turns = [o.value[0] - azimuth(d) for o, d in zip(headings, turned, strict=True)]
    apart = np.abs(wrap_pi(np.subtract.outer(turns, turns)))
    middle, near = central(apart, _HEADINGS_APART_RAD)
    if near.sum() * 3 < 2 * len(near):
        raise NotAlignedError("the headings of rtk/heading disagree with each other")
    start_nb = matrix_from_rotvec(np.array([0.0, 0.0, turns[middle]])) @ level_nb
    return [o for o, good in zip(headings, near, strict=True) if good], start_nb


def _shortest_turn(a: Array, b: Array) -> Array:
    """Return the smallest rotation (3, 3) that takes unit vector ``a`` to unit vector ``b``."""
    across = np.cross(a, b)
    angle = np.arctan2(np.linalg.norm(across), a @ b)
    if np.linalg.norm(across) < 1e-9:  # parallel or opposite: take any axis across
        across = np.cross(a, [1.0, 0, 0] if abs(a[0]) < 0.9 else [0, 1.0, 0])
    return matrix_from_rotvec(angle * across / np.linalg.norm(across))


def checked(found: WindowFit, seen: Sequence[AlignmentObservation]) -> WindowFit:
    """Return a fit that is near all measurements and knows the tilt; raises NotAlignedError."""
    worst = int(np.argmax(found.distances))
    if found.distances[worst] > _LARGEST_DISTANCE:
        wrong, size = seen[worst], float(np.linalg.norm(found.residuals[worst]))
        size = np.degrees(size) if wrong.kind is ObservationKind.AZIMUTH else size
        off = f"{size:.2g} {_UNITS[wrong.kind]} ({np.sqrt(found.distances[worst]):.0f} sigma)"
        raise NotAlignedError(f"imu/data and {wrong.name} differ by {off}")
    if not found.settled:
        raise NotAlignedError("imu/data does not fit the motion measured")
    if found.rotation_nb[2, 2] <= 0:
        raise NotAlignedError("imu/data is upside down: check its axes and signs")
    if found.tilt_sigma_rad > _LARGEST_TILT_SIGMA_RAD:
        raise NotAlignedError("the motion is not measured well enough to find the tilt", 4)
    return found


def tilt_between(a_nb: Array, b_nb: Array) -> float:
    """Return the angle between the verticals of two attitudes (3, 3), rad."""
    return float(np.arccos(np.clip(a_nb[2] @ b_nb[2], -1, 1)))


def differences(
    found: WindowFit, hint_nb: Array, autopilot: AutopilotConfig
) -> dict[str, NotAlignedError]:
    """Return doubts on "tilt" and "heading" where they differ from the autopilot's (3, 3)."""
    tilt = tilt_between(found.rotation_nb, hint_nb)
    heading = abs(float(wrap_pi(azimuth(found.rotation_nb[:, 0]) - azimuth(hint_nb[:, 0]))))
    own = np.sqrt(found.covariance[2, 2])
    sigma = np.hypot(np.radians(autopilot.attitude_sigma_deg[2]), own)
    text = "{} and the orientation in imu/data differ by {:.0f} deg"
    out = {}
    if tilt > _AUTOPILOT_TILT_RAD:
        out["tilt"] = NotAlignedError(text.format("the tilt found", np.degrees(tilt)))
    if heading > _AUTOPILOT_SIGMAS * sigma:
        told = text.format("rtk/heading", np.degrees(heading)) + _LOOK_AT_ANTENNAS
        out["heading"] = NotAlignedError(told, lasting=heading > LARGE_TURN_RAD)
    return out

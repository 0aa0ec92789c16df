"""Report set-up errors from the pictures' motion, compared with that of the camera's poses."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.camera.projection_covariance import CHI2_95
from tirgeo_ros.core.checks.motion_fit import (
    BORESIGHT,
    FOCAL,
    FROM_S,
    HEIGHT,
    LATENCY,
    TO_S,
    MotionFit,
)
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.types.finding import Finding, Severity

#: The places of latency, focal length, height and boresight in a fit.
_PARTS = slice(0, 1), slice(1, 2), slice(2, 3), BORESIGHT
#: An error is significant beyond this many of its standard deviations. Errors of picture pairs are
#: correlated where a flight turns all the time: 3.8 sigmas were seen without an error.
_SIGNIFICANT = 6.0
#: Leaving the error must also make the rest larger by this factor: without an error 1.19 was seen,
#: and 1.26 of the latency in a straight flight.
_IMPROVEMENT = (1.5, 1.1, 1.1, 1.1)  # latency, focal length, height, boresight
#: The rest with good poses is at most this. With more, as where a filter starts without headings,
#: an error must explain more: a factor of 1.29 was seen without an error.
_GOOD_PX = 1.0
#: Least errors: s, two logarithms, three angles (rad).
_LEAST = np.array((0.03, 0.05, 0.12, *np.radians((2.5, 2.5, 2.5))))
_LEAST_HEIGHT_M = 2.0
_WRONG = 0.15  # as a logarithm: a larger error makes the map wrong, not only displaced
#: Share of the pairs' motion, and least size, of a rest that no fitted error explains.
_UNEXPLAINED, _LEAST_UNEXPLAINED_PX = 0.3, 3.0
#: With a larger rest, or so near to the end of its range, a latency stands for another fault.
_DOUBTFUL_PX, _END_S = 1.5, 0.06
_TELLING = 40  # pairs in which a flight that tells the latency has told it
_UNTOLD = Finding(
    "video_latency_untold",
    Severity.NOTE,
    "the flight does not tell the latency of the video: the camera hardly turns",
    "overlay_node video_latency_s",
    "turn a few times, or measure it with tirgeo calibrate boresight",
)
_MOST_ELLIPSES = 3.0  # 95 % ellipses, of an error that makes the map wrong


def motion_findings(
    fit: MotionFit, latency_s: float, focal_px: float, lens: str, ground: str
) -> list[Finding]:
    """Return the findings of a fit; ``lens`` and ``ground`` name the parameters it corrects.

    ``ground`` is empty if no parameter sets the ground's height.
    """
    if fit.turned:
        return [_turned(fit)]
    rest_px = max(_LEAST_UNEXPLAINED_PX, _UNEXPLAINED * max(fit.moved, fit.before))
    doubtful = fit.after > _DOUBTFUL_PX or not FROM_S + _END_S < fit.values[0] < TO_S - _END_S
    if fit.after > rest_px or (doubtful and _is_significant(fit, LATENCY, math.inf)):
        return [_unexplained(fit)]
    errors = (*_of_camera(fit, latency_s, focal_px, lens), *_of_poses(fit, ground))
    off_rad = _MOST_ELLIPSES * math.sqrt(CHI2_95) * fit.angle_sigma_rad
    off_s = off_rad * focal_px * fit.step_s / max(fit.moved, 1e-3)
    found = []
    for one, (check, where, evidence, mend) in enumerate(errors):
        if where and _is_significant(fit, one):
            limit = (off_s, _WRONG, _WRONG, off_rad)[one]
            is_wrong = np.abs(fit.values[_PARTS[one]]).max() > limit
            severity = Severity.STOP if is_wrong else Severity.CAUTION
            text = f"{evidence} ({fit.pairs} pairs of pictures)"
            found.append(Finding(check, severity, text, where, mend))
    unclear = fit.assumed[LATENCY] or abs(fit.values[LATENCY]) > _LEAST[LATENCY]
    if unclear and not _is_significant(fit, LATENCY) and fit.pairs >= _TELLING:
        found.append(_UNTOLD)
    return found


def _unexplained(fit: MotionFit) -> Finding:
    """Return the finding of motion that no fitted error explains."""
    evidence = (
        f"the pictures move differently from the camera's poses: by {fit.moved:.1f} px from one "
        f"to the next, {fit.before:.1f} px beside what the poses say"
    )
    where = "gimbal/joint_states, thermal/image_raw"
    mend = (
        "check that the pictures are stamped by the aircraft's clock, that the video "
        "is live, and that the gimbal's angles have the right axes and signs"
    )
    return Finding("picture_motion", Severity.STOP, evidence, where, mend)


def _turned(fit: MotionFit) -> Finding:
    """Return the finding of pictures that are mirrored or upside down."""
    evidence = f"the pictures are {fit.turned}: turned back they move as the camera's poses"
    where = "thermal/image_raw"
    mend = "turn them in the camera or its driver, before the lens is calibrated"
    return Finding("picture_turned", Severity.STOP, evidence, where, mend)


def _of_camera(
    fit: MotionFit, latency_s: float, focal_px: float, lens: str
) -> Sequence[tuple[str, str, str, str]]:
    """Return check, parameter, evidence and what to do for latency and focal length."""
    sigmas = fit.sigmas
    true_s = latency_s + fit.values[LATENCY]
    true_px = focal_px * math.exp(fit.values[FOCAL])
    lag = f"{true_s:.3f} s (sigma {sigmas[LATENCY]:.3f}), not by {latency_s:.3f}"
    focal = f"{true_px:.0f} px (sigma {true_px * sigmas[FOCAL]:.0f}), not {focal_px:.0f}"
    return (
        (
            "video_latency",
            "overlay_node video_latency_s",
            f"the pictures lag the camera's poses by {lag}",
            f"set it to {true_s:.3f}, or run tirgeo calibrate boresight",
        ),
        (
            "focal_length",
            lens,
            f"the pictures turn as if the focal length were {focal}",
            "run tirgeo calibrate lens, with the pictures' size and zoom",
        ),
    )


def _of_poses(fit: MotionFit, ground: str) -> Sequence[tuple[str, str, str, str]]:
    """Return the same for height and boresight; no parameter if the height's error is small."""
    sigmas = fit.sigmas
    true_m = fit.above_m * math.exp(fit.values[HEIGHT])
    off_m = fit.above_m - true_m
    if abs(off_m) <= max(_LEAST_HEIGHT_M, _SIGNIFICANT * fit.height_sigma_m):
        ground = ""
    off_deg = np.degrees(flu_from_frd(fit.values[BORESIGHT])).tolist()
    angles = ", ".join(f"{angle:+.1f}" for angle in off_deg)
    height = f"{true_m:.0f} m (sigma {true_m * sigmas[HEIGHT]:.1f}), not from {fit.above_m:.0f} m"
    aside = f"roll, pitch, yaw {angles}; sigma {math.degrees(sigmas[BORESIGHT].max()):.1f}"
    move = f"{'raise' if off_m > 0 else 'lower'} the ground by {abs(off_m):.0f} m"
    return (
        (
            "ground_by_motion",
            ground,
            f"the ground moves as if seen from {height} above it",
            f"{move}: heights are ellipsoidal, not above sea level, as in rtk/fix",
        ),
        (
            "boresight_by_motion",
            "gimbal_node boresight_rpy_deg",
            f"the camera looks {math.hypot(*off_deg):.1f} deg away from its poses ({aside})",
            "add these angles, or run tirgeo calibrate boresight; or the principal point is wrong",
        ),
    )


def _is_significant(fit: MotionFit, one: int, good_px: float = _GOOD_PX) -> bool:
    """Return whether the latency, focal length, height or boresight (0 to 3) is wrong."""
    part = _PARTS[one]
    least = np.maximum(_LEAST[part], _SIGNIFICANT * fit.sigmas[part])
    sure = (np.abs(fit.values[part]) > least) & ~np.array(fit.assumed[part])
    enough = _IMPROVEMENT[one] * fit.after + max(fit.after - good_px, 0.0)
    return bool(sure.any() and fit.without[one] > enough)

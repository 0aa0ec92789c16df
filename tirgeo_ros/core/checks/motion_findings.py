"""Report set-up errors from the pictures' motion, compared with that of the camera's poses."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.checks.motion_fit import BORESIGHT, FOCAL, HEIGHT, LATENCY, MotionFit
from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.types.finding import Finding, Severity

#: An error is significant beyond this many of its standard deviations. Errors of picture pairs are
#: correlated where a flight turns all the time: 3.8 sigmas were seen without an error.
_SIGNIFICANT = 6.0
#: Leaving the error must also make the rest larger by this factor: 1.19 was seen without an error.
_IMPROVEMENT = (1.25, 1.1, 1.1, 1.1)  # latency, focal length, height, boresight
#: The rest with good poses is at most this. With more, as where a filter starts without headings,
#: an error must explain more: a factor of 1.29 was seen without an error.
_GOOD_PX = 1.0
#: Least errors: s, two logarithms, three angles (rad).
_LEAST = np.array((0.03, 0.05, 0.12, *np.radians((2.5, 2.5, 2.5))))
_LEAST_HEIGHT_M = 2.0
_WRONG = 0.15  # as a logarithm: a larger error makes the map wrong, not only displaced
#: Share of the pairs' motion, and least size, of a rest that no fitted error explains.
_UNEXPLAINED, _LEAST_UNEXPLAINED_PX = 0.3, 3.0


def motion_findings(
    fit: MotionFit, latency_s: float, focal_px: float, lens: str, ground: str
) -> list[Finding]:
    """Return the findings of a fit; ``lens`` and ``ground`` name the parameters it corrects.

    ``ground`` is empty if no parameter sets the ground's height.
    """
    if fit.after > max(_LEAST_UNEXPLAINED_PX, _UNEXPLAINED * max(fit.moved, fit.before)):
        return [_unexplained(fit)]
    errors = (*_of_camera(fit, latency_s, focal_px, lens), *_of_poses(fit, ground))
    found = []
    for one, (check, where, evidence, mend) in enumerate(errors):
        if where and _is_significant(fit, one):
            is_wrong = one in (FOCAL, HEIGHT) and abs(fit.values[one]) > _WRONG
            severity = Severity.STOP if is_wrong else Severity.CAUTION
            text = f"{evidence} ({fit.pairs} pairs of pictures)"
            found.append(Finding(check, severity, text, where, mend))
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
    return Finding("picture_motion", Severity.CAUTION, evidence, where, mend)


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
            f"{move}: heights are ellipsoidal, not above sea level",
        ),
        (
            "boresight_by_motion",
            "gimbal_node boresight_rpy_deg",
            f"the camera looks {math.hypot(*off_deg):.1f} deg away from its poses ({aside})",
            "add these angles, or run tirgeo calibrate boresight; or the principal point is wrong",
        ),
    )


def _is_significant(fit: MotionFit, one: int) -> bool:
    """Return whether the latency, focal length, height or boresight (0 to 3) is wrong."""
    part = BORESIGHT if one == 3 else slice(one, one + 1)
    least = np.maximum(_LEAST[part], _SIGNIFICANT * fit.sigmas[part])
    sure = (np.abs(fit.values[part]) > least) & ~np.array(fit.assumed[part])
    enough = _IMPROVEMENT[one] * fit.after + max(fit.after - _GOOD_PX, 0.0)
    return bool(sure.any() and fit.without[one] > enough)

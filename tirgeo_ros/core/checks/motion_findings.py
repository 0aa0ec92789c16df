"""Report set-up errors from the pictures' motion, compared with that of the camera's poses."""

from __future__ import annotations

import math

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
_LEAST_LATENCY_S, _LEAST_FOCAL, _LEAST_HEIGHT = 0.03, 0.05, 0.12  # the last two are logarithms
_LEAST_HEIGHT_M = 2.0
_LEAST_BORESIGHT_RAD = math.radians(2.5)
_WRONG = 0.15  # as a logarithm: a larger error makes the map wrong, not only displaced
#: Share of the pairs' motion, and least size, of a rest that no fitted error explains.
_UNEXPLAINED, _LEAST_UNEXPLAINED_PX = 0.3, 3.0


def motion_findings(
    fit: MotionFit, latency_s: float, focal_px: float, lens: str, ground: str
) -> list[Finding]:
    """Return the findings of a fit; ``lens`` and ``ground`` name the parameters it corrects.

    ``ground`` is empty if no parameter sets the ground's height.
    """
    if _unexplained(fit):
        return [_other_motion(fit)]
    found = []
    if _is_significant(fit, LATENCY, _LEAST_LATENCY_S):
        found.append(_latency(fit, latency_s))
    if _is_significant(fit, FOCAL, _LEAST_FOCAL):
        found.append(_focal(fit, focal_px, lens))
    above_m = fit.above_m * math.exp(fit.values[HEIGHT])
    least_m = max(_LEAST_HEIGHT_M, _SIGNIFICANT * fit.height_sigma_m)
    if (
        ground
        and _is_significant(fit, HEIGHT, _LEAST_HEIGHT)
        and abs(above_m - fit.above_m) > least_m
    ):
        found.append(_height(fit, above_m, ground))
    if _is_boresight_significant(fit):
        found.append(_boresight(fit))
    return found


def _unexplained(fit: MotionFit) -> bool:
    least = max(_LEAST_UNEXPLAINED_PX, _UNEXPLAINED * max(fit.moved, fit.before))
    return fit.after > least


def _is_significant(fit: MotionFit, one: int, least: float) -> bool:
    value, sigma = abs(fit.values[one]), fit.sigmas[one]
    sure = value > max(least, _SIGNIFICANT * sigma) and not fit.assumed[one]
    return bool(sure and _improves_fit(fit, one))


def _improves_fit(fit: MotionFit, one: int) -> bool:
    return fit.without[one] > _IMPROVEMENT[one] * fit.after + max(fit.after - _GOOD_PX, 0.0)


def _is_boresight_significant(fit: MotionFit) -> bool:
    angles, sigmas = fit.values[BORESIGHT], fit.sigmas[BORESIGHT]
    sure = np.abs(angles) > np.maximum(_LEAST_BORESIGHT_RAD, _SIGNIFICANT * sigmas)
    sure &= ~np.array(fit.assumed[BORESIGHT])
    return bool(sure.any() and _improves_fit(fit, 3))


def _seen(fit: MotionFit) -> str:
    return f"({fit.pairs} pairs of pictures)"


def _other_motion(fit: MotionFit) -> Finding:
    evidence = (
        f"the pictures move otherwise than the camera's poses: by {fit.moved:.1f} px from one to "
        f"the next, {fit.before:.1f} px beside what the poses say {_seen(fit)}"
    )
    return Finding(
        "picture_motion",
        Severity.CAUTION,
        evidence,
        "gimbal/joint_states, thermal/image_raw",
        "see that the pictures' stamps are of the aircraft's clock, that the video is live, and "
        "that the gimbal's angles have the right axes and signs",
    )


def _latency(fit: MotionFit, latency_s: float) -> Finding:
    true_s, sigma_s = latency_s + fit.values[LATENCY], fit.sigmas[LATENCY]
    evidence = (
        f"the pictures lag the camera's poses by {true_s:.3f} s (sigma {sigma_s:.3f}), not by "
        f"{latency_s:.3f} {_seen(fit)}"
    )
    mend = f"set it to {true_s:.3f}, or run tirgeo calibrate boresight"
    return Finding(
        "video_latency", Severity.CAUTION, evidence, "overlay_node video_latency_s", mend
    )


def _focal(fit: MotionFit, focal_px: float, lens: str) -> Finding:
    value = fit.values[FOCAL]
    true_px = focal_px * math.exp(value)
    evidence = (
        f"the pictures turn as with a focal length of {true_px:.0f} px (sigma "
        f"{true_px * fit.sigmas[FOCAL]:.0f}), not {focal_px:.0f} {_seen(fit)}"
    )
    severity = Severity.STOP if abs(value) > _WRONG else Severity.CAUTION
    mend = "run tirgeo calibrate lens, with the pictures' size and zoom"
    return Finding("focal_length", severity, evidence, lens, mend)


def _height(fit: MotionFit, above_m: float, ground: str) -> Finding:
    evidence = (
        f"the ground passes as from {above_m:.0f} m (sigma {above_m * fit.sigmas[HEIGHT]:.1f}), "
        f"not from {fit.above_m:.0f} m above it {_seen(fit)}"
    )
    severity = Severity.STOP if abs(fit.values[HEIGHT]) > _WRONG else Severity.CAUTION
    off_m = fit.above_m - above_m
    mend = (
        f"{'raise' if off_m > 0 else 'lower'} the ground by {abs(off_m):.0f} m: heights are "
        "ellipsoidal, not above sea level"
    )
    return Finding("ground_by_motion", severity, evidence, ground, mend)


def _boresight(fit: MotionFit) -> Finding:
    off_deg = np.degrees(flu_from_frd(fit.values[BORESIGHT])).tolist()
    size = math.hypot(*off_deg)
    worst = math.degrees(fit.sigmas[BORESIGHT].max())
    numbers = ", ".join(f"{angle:+.1f}" for angle in off_deg)
    evidence = (
        f"the camera looks {size:.1f} deg aside of its poses (roll, pitch, yaw {numbers}; sigma "
        f"{worst:.1f}) {_seen(fit)}"
    )
    mend = "add these angles, or run tirgeo calibrate boresight; or the principal point is wrong"
    return Finding(
        "boresight_by_motion",
        Severity.CAUTION,
        evidence,
        "gimbal_node boresight_rpy_deg",
        mend,
    )

"""Sum up an evaluation in one sentence: whether errors are as predicted, else their cause.

The ellipses are consistent unless the number of surveyed points inside would occur by chance in at
most one experiment of a hundred: the binomial probability with 95 %, counted in pictures instead
of observations, because those of one picture share its pose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.tools.evaluate.result import MethodResult
from tirgeo_ros.tools.evaluate.systematic import LEAST_PICTURES, find_systematic

_ELSEWHERE_M = 500.0  # median error of every method: no drone's camera is so far off
_CONFIDENCE, _CHANCE = 0.95, 0.01
_ROUNDING = 1e-9  # of a share times some thousands
#: What each cause of an error looks like, with its size, and what to do about it.
_CAUSES = {
    "boresight": ("the camera were turned by {:.2f} deg", "run calibrate boresight"),
    "latency": (
        "pictures were {:+.3f} s later than assumed",
        "run calibrate boresight",
    ),
    "datum": (
        "all were {:+.2f} m east, {:+.2f} m north",
        "are the survey and the RTK base in one datum?",
    ),
    "height": (
        "the ground were taken {:+.1f} m too high",
        "look at ground_height_m or dem of overlay_node: are all heights ellipsoidal?",
    ),
}


def verdict(methods: Sequence[MethodResult]) -> str:
    """Return the sentence on the last method, the best."""
    best = methods[-1]
    located = best.located
    if not located:
        why = best.refused[0].reason if best.refused else "no surveyed point was observed"
        return f"none of {len(best.refused)} could be located: {why} ({best.method})"
    elsewhere = place_note(methods)
    if elsewhere:
        return elsewhere
    inside = sum(one.is_inside for one in located)
    pictures = len({one.stamp_ns for one in located})
    mean_m = f"{float(best.errors.distance_m.mean()):.2f} m off on average"
    why = "" if is_honest(inside / len(located), pictures) else _why(best, pictures)
    return (
        f"{inside} of {len(located)} lie in their ellipse of 95 %, {mean_m}{why} ({best.method})"
    )


def place_note(methods: Sequence[MethodResult]) -> str:
    """Return a note if the survey seems to be of another place, else nothing."""
    errors_m = [one.errors.distance_m for one in methods if one.located]
    usual_m = min((float(np.median(some)) for some in errors_m), default=0.0)
    if usual_m < _ELSEWHERE_M:
        return ""
    return (
        f"the observed points lie {usual_m / 1000:.3g} km from where the survey has them: are "
        "these the survey and the observations of this flight, in WGS84?"
    )


def is_honest(share: float, pictures: int) -> bool:
    """Return whether this share inside is consistent with ellipses of 95 %."""
    from scipy.special import bdtr  # noqa: PLC0415  slow to import

    inside = math.floor(share * pictures + _ROUNDING)
    return bool(bdtr(inside, pictures, _CONFIDENCE) >= _CHANCE)


def _why(best: MethodResult, pictures: int) -> str:
    """Return what the errors have in common, and what to do about it."""
    if pictures < LEAST_PICTURES:
        return ": too few pictures to tell what they share"
    moves = [one.moves for one in best.located if one.moves is not None]
    systematic = find_systematic(moves, pictures)
    if systematic is None:
        return (
            ", each in another direction: the sensors' sigmas are too small, or points were "
            "confused"
        )
    cause, size = systematic.causes[0], systematic.size.tolist()
    if cause == "boresight":
        size = [math.degrees(math.hypot(*size))]
    mends = "; or ".join(dict.fromkeys(_CAUSES[one][1] for one in systematic.causes))
    return f": systematic, as if {_CAUSES[cause][0].format(*size)}; {mends}"

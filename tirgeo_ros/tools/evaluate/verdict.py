"""Sum up an evaluation in one sentence: whether errors are as predicted, else their cause.

The ellipses are consistent unless the number of surveyed points inside would occur by chance in at
most one experiment of a hundred: the binomial probability with 95 %. Else each cause's size is
fitted by least squares to the offsets in pixels. It is systematic if an F test says that its size
is not chance (1 %), and if it explains half of the mean square. Of several causes the one with the
least BIC is named, and those within 6 of it: a smaller difference is no strong evidence (Kass and
Raftery, Bayes Factors, JASA 1995, section 3.2). Observations of one picture share its pose, so the
tests count pictures.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.evaluate.result import MethodResult, PixelMoves

_ELSEWHERE_M = 500.0  # median error of every method: no drone's camera is so far off
_CONFIDENCE, _CHANCE = 0.95, 0.01
#: With fewer pictures a common error cannot be recognised.
_LEAST_PICTURES = 3
_LEAST_SHARE, _STRONG_BIC = 0.5, 6.0
#: px2; lower limit of a mean square, finer than a click, so that the logarithm is finite.
_LEAST_SQUARE_PX2 = 1e-6
_ROUNDING = 1e-9  # of a share times some thousands
#: What each cause of an error looks like, with its size, and what to do about it.
_CAUSES = {
    "boresight": ("the camera were turned by {:.2f} deg", "run calibrate boresight"),
    "latency": ("pictures were {:+.3f} s later than assumed", "run calibrate boresight"),
    "datum": ("all were {:+.2f} m east, {:+.2f} m north", "are survey and RTK base in one datum?"),
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
    if pictures < _LEAST_PICTURES:
        return ": too few pictures to find a common cause"
    moves = [one.moves for one in best.located if one.moves is not None]
    systematic = find_systematic(moves, pictures)
    if systematic is None:
        return (
            ", each in a different direction: the sensors' sigmas are too small, or "
            "points were mixed up"
        )
    causes, size = systematic[0], systematic[1].tolist()
    if causes[0] == "boresight":
        size = [math.degrees(math.hypot(*size))]
    mends = "; or ".join(dict.fromkeys(_CAUSES[one][1] for one in causes))
    return f": systematic, as if {_CAUSES[causes[0]][0].format(*size)}; {mends}"


def find_systematic(moves: Sequence[PixelMoves], pictures: int) -> tuple[list[str], Array] | None:
    """Return what the observations of that many pictures share; None if it may be chance.

    It is the causes, the likeliest first, then those about as likely, and the size of the first.
    """
    from scipy.special import fdtrc  # noqa: PLC0415  slow to import

    if pictures < _LEAST_PICTURES or not moves:
        return None
    offsets = np.concatenate([one.offset_px for one in moves])
    numbers = 2 * pictures
    before = max(float(np.mean(offsets**2)), _LEAST_SQUARE_PX2)
    found = []
    for cause in _CAUSES:
        if not all(cause in one.by for one in moves):
            continue
        design = np.concatenate([one.by[cause] for one in moves])
        size, _, rank, _ = np.linalg.lstsq(design, offsets, rcond=None)
        after = max(float(np.mean((offsets - design @ size) ** 2)), _LEAST_SQUARE_PX2)
        free = numbers - len(size)
        if rank < len(size) or after > (1 - _LEAST_SHARE) * before:
            continue
        if fdtrc(rank, free, (before - after) / rank / (after / free)) < _CHANCE:
            bic = numbers * math.log(after) + rank * math.log(numbers)
            found.append((bic, cause, size))
    if not found:
        return None
    found.sort(key=lambda one: one[0])
    causes = [cause for bic, cause, _ in found if bic - found[0][0] < _STRONG_BIC]
    return causes, found[0][2]

"""Sum up an evaluation in one sentence: whether errors are as predicted, else the cause.

The ellipses are consistent unless the number of surveyed points inside would occur by chance in at
most one experiment of a hundred: the binomial probability with 95 %, counted in pictures instead
of observations, because those of one picture share its pose. If they are not, ``find_systematic``
finds what the offsets share.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.tools.evaluate.result import MethodResult
from tirgeo_ros.tools.evaluate.systematic import (
    LEAST_PICTURES,
    Cause,
    Systematic,
    find_systematic,
)

_ELSEWHERE_M = 500.0  # median error of every method: no drone's camera is so far off
_CONFIDENCE, _CHANCE = 0.95, 0.01
_ROUNDING = 1e-9  # of a share times some thousands
_EIGHTHS = (
    *("north", "north-east", "east", "south-east"),
    *("south", "south-west", "west", "north-west"),
)
#: Advice for each cause.
_MENDS = {
    Cause.BORESIGHT: "run calibrate boresight",
    Cause.LATENCY: "run calibrate boresight",  # which estimates the latency too
    Cause.DATUM: "are the survey and the RTK base in one datum?",
    Cause.HEIGHT: "look at ground_height_m or dem of overlay_node: are all heights ellipsoidal?",
}


def verdict(methods: Sequence[MethodResult]) -> str:
    """Return the sentence on the last method, the best."""
    best = methods[-1]
    located = best.located
    if not located:
        why = best.refused[0].reason if best.refused else "no surveyed point was observed"
        return f"none of {len(best.refused)} could be located: {why} ({best.method})"
    elsewhere = place_notes(methods)
    if elsewhere:
        return elsewhere[0]
    inside = sum(one.is_inside for one in located)
    lead = f"{inside} of {len(located)} lie in their ellipse of 95 %"
    pictures = len({one.stamp_ns for one in located})
    if is_honest(inside / len(located), pictures):
        mean_m = float(best.errors.distance_m.mean())
        return f"{lead}, {_length(mean_m)} off on average ({best.method})"
    return f"{lead}, {_offset_words(best, pictures)} ({best.method})"


def place_notes(methods: Sequence[MethodResult]) -> list[str]:
    """Return a note if the survey seems to be of another place, else []."""
    errors_m = [[one.distance_m for one in method.located] for method in methods]
    usual_m = min((float(np.median(some)) for some in errors_m if some), default=0.0)
    if usual_m < _ELSEWHERE_M:
        return []
    note = (
        f"the observed points lie {usual_m / 1000:.3g} km from where the survey has them: are "
        "these the survey and the observations of this flight, in WGS84?"
    )
    return [note]


def is_honest(share: float, pictures: int) -> bool:
    """Return whether this share inside is consistent with ellipses of 95 %."""
    from scipy.special import bdtr  # noqa: PLC0415  slow to import

    inside = math.floor(share * pictures + _ROUNDING)
    return bool(bdtr(inside, pictures, _CONFIDENCE) >= _CHANCE)


def _offset_words(best: MethodResult, pictures: int) -> str:
    moves = [one.moves for one in best.located if one.moves is not None]
    systematic = find_systematic(moves, pictures) if moves else None
    if systematic is not None:
        mends = "; or ".join(dict.fromkeys(_MENDS[cause] for cause in systematic.causes))
        return f"{_cause_words(systematic, best)}: systematic; {mends}"
    mean_m = _length(float(best.errors.distance_m.mean()))
    if pictures < LEAST_PICTURES:
        return f"{mean_m} off on average: too few pictures to tell what they share"
    return (
        f"{mean_m} off on average, each in another direction: the sensors' sigmas are too small, "
        "or points were confused"
    )


def _cause_words(systematic: Systematic, best: MethodResult) -> str:
    """Return size and direction of the likeliest cause, in words."""
    mean_m = _length(float(best.errors.distance_m.mean()))
    size, cause = systematic.size, systematic.causes[0]
    if cause is Cause.DATUM:
        return f"mean offset {_on_ground(size)}"
    if cause is Cause.LATENCY:
        late_s = float(size[0])
        wrong = f"{abs(late_s):.3f} s too {'small' if late_s > 0 else 'large'}"
        return f"{mean_m} off along the camera's way, as if video_latency_s were {wrong}"
    if cause is Cause.HEIGHT:
        high_m = float(size[0])
        way = "high" if high_m > 0 else "low"
        return f"{mean_m} off, as if the ground were {_length(abs(high_m))} too {way}"
    shift = _in_picture(systematic.mean_px)
    angle = math.degrees(float(np.linalg.norm(size)))
    return f"mean offset {mean_m}, fixed in the picture ({shift}, {angle:.2f} deg)"


def _on_ground(offset_en: Array) -> str:
    east, north = offset_en.tolist()
    eighth = round(math.degrees(math.atan2(east, north)) / 45) % 8
    return f"{_length(math.hypot(east, north))} to the {_EIGHTHS[eighth]}"


def _in_picture(offset_px: Array) -> str:
    right, down = offset_px.tolist()
    across = f"{abs(right):.0f} px {'right' if right > 0 else 'left'}"
    return f"{across}, {abs(down):.0f} px {'down' if down > 0 else 'up'}"


def _length(metres: float) -> str:
    return f"{metres:.2f} m" if metres < 1 else f"{metres:.1f} m"

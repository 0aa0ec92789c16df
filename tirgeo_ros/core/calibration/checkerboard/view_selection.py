"""Select the views of a checkerboard for a calibration: sharp ones that differ."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tirgeo_ros.core.calibration.checkerboard.board import BoardSighting, RefusalReason, Refused

#: Views with a smaller rms distance of corners, relative to the picture's width, are duplicates.
#: At 640 px this is three pixels, about what a hand-held board still moves.
_SAME = 3 / 640
#: A view is too blurred if its blur exceeds the median of all by this factor and by these pixels.
_BLURRED_TIMES, _BLURRED_PX = 1.8, 0.5


def doubtful_views(views: Mapping[str, BoardSighting], width: int) -> dict[str, Refused]:
    """Return the rejected views: too blurred ones, and all but the sharpest of similar ones."""
    refused = _blurred(views)
    kept: dict[str, BoardSighting] = {}
    for name in _by_sharpness({k: v for k, v in views.items() if k not in refused}):
        same = [k for k, v in kept.items() if distance_px(v, views[name]) < _SAME * width]
        if same:
            refused[name] = Refused(RefusalReason.DUPLICATE, f"nothing has moved since {same[0]}")
        else:
            kept[name] = views[name]
    return refused


def _blurred(views: Mapping[str, BoardSighting]) -> dict[str, Refused]:
    blurs = {name: float(view.blur_px.max()) for name, view in views.items()}
    usual = float(np.median([*blurs.values()])) if blurs else 0.0
    most = max(_BLURRED_TIMES * usual, usual + _BLURRED_PX)
    said = f"px, usually {usual:.1f}"
    return {
        name: Refused(RefusalReason.BLURRED, f"edges blurred by {blur:.1f} {said}")
        for name, blur in blurs.items()
        if blur > most
    }


def _by_sharpness(views: Mapping[str, BoardSighting]) -> list[str]:
    return sorted(views, key=lambda name: (views[name].sigma_px, name))


def distance_px(one: BoardSighting, other: BoardSighting) -> float:
    """Return the rms distance of corners, px, with either end of the board counted first."""
    a, b = one.corners_px, other.corners_px
    return float(min(np.sqrt((off**2).sum(1).mean()) for off in (a - b, a - b[::-1])))


def most_distinct(views: Mapping[str, BoardSighting], count: int) -> list[str]:
    """Return ``count`` names, the sharpest first, then always the farthest from those chosen."""
    left = _by_sharpness(views)
    if len(left) <= count:
        return left
    chosen, away = [left[0]], dict.fromkeys(left[1:], np.inf)
    while len(chosen) < count:
        newest = views[chosen[-1]]
        away = {name: min(far, distance_px(newest, views[name])) for name, far in away.items()}
        chosen.append(max(away, key=away.__getitem__))
        del away[chosen[-1]]
    return chosen

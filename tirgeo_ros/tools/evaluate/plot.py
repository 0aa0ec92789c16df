"""Define what the figures of an evaluation share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.tools.evaluate.result import Evaluation

#: A figure does not resolve more instants than this.
_MOST_INSTANTS = 1500
#: Width of a figure (inches): narrow enough to be readable on a telephone.
WIDTH_IN = 4.4


class Plot(NamedTuple):
    """Hold a figure for the report: pictures that are placed side by side if there is room."""

    title: str
    caption: str
    svgs: Sequence[bytes]


def places_of(found: Evaluation) -> tuple[Array, Array, Array]:
    """Return the control points' east and north (P,) from their mean, and that mean (2,), m."""
    places = np.array([(one.east_m, one.north_m) for one in found.control.values()])
    middle = np.round(places.mean(axis=0))
    return places[:, 0] - middle[0], places[:, 1] - middle[1], middle


def thinned(stamps: IntArray) -> npt.NDArray[np.intp]:
    """Return indices of evenly spaced instants, fewer than 3000."""
    step = max(len(stamps) // _MOST_INSTANTS, 1)
    return np.arange(0, len(stamps), step)

"""What the figures of an evaluation have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.tools.evaluate.result import Evaluation

#: More instants than this are no longer told apart in a figure.
_MOST_INSTANTS = 1500
#: Of a figure, in: as narrow as a telephone, so that its text can be read there.
WIDTH_IN = 4.4


class Plot(NamedTuple):
    """A figure for the report: pictures that stand side by side where there is room."""

    title: str
    caption: str
    svgs: Sequence[bytes]


def places_of(found: Evaluation) -> tuple[Array, Array, Array]:
    """Return the control points' east and north (P,) from the middle of them, and that (2,)."""
    places = np.array([(one.east_m, one.north_m) for one in found.control.values()])
    middle = np.round(places.mean(axis=0))
    return places[:, 0] - middle[0], places[:, 1] - middle[1], middle


def thinned(stamps: IntArray) -> npt.NDArray[np.intp]:
    """Numbers of instants, evenly, of which there are not too many."""
    step = max(len(stamps) // _MOST_INSTANTS, 1)
    return np.arange(0, len(stamps), step)

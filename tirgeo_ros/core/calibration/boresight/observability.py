"""Find parameters that a flight's sightings cannot separate, with the reason and advice."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.calibration.boresight.fit import LIMITS
from tirgeo_ros.core.calibration.boresight.model import PARAMETERS, PointSighting
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError

#: With fewer, a wrong point or a wrong pose cannot be distinguished from a boresight.
LEAST_POINTS, LEAST_PICTURES = 3, 3
#: A parameter that was not asked for is estimated only if all sigmas are then within this share of
#: LIMITS: it must add little to the others' uncertainty, compared with their 0.3 deg.
UNASKED_SHARE = 1 / 3
#: A parameter belongs to the inseparable ones if its part of the worst direction is larger than
#: this share of the largest part.
_PART = 0.2
_TILT = "the camera's tilt hardly varied", "fly with at least two tilts 20 deg apart, or --hold it"
#: Parameter -> why it cannot be found, and what to do; the first that applies is given.
_ADVICE = {
    "gimbal_north": _TILT,
    "heading_offset": _TILT,
    "ground_height": (
        "the points are seen from about the same height and angle",
        "fly at two heights or two tilts, or --hold ground_height",
    ),
    "latency": (
        "the camera moved in the same way in all pictures, or hardly at all",
        "fly legs in several directions and click during turns too, or --hold latency",
    ),
}
_FEW = "too few observations", "click more points, in more pictures and all over the picture"


@dataclass(frozen=True)
class Ambiguity:
    """Hold parameters that have the same effect on the picture in this flight."""

    names: tuple[str, ...]
    reason: str
    advice: str

    def __str__(self) -> str:
        """Return one line for the operator."""
        what = " and ".join([", ".join(self.names[:-1]), self.names[-1]]).removeprefix(" and ")
        apart = "cannot be told apart" if len(self.names) > 1 else "cannot be found"
        return f"{what} {apart}: {self.reason}; {self.advice}"


def check_numbers(sightings: Sequence[PointSighting]) -> None:
    """Raise CalibrationError if there are too few points or pictures."""
    points = len({seen.id for seen in sightings})
    pictures = len({seen.stamp_ns for seen in sightings})
    if points < LEAST_POINTS or pictures < LEAST_PICTURES:
        raise CalibrationError(
            f"{points} surveyed points in {pictures} pictures with a pose: at "
            f"least {LEAST_POINTS} points and {LEAST_PICTURES} pictures are needed, better 20 "
            "points in three pictures each, all over the picture and the flight"
        )


def doubt(estimated: Sequence[str], covariance: Array, share: float = 1.0) -> Ambiguity | None:
    """Return what a covariance (p, p) of estimated parameters leaves open; None if nothing.

    A parameter is found if its standard deviation is within ``share`` of LIMITS.
    """
    names = [name for name in PARAMETERS if name in estimated]
    limits = LIMITS[[PARAMETERS.index(name) for name in names]] * share
    relative = covariance / np.outer(limits, limits)
    if (np.diag(relative) <= 1).all():
        return None
    worst = np.abs(np.linalg.eigh(relative)[1][:, -1])
    alike = tuple(n for n, part in zip(names, worst, strict=True) if part > _PART * worst.max())
    reason, advice = next((_ADVICE[name] for name in _ADVICE if name in alike), _FEW)
    return Ambiguity(alike, reason, advice)

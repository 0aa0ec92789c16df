"""Check that observations, survey and pictures belong together."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.types.arrays import IntArray
from tirgeo_ros.tools.evaluate.ground import Experiment
from tirgeo_ros.tools.evaluate.result import InputChecksResult, MethodResult

_NAMED = 5  # most ids in a note
_ELSEWHERE_M = 500.0  # median error of every method: no drone's camera is so far off


def checks_of(given: Experiment, image_stamps_ns: IntArray) -> InputChecksResult:
    """Compare them; ``image_stamps_ns`` (M,) is sorted, and empty if the bag has no pictures."""
    names = Counter(one.id for one in given.observations)
    unknown = {name: number for name, number in names.items() if name not in given.control}
    unobserved = [name for name in given.control if name not in names]
    apart_ns = _apart_ns([one.stamp_ns for one in given.observations], image_stamps_ns)
    pictured = len(image_stamps_ns) > 0
    return InputChecksResult(
        len(given.observations),
        unknown,
        unobserved,
        sum(apart > 0 for apart in apart_ns) if pictured else None,
        max(apart_ns) * 1e-9 if pictured else None,
    )


def _apart_ns(stamps_ns: Sequence[int], image_stamps_ns: IntArray) -> list[int]:
    """Return the time from each stamp to the nearest picture's (ns); [] without pictures."""
    if not len(image_stamps_ns):
        return []
    after = np.searchsorted(image_stamps_ns, np.array(stamps_ns, np.int64))
    near = [np.clip(after - step, 0, len(image_stamps_ns) - 1) for step in (0, 1)]
    nearest = [[int(image_stamps_ns[k]) for k in ks] for ks in zip(*near, strict=True)]
    return [
        min(abs(stamp - one) for one in both)
        for stamp, both in zip(stamps_ns, nearest, strict=True)
    ]


def check_notes(checks: InputChecksResult) -> list[str]:
    """Return the checks as lines for a person."""
    notes = []
    if checks.unknown_ids:
        number = sum(checks.unknown_ids.values())
        notes.append(
            f"{number} of {checks.observations} observations are of points that the survey has "
            f"not, and left out: {_some(list(checks.unknown_ids))}"
        )
    if checks.unobserved_ids:
        notes.append(
            f"{len(checks.unobserved_ids)} surveyed points were never observed: "
            f"{_some(checks.unobserved_ids)}"
        )
    if checks.off_pictures and checks.off_pictures_most_s is not None:
        notes.append(
            f"{checks.off_pictures} of {checks.observations} observations have a stamp that is no "
            f"picture's: up to {checks.off_pictures_most_s:.3g} s from the nearest one"
        )
    return notes


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


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + more

"""Make the rows that every format writes, of targets and of the pixels of ``tirgeo locate``."""

from __future__ import annotations

import math
import uuid
from collections.abc import Sequence
from typing import Any, NamedTuple

from tirgeo_ros.core.ground.ground_point import Refusal
from tirgeo_ros.core.targets.target import Fixing, Target, fixing_of
from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.properties import OF_PLACE, of_place, of_target


class Row(NamedTuple):
    """Hold what is written of a target, or of a pixel that was located or refused."""

    properties: dict[str, Any]  # texts, numbers, bool; None for what a refused pixel lacks
    target: Target | None  # None of a refused pixel
    words: str  # for a person


def of_targets(targets: Sequence[Target]) -> list[Row]:
    """Return a row for each target."""
    return [Row(of_target(one), one, _words(one)) for one in targets]


def of_answers(answers: Sequence[Answered]) -> list[Row]:
    """Return a row for each pixel in their order; a located one is a target with its name."""
    return [_row(number, one) for number, one in enumerate(answers, 1)]


def _row(number: int, one: Answered) -> Row:
    name, answer = one
    pixel = {"id": name, "stamp_ns": answer.stamp_ns, "u": answer.uv[0], "v": answer.uv[1]}
    if isinstance(answer, Refusal):
        known = pixel | {key: None for key in OF_PLACE if key not in pixel}
        reason = answer.reason.value
        return Row(known | {"reason": reason}, None, f"not located: {reason}")
    place = fixing_of(answer)
    target = target_of_pixel(number, name, place)
    return Row(pixel | of_place(place) | {"reason": None}, target, _words(target))


def target_of_pixel(number: int, name: str, place: Fixing) -> Target:
    """Return a located pixel as a target: the same one for the same file, number and name."""
    own_id = uuid.uuid5(uuid.NAMESPACE_URL, f"tirgeo/{place}/{number}/{name!r}").hex
    return Target(own_id, number, name, "other", "", "", place.stamp_ns, place.stamp_ns, (place,))


def _words(target: Target) -> str:
    """Describe the place for a person."""
    place = target.place
    ellipse = place.ellipse
    text = (
        f"95 % within {ellipse.major_m:.2f} x {ellipse.minor_m:.2f} m (semi-axes), the longer "
        f"towards {math.degrees(ellipse.azimuth_rad):.0f} deg; {place.height_m:.2f} m above the "
        "ellipsoid"
    )
    return text if target.clicks_agree else f"{text}; its clicks disagree"

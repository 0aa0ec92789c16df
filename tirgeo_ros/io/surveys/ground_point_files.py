"""Pair a pixel of a list with its place."""

from __future__ import annotations

from typing import NamedTuple

from tirgeo_ros.core.ground.ground_point import Located, Refusal


class Answered(NamedTuple):
    """Hold a pixel of a list and its located point or refusal."""

    id: str
    answer: Located | Refusal

"""Encode located points and targets as JSON for programs, and decode it.

Each text is one ``std_msgs/String``: an object whose ``schema`` names its topic and version.
docs/outputs.md lists the fields. Nanoseconds are texts of digits, since many readers of JSON
round large numbers.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Answer, Located, Refusal
from tirgeo_ros.core.targets.target import KINDS, MOST_TARGETS, Target
from tirgeo_ros.core.types.errors import MessageError, TargetError, cut, shown

ANSWER_TOPIC, TARGETS_TOPIC = "tirgeo/locate/answer", "tirgeo/targets"
ANSWER_SCHEMA, TARGETS_SCHEMA = f"{ANSWER_TOPIC}/1", f"{TARGETS_TOPIC}/1"
#: Characters of a text. A target with the longest name has some 2000, each letter escaped.
_LONGEST_ANSWER, _LONGEST_LIST = 10_000, 2000 * MOST_TARGETS
#: What reading a document of another form raises.
WRONG_FORM = (KeyError, TypeError, ValueError, AttributeError, OverflowError)


def document_of(message: Any, topic: str, schema: str, longest: int) -> Any:
    """Return the JSON object of a ``std_msgs/String``. Raises MessageError for another text."""
    text = getattr(message, "data", None)
    if not isinstance(text, str):
        raise MessageError(f"{topic}: not a text: it is of a version before {schema}")
    if len(text) > longest:
        raise MessageError(f"{topic}: {len(text)} characters; {longest} are read")
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"{topic}: no JSON: {shown(error, 100)}") from None
    if not isinstance(document, dict) or document.get("schema") != schema:
        raise MessageError(f"{topic}: its schema is not {schema}")
    return document


def answer_text(answer: Answer) -> str:
    """Return the answer to a click as JSON; ``answer_of`` is the inverse."""
    head = {"schema": ANSWER_SCHEMA, "stamp_ns": str(answer.stamp_ns)}
    u, v = (float(x) if math.isfinite(x) else None for x in answer.uv)
    pixel: dict[str, Any] = head | {"u": u, "v": v}
    if isinstance(answer, Refusal):
        reason = {"refused": answer.reason.name.lower(), "words": answer.reason.value}
        return json.dumps(pixel | reason)
    return json.dumps(pixel | {"refused": None} | _place_row(answer))


def answer_of(message: Any) -> Answer:
    """Decode ``tirgeo/locate/answer``. Raises MessageError for what is no answer to a click."""
    row = document_of(message, ANSWER_TOPIC, ANSWER_SCHEMA, _LONGEST_ANSWER)
    try:
        u, v = (math.nan if row[key] is None else float(row[key]) for key in ("u", "v"))
        if row["refused"] is not None:
            return Refusal(int(row["stamp_ns"]), (u, v), Reason[row["refused"].upper()])
        point = _point(row, (u, v))
    except WRONG_FORM as error:
        raise MessageError(f"{ANSWER_TOPIC}: no answer to a click: {shown(error, 100)}") from None
    if point.fault:
        raise MessageError(f"{ANSWER_TOPIC}: {point.fault}")
    return point


def targets_text(targets: Sequence[Target]) -> str:
    """Return targets as JSON, without their notes; ``targets_of`` is the inverse."""
    rows = ", ".join(map(_target_text, targets))
    return f'{{"schema": "{TARGETS_SCHEMA}", "targets": [{rows}]}}'


@functools.lru_cache(maxsize=2 * MOST_TARGETS)  # at a change of one, the others are not encoded
def _target_text(target: Target) -> str:
    return json.dumps(target_row(target))


def target_row(target: Target) -> dict[str, Any]:
    """Return a target's fields but for its note, its place at the average of its clicks."""
    place = target.place
    return {
        "id": target.id,
        "number": target.number,
        "name": target.name,
        "kind": target.kind,
        "aircraft": target.aircraft,
        "created_ns": str(target.created_ns),
        "changed_ns": str(target.changed_ns),
        "clicks": len(target.clicks),
        "clicks_agree": target.clicks_agree,
        "stamp_ns": str(place.stamp_ns),
    } | _place_row(place)


def targets_of(message: Any) -> list[Target]:
    """Decode ``tirgeo/targets``: each target has one click, at its place, and no note.

    Raises MessageError for another text, and for more targets than are drawn: they would hold up
    the video.
    """
    rows = document_of(message, TARGETS_TOPIC, TARGETS_SCHEMA, _LONGEST_LIST).get("targets")
    if not isinstance(rows, list):
        raise MessageError(f"{TARGETS_TOPIC}: no list of targets")
    if len(rows) > MOST_TARGETS:
        raise MessageError(f"{TARGETS_TOPIC}: {len(rows)} targets; {MOST_TARGETS} can be drawn")
    try:
        return [_target(row) for row in rows]
    except (*WRONG_FORM, TargetError) as error:
        raise MessageError(f"{TARGETS_TOPIC}: {shown(error, 300)}") from None


def _target(row: Mapping[str, Any]) -> Target:
    name, aircraft = cut(str(row["name"])), cut(str(row["aircraft"]))
    kind = row["kind"] if row["kind"] in KINDS else "other"
    times = int(row["created_ns"]), int(row["changed_ns"])
    own = str(row["id"]), int(row["number"]), name, kind, "", aircraft
    return Target(*own, *times, (_point(row),))


def _place_row(point: Located) -> dict[str, Any]:
    return {
        "latitude_deg": point.latitude_deg,
        "longitude_deg": point.longitude_deg,
        "height_m": point.height_m,
        "covariance_enu": point.covariance_enu,
    }


def _point(row: Mapping[str, Any], uv: tuple[float, float] = (math.nan, math.nan)) -> Located:
    latitude, longitude = float(row["latitude_deg"]), float(row["longitude_deg"])
    covariance = tuple(map(float, row["covariance_enu"]))
    stamp_ns, height_m = int(row["stamp_ns"]), float(row["height_m"])
    return Located(stamp_ns, latitude, longitude, height_m, covariance, uv)

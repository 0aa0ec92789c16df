"""Read what a page sends: JSON texts, each field of its type and in its range, nothing else."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from typing import Any

from tirgeo_ros.core.targets.target import KINDS
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.io.targets.store import MOST_MARK, MOST_NAME, MOST_NOTE

Check = Callable[[Any], Any]  # returns the value, or raises ValueError with what it must be
_MOST_PIXEL = 1e5


class RequestError(ValueError):
    """Report a request that is not one, in words for whoever wrote the page."""

    def __init__(self, words: str, request: str = "") -> None:
        super().__init__(words)
        self.request = request


def _text(most: int, least: int = 0) -> Check:
    def check(value: Any) -> str:
        if not isinstance(value, str) or not least <= len(value) <= most:
            raise ValueError(f"a text of {least} to {most} characters")
        if any((ord(c) < 32 and c not in "\n\r\t") or 0xD800 <= ord(c) < 0xE000 for c in value):
            raise ValueError("a text without control characters")
        return value

    return check


def _number(low: float, high: float) -> Check:
    def check(value: Any) -> float:
        right = isinstance(value, (int, float)) and not isinstance(value, bool)
        if not right or not low <= value <= high:  # nan is in no range
            raise ValueError(f"a number from {low:g} to {high:g}")
        return float(value)

    return check


def _stamp(value: Any) -> int:
    right = isinstance(value, str) and value.isascii() and value.isdigit() and len(value) <= 19
    if not right or int(value) >= 1 << 63:
        raise ValueError("a text of digits: nanoseconds")
    return int(value)


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError("true or false")  # noqa: TRY004 all faults are of one kind
    return value


def _kind(value: Any) -> str:
    if value not in KINDS:
        raise ValueError(f"one of {', '.join(KINDS)}")
    return str(value)


def _id(value: Any) -> str:
    right = isinstance(value, str) and len(value) == 32 and {*value} <= {*"0123456789abcdef"}
    if not right:
        raise ValueError("the id of a target")
    return str(value)


def _place(value: Any) -> tuple[float, float]:
    if not isinstance(value, list) or len(value) != 2:
        raise ValueError("[latitude, longitude]")
    return _latitude(value[0]), _longitude(value[1])


def _texts(value: Any) -> dict[str, str]:
    if not isinstance(value, dict) or not all(isinstance(text, str) for text in value.values()):
        raise ValueError("an object of texts: what each field was")
    return value


def _or_none(check: Check) -> Check:
    return lambda value: None if value is None else check(value)


_latitude, _longitude = _number(-90, 90), _number(-180, 180)
_pixel, _aircraft = _number(-_MOST_PIXEL, _MOST_PIXEL), _text(100)
#: Type -> the fields that a request must have.
_MUST: Mapping[str, Mapping[str, Check]] = {
    "click": {
        "aircraft": _aircraft,
        "stamp_ns": _stamp,
        "u": _pixel,
        "v": _pixel,
        "kind": _kind,
        "refine": _or_none(_id),
    },
    "edit": {"id": _id, "was": _texts},
    "leave_out": {"id": _id, "field": _text(4), "text": _text(MOST_NOTE)},
    "delete": {"id": _id, "was": _texts},
    "undo": {},
    "record": {"aircraft": _aircraft, "on": _flag},
    "mark": {"text": _text(MOST_MARK)},
    "share": {"on": _flag},
    "where": {"aircraft": _aircraft, "latitude_deg": _latitude, "longitude_deg": _longitude},
    "measure": {"from": _place, "to": _place},
}
#: And those that it may have.
_MAY: Mapping[str, Mapping[str, Check]] = {
    "edit": {"name": _text(MOST_NAME), "kind": _kind, "note": _text(MOST_NOTE)},
    "undo": {"id": _id},
}
#: What somebody who may only look may ask.
FOR_VIEWERS = frozenset({"where", "measure"})
_request_name = _text(40, 1)


def read_request(text: str) -> tuple[str, str, dict[str, Any]]:
    """Return a request's own name, its type and its fields; raises RequestError."""
    try:
        given = json.loads(text, parse_constant=_refuse_constant)
    except (ValueError, RecursionError):
        raise RequestError("a request is JSON") from None
    if not isinstance(given, dict):
        raise RequestError("a request is a JSON object")
    try:
        name = _request_name(given.pop("request", None))
    except ValueError as error:
        raise RequestError(f"request must be {error}") from None
    kind = given.pop("type", None)
    if not isinstance(kind, str) or kind not in _MUST:
        raise RequestError(f"type must be one of {', '.join(_MUST)}", name)
    return name, kind, _checked(name, kind, given)


def _checked(name: str, kind: str, given: dict[str, Any]) -> dict[str, Any]:
    must, may = _MUST[kind], _MAY.get(kind, {})
    absent = [field for field in must if field not in given]
    unknown = [field for field in given if field not in must and field not in may]
    if absent or unknown:
        fault = f"lacks {absent[0]}" if absent else f"has no field {shown(unknown[0], 40)}"
        raise RequestError(f"{kind} {fault}", name)
    return {field: _value(name, kind, field, value) for field, value in given.items()}


def _value(name: str, kind: str, field: str, value: Any) -> Any:
    check = _MUST[kind].get(field) or _MAY[kind][field]
    try:
        return check(value)
    except ValueError as error:
        raise RequestError(f"{kind}: {field} must be {error}", name) from None


def _refuse_constant(name: str) -> float:
    raise ValueError(name)

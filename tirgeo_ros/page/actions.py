# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Read the requests of pages, do them and answer; write targets in the form that pages get."""

from __future__ import annotations

import asyncio
import json
import logging
import math
import re
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, Protocol, TypeVar

import pyproj

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import KINDS, STATUSES, Target, near
from tirgeo_ros.core.types.errors import TirgeoError, shown
from tirgeo_ros.io.coordinates.crs import written
from tirgeo_ros.io.messages.json_codec import target_row
from tirgeo_ros.io.targets.store import MOST_MARK, MOST_NAME, MOST_NOTE, TargetStore
from tirgeo_ros.page.video import VideoFeed

Check = Callable[[Any], Any]  # returns the value, or raises ValueError with what it must be
_MOST_PIXEL = 1e5
_T = TypeVar("_T")
_Was = dict[str, str]  # what each field was when its editor began
_GEOD = pyproj.Geod(ellps="WGS84")
_CLICK_S = 2.0  # the backend's own limit is one second
#: A request with a name so long is done once: a page that lost the connection before the answer
#: sends the request again, under the same unique name.
_UNIQUE_NAME, _REMEMBERED = 16, 2000
_CORNERS = 36  # of an ellipse's outline
#: Types of requests that a viewer may send.
FOR_VIEWERS = frozenset({"where", "measure"})
Sent = dict[str, tuple[Target, list[list[str]]]]  # id -> a target and its alternatives
_LOG = logging.getLogger("tirgeo.page")


class Click(NamedTuple):
    """Hold a place in a picture that somebody clicked."""

    aircraft: str  # id; "" for the only one
    stamp_ns: int  # of the clicked picture
    u: float  # column and row in the full picture, pixels
    v: float


class Pixel(NamedTuple):
    """Hold where a place of the map is in a picture."""

    stamp_ns: int  # of the picture
    u: float  # column and row in the full picture, pixels
    v: float


class Backend(Protocol):
    """Answer the page's requests.

    The server's asyncio loop awaits the coroutines, which must never block it. The other methods
    are called in threads. A refusal is a text for the operator.
    """

    targets: TargetStore

    async def click(self, click: Click) -> Located | str:
        """Return the ground point at a pixel, or why there is none; within a second."""

    async def where(self, aircraft: str, latitude_deg: float, longitude_deg: float) -> Pixel | str:
        """Return where a place is in the newest picture, or why it isn't there."""

    async def record(self, aircraft: str, on: bool) -> str:
        """Begin or end a recording; return words for the operator."""

    async def share(self, on: bool) -> str:
        """Begin or end to send Cursor-on-Target; return words for the operator."""

    def vector_map(self, aircraft: str) -> bytes:
        """Return the map as GeoJSON in WGS84; empty without one."""


class RequestError(ValueError):
    """Report what is wrong with a request, in words for the page's author."""

    def __init__(self, words: str, request: str = "") -> None:
        super().__init__(words)
        self.request = request


def _check(valid: Callable[[Any], object], must_be: str, convert: Check = lambda v: v) -> Check:
    def check(value: Any) -> Any:
        if not valid(value):
            raise ValueError(must_be)
        return convert(value)

    return check


def _text(most: int, least: int = 0) -> Check:
    fits = _check(
        lambda value: isinstance(value, str) and least <= len(value) <= most,
        f"a text of {least} to {most} characters",
    )
    return _check(
        lambda value: not re.search("[^\n\r\t -\ud7ff\ue000-\U0010ffff]", fits(value)),
        "a text without control characters",
    )


def _number(low: float, high: float) -> Check:
    def valid(value: Any) -> bool:
        number = isinstance(value, (int, float)) and not isinstance(value, bool)
        return number and low <= value <= high  # nan is in no range

    return _check(valid, f"a number from {low:g} to {high:g}", float)


def _matches(pattern: str, value: Any) -> bool:
    return isinstance(value, str) and re.fullmatch(pattern, value) is not None


def _is_texts(value: Any) -> bool:
    return isinstance(value, dict) and all(isinstance(text, str) for text in value.values())


_latitude, _longitude = _number(-90, 90), _number(-180, 180)
_pixel, _aircraft = _number(-_MOST_PIXEL, _MOST_PIXEL), _text(100)
_stamp = _check(
    lambda value: _matches("[0-9]{1,19}", value) and int(value) < 1 << 63,
    "a text of digits: nanoseconds",
    int,
)
_flag = _check(lambda value: isinstance(value, bool), "true or false")
_kind = _check(lambda value: value in [*KINDS], f"one of {', '.join(KINDS)}")
_status = _check(lambda value: value in [*STATUSES], f"one of {', '.join(STATUSES)}")
_id = _check(partial(_matches, "[0-9a-f]{32}"), "the id of a target")
_id_or_none = _check(lambda value: value is None or _id(value), "the id of a target")
_texts = _check(_is_texts, "an object of texts: what each field was")
_place = _check(
    lambda value: isinstance(value, list) and len(value) == 2,
    "[latitude, longitude]",
    lambda value: (_latitude(value[0]), _longitude(value[1])),
)
#: Type of request -> the fields that it must have.
_MUST: Mapping[str, Mapping[str, Check]] = {
    "click": {
        "aircraft": _aircraft,
        "stamp_ns": _stamp,
        "u": _pixel,
        "v": _pixel,
        "kind": _kind,
        "refine": _id_or_none,
    },
    "edit": {"id": _id, "was": _texts},
    "leave_out": {"id": _id, "field": _text(6), "text": _text(MOST_NOTE)},
    "delete": {"id": _id, "was": _texts},
    "merge": {"id": _id, "into": _id},
    "undo": {},
    "record": {"aircraft": _aircraft, "on": _flag},
    "mark": {"text": _text(MOST_MARK)},
    "share": {"on": _flag},
    "where": {"aircraft": _aircraft, "latitude_deg": _latitude, "longitude_deg": _longitude},
    "measure": {"from": _place, "to": _place},
}
#: Type of request -> the fields that it may have.
_MAY: Mapping[str, Mapping[str, Check]] = {
    "edit": {
        "name": _text(MOST_NAME),
        "kind": _kind,
        "note": _text(MOST_NOTE),
        "status": _status,
    },
    "undo": {"id": _id},
}
_request_name = _text(40, 1)


def read_request(text: str) -> tuple[str, str, dict[str, Any]]:
    """Return a request's own name, its type and its fields; raises RequestError."""
    try:
        fields = json.loads(text, parse_constant=int)  # which refuses NaN and Infinity
    except (ValueError, RecursionError):
        raise RequestError("a request is JSON") from None
    if not isinstance(fields, dict):
        raise RequestError("a request is a JSON object")
    try:
        name = _request_name(fields.pop("request", None))
    except ValueError as error:
        raise RequestError(f"request must be {error}") from None
    kind = fields.pop("type", None)
    if not isinstance(kind, str) or kind not in _MUST:
        raise RequestError(f"type must be one of {', '.join(_MUST)}", name)
    checks = {**_MUST[kind], **_MAY.get(kind, {})}
    absent = [field for field in _MUST[kind] if field not in fields]
    unknown = [field for field in fields if field not in checks]
    if absent or unknown:
        fault = f"lacks {absent[0]}" if absent else f"has an unknown field {shown(unknown[0], 40)}"
        raise RequestError(f"{kind} {fault}", name)
    field = ""
    try:
        for field, value in fields.items():
            fields[field] = checks[field](value)
    except ValueError as error:
        raise RequestError(f"{kind}: {field} must be {error}", name) from None
    return name, kind, fields


class Actions:
    """Answer requests; each method's name is a request's type, its arguments are the fields.

    Each returns the fields of a good answer, or raises RequestError or TirgeoError with the words
    of a refusal.
    """

    def __init__(
        self,
        backend: Backend,
        feeds: Mapping[str, VideoFeed],
        undulation_m: float,
        changed: Callable[[], None],
    ) -> None:
        self._backend, self._feeds, self._undulation_m = backend, feeds, undulation_m
        self._changed = changed
        self._answers: OrderedDict[str, asyncio.Task[dict[str, Any]]] = OrderedDict()
        self._in_turn = asyncio.Lock()  # changes of the store happen in the order of requests

    async def answer(self, name: str, kind: str, fields: dict[str, Any]) -> dict[str, Any]:
        """Return the answer to a request; a request sent again gets the same answer."""
        if len(name) < _UNIQUE_NAME or kind in FOR_VIEWERS:  # these change nothing
            return await self._done(kind, fields)
        if name not in self._answers:
            self._answers[name] = asyncio.create_task(self._done(kind, fields))
            if len(self._answers) > _REMEMBERED:
                self._answers.popitem(last=False)
        return await asyncio.shield(self._answers[name])

    async def _done(self, kind: str, fields: dict[str, Any]) -> dict[str, Any]:
        arguments = {"from_" if name == "from" else name: v for name, v in fields.items()}
        try:
            answer = await getattr(self, f"_{kind}")(**arguments)
        except (RequestError, TirgeoError) as error:
            return {"ok": False, "reason": str(error)}
        except Exception:  # noqa: BLE001 whoever asked waits for an answer
            _LOG.exception("%s: a fault in this program", kind)
            return {"ok": False, "reason": "a fault in this program: its log says where"}
        return {"ok": True, **answer}

    async def _click(
        self, aircraft: str, stamp_ns: int, u: float, v: float, kind: str, refine: str | None
    ) -> dict[str, Any]:
        cut_out = self._feed(aircraft).cut_out(stamp_ns, u, v)  # now: the picture may soon be gone
        click = Click(aircraft, stamp_ns, u, v)
        try:
            place = await asyncio.wait_for(self._backend.click(click), _CLICK_S)
        except asyncio.TimeoutError:
            place = "no answer from overlay_node: does it run?"
        if isinstance(place, str):
            raise RequestError(place)
        store, now_ns = self._backend.targets, time.time_ns()
        known = math.isfinite(place.temperature_c)
        more = {"temperature_c": place.temperature_c if known else None}
        if refine:
            return more | await self._target(lambda: store.refine(refine, place, now_ns))
        add = partial(store.add, place, aircraft=aircraft, kind=kind, now_ns=now_ns)
        answer = more | await self._target(lambda: add(picture=cut_out()))
        found = await asyncio.to_thread(lambda: near(place, store.all()))
        own_id = answer["target"]["id"]
        return answer | {"near": [each.id for each in found if each.id != own_id]}

    async def _edit(self, id: str, was: _Was, **words: str) -> dict[str, Any]:  # noqa: A002  the page's own word
        edit = partial(self._backend.targets.edit, id, time.time_ns(), was)
        return await self._target(partial(edit, **words))

    async def _leave_out(self, id: str, field: str, text: str) -> dict[str, Any]:  # noqa: A002  the page's own word
        leave_out, now_ns = self._backend.targets.leave_out, time.time_ns()
        return await self._target(partial(leave_out, id, field, text, now_ns))

    async def _delete(self, id: str, was: _Was) -> dict[str, Any]:  # noqa: A002 as sent
        await self._stored(partial(self._backend.targets.delete, id, time.time_ns(), was))
        return {}

    async def _merge(self, id: str, into: str) -> dict[str, Any]:  # noqa: A002 as sent
        merge, now_ns = self._backend.targets.merge, time.time_ns()
        return await self._target(partial(merge, id, into, now_ns))

    async def _undo(self, id: str | None = None) -> dict[str, Any]:  # noqa: A002 as sent
        text = await self._stored(partial(self._backend.targets.undo, id))
        return {"text": text or "nothing to undo"}

    async def _mark(self, text: str) -> dict[str, Any]:
        await self._stored(partial(self._backend.targets.mark, text, time.time_ns()))
        return {}

    async def _record(self, aircraft: str, on: bool) -> dict[str, Any]:
        self._feed(aircraft)
        return {"text": await self._backend.record(aircraft, on)}

    async def _share(self, on: bool) -> dict[str, Any]:
        return {"text": await self._backend.share(on)}

    async def _where(
        self, aircraft: str, latitude_deg: float, longitude_deg: float
    ) -> dict[str, Any]:
        self._feed(aircraft)
        pixel = await self._backend.where(aircraft, latitude_deg, longitude_deg)
        if not isinstance(pixel, Pixel):
            raise RequestError(pixel)
        return {"stamp_ns": str(pixel.stamp_ns), "u": pixel.u, "v": pixel.v}

    async def _measure(
        self, from_: tuple[float, float], to: tuple[float, float]
    ) -> dict[str, Any]:
        bearing, _, distance_m = _GEOD.inv(from_[1], from_[0], to[1], to[0])
        return {"distance_m": float(distance_m), "bearing_deg": float(bearing) % 360}

    def _feed(self, aircraft: str) -> VideoFeed:
        if aircraft not in self._feeds:
            raise RequestError("there is no such aircraft")
        return self._feeds[aircraft]

    async def _target(self, call: Callable[[], Target]) -> dict[str, Any]:
        """Change the store, and return the target as it is then."""

        def change() -> dict[str, Any]:
            target = call()
            others = self._backend.targets.alternatives()[target.id]
            return target_fields(target, self._undulation_m) | {"alternatives": others}

        return {"target": await self._stored(change)}

    async def _stored(self, call: Callable[[], _T]) -> _T:
        """Change the store, and tell all pages."""
        async with self._in_turn:
            result = await asyncio.to_thread(call)
        self._changed()
        return result


def changed_targets(store: TargetStore, undulation_m: float, sent: Sent) -> dict[str, str]:
    """Return the JSON of each target that differs from ``sent``, by id; "" for a deleted one.

    Set ``sent`` to what the store holds.
    """
    alternatives = store.alternatives()
    now = {target.id: (target, alternatives.get(target.id, [])) for target in store.all()}
    texts = dict.fromkeys(sent.keys() - now.keys(), "")
    for id_, (target, others) in now.items():
        if sent.get(id_) != (target, others):
            texts[id_] = json.dumps(target_fields(target, undulation_m) | {"alternatives": others})
    sent.clear()
    sent.update(now)
    return texts


def target_fields(target: Target, undulation_m: float) -> dict[str, Any]:
    """Return a target as pages get it; with undulation nan, without height above sea level."""
    place = target.place
    ellipse = place.ellipse
    return target_row(target) | {
        "note": target.note,
        "height_msl_m": place.height_m - undulation_m if math.isfinite(undulation_m) else None,
        "coordinates": written(place.latitude_deg, place.longitude_deg)._asdict(),
        "ellipse": {
            "major_m": ellipse.major_m,
            "minor_m": ellipse.minor_m,
            "azimuth_deg": math.degrees(ellipse.azimuth_rad),
        },
        "outline": [[round(x, 8) for x in corner] for corner in place.outline(_CORNERS)],
    }

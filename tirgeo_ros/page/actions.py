"""Do what a page's request asks, and say what came of it; write targets as pages get them."""

from __future__ import annotations

import asyncio
import functools
import json
import logging
import math
import time
from collections import OrderedDict
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

import pyproj

from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.coordinates.crs import written
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.page.backend import Backend, Click, Pixel
from tirgeo_ros.page.requests import FOR_VIEWERS, RequestError
from tirgeo_ros.page.video_feed import VideoFeed

_T = TypeVar("_T")
_Was = dict[str, str]  # what each field was to whoever changes it
_GEOD = pyproj.Geod(ellps="WGS84")
_CLICK_S = 2.0  # the backend has its own limit, of a second
#: A name so long is nobody else's: a page that lost the connection before the answer sends the
#: request again, and it must not be done twice.
_UNIQUE_NAME, _REMEMBERED = 16, 2000
_CORNERS = 36  # of an ellipse's outline
_LOG = logging.getLogger("tirgeo.page")


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
        """Return the answer to a request; to one that was sent again, the same one."""
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
            found = await getattr(self, f"_{kind}")(**arguments)
        except (RequestError, TirgeoError) as error:
            return {"ok": False, "reason": str(error)}
        except Exception:  # noqa: BLE001 whoever asked waits for an answer
            _LOG.exception("%s: a fault in this program", kind)
            return {"ok": False, "reason": "a fault in this program: its log says where"}
        return {"ok": True, **found}

    async def _click(
        self, aircraft: str, stamp_ns: int, u: float, v: float, kind: str, refine: str | None
    ) -> dict[str, Any]:
        feed = self._feed(aircraft)
        cut_out = feed.cut_out(stamp_ns, u, v)  # now: the picture may soon be gone
        click = Click(aircraft, stamp_ns, u, v)
        try:
            fixing = await asyncio.wait_for(self._backend.click(click), _CLICK_S)
        except asyncio.TimeoutError:
            fixing = "no answer from overlay_node: does it run?"
        if isinstance(fixing, str):
            raise RequestError(fixing)
        store, now_ns = self._backend.targets, time.time_ns()
        if refine:
            return await self._stored(lambda: self._told(store.refine(refine, fixing, now_ns)))
        add = functools.partial(store.add, fixing, aircraft=aircraft, kind=kind, now_ns=now_ns)
        return await self._stored(lambda: self._told(add(picture=cut_out())))

    async def _edit(self, id: str, was: _Was, **words: str) -> dict[str, Any]:  # noqa: A002
        edit = self._backend.targets.edit
        return await self._stored(lambda: self._told(edit(id, time.time_ns(), was, **words)))

    async def _leave_out(self, id: str, field: str, text: str) -> dict[str, Any]:  # noqa: A002
        leave_out = self._backend.targets.leave_out
        return await self._stored(lambda: self._told(leave_out(id, field, text, time.time_ns())))

    async def _delete(self, id: str, was: _Was) -> dict[str, Any]:  # noqa: A002 as sent
        await self._stored(lambda: self._backend.targets.delete(id, time.time_ns(), was))
        return {}

    async def _undo(self, id: str | None = None) -> dict[str, Any]:  # noqa: A002 as sent
        text = await self._stored(lambda: self._backend.targets.undo(id))
        return {"text": text or "nothing to undo"}

    async def _mark(self, text: str) -> dict[str, Any]:
        await self._stored(lambda: self._backend.targets.mark(text, time.time_ns()))
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
        found = await self._backend.where(aircraft, latitude_deg, longitude_deg)
        if not isinstance(found, Pixel):
            raise RequestError(found)
        return {"stamp_ns": str(found.stamp_ns), "u": found.u, "v": found.v}

    async def _measure(
        self, from_: tuple[float, float], to: tuple[float, float]
    ) -> dict[str, Any]:
        bearing, _, distance_m = _GEOD.inv(from_[1], from_[0], to[1], to[0])
        return {"distance_m": float(distance_m), "bearing_deg": float(bearing) % 360}

    def _feed(self, aircraft: str) -> VideoFeed:
        if aircraft not in self._feeds:
            raise RequestError("there is no such aircraft")
        return self._feeds[aircraft]

    def _told(self, target: Target) -> dict[str, Any]:
        open_ = self._backend.targets.alternatives()[target.id]
        return {"target": target_fields(target, self._undulation_m) | {"alternatives": open_}}

    async def _stored(self, call: Callable[[], _T]) -> _T:
        """Change the store, and tell all pages."""
        async with self._in_turn:
            found = await asyncio.to_thread(call)
        self._changed()
        return found


#: A target and its alternatives, by id.
Told = dict[str, tuple[Target, list[list[str]]]]


def changed_targets(store: TargetStore, undulation_m: float, told: Told) -> dict[str, str]:
    """Return the JSON, by id, of each target that is not as ``told``; "" of one that is gone.

    Then ``told`` is what the store holds.
    """
    open_ = store.alternatives()
    now = {one.id: (one, open_.get(one.id, [])) for one in store.all()}
    changed = [one for id_, one in now.items() if told.get(id_) != one]
    texts = dict.fromkeys(told.keys() - now.keys(), "")
    for target, others in changed:
        fields = target_fields(target, undulation_m) | {"alternatives": others}
        texts[target.id] = json.dumps(fields)
    told.clear()
    told.update(now)
    return texts


def target_fields(target: Target, undulation_m: float) -> dict[str, Any]:
    """Return a target as the page gets it; without ``undulation_m`` no height above sea level."""
    place = target.place
    ellipse = place.ellipse
    known = math.isfinite(undulation_m)
    return {
        "id": target.id,
        "number": target.number,
        "name": target.name,
        "kind": target.kind,
        "note": target.note,
        "aircraft": target.aircraft,
        "created_ns": str(target.created_ns),
        "changed_ns": str(target.changed_ns),
        "latitude_deg": place.latitude_deg,
        "longitude_deg": place.longitude_deg,
        "height_m": place.height_m,
        "height_msl_m": place.height_m - undulation_m if known else None,
        "coordinates": written(place.latitude_deg, place.longitude_deg)._asdict(),
        "ellipse": {
            "major_m": ellipse.major_m,
            "minor_m": ellipse.minor_m,
            "azimuth_deg": math.degrees(ellipse.azimuth_rad),
        },
        "outline": [[round(x, 8) for x in corner] for corner in place.outline(_CORNERS)],
        "clicks": len(target.fixings),
        "clicks_agree": target.clicks_agree,
    }

"""Answer the operator's page by way of the graph: clicks, places, recordings, the map."""

from __future__ import annotations

import asyncio
import math
import threading
from collections import defaultdict
from collections.abc import Mapping

from tirgeo_ros.core.ground.ground_point import Answer, Located, Refusal
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.nodes.aircraft_view import AircraftView
from tirgeo_ros.nodes.map_watch import PageMap
from tirgeo_ros.nodes.recordings import Recordings
from tirgeo_ros.page.backend import Click, Pixel
from tirgeo_ros.page.cot.link import CotLink

#: Within a second an answer comes, or a refusal. A click may be lost on its way, as overlay_node
#: takes clicks of any publisher, best effort: then it is sent once more.
_TRIES_S = (0.35, 0.65)

_Key = tuple[str, int, float, float]  # aircraft, stamp, column, row


class PageBackend:
    """Be the page's ``Backend``. ``answered`` is for the thread that hears the graph."""

    def __init__(
        self,
        aircraft: Mapping[str, AircraftView],
        targets: TargetStore,
        page_map: PageMap,
        recordings: Recordings,
        cot: CotLink | None,
    ) -> None:
        self._aircraft, self._targets, self._map = aircraft, targets, page_map
        self._recordings, self._cot = recordings, cot
        self._lock = threading.Lock()
        self._asked: defaultdict[_Key, list[asyncio.Future[Answer]]] = defaultdict(list)

    @property
    def targets(self) -> TargetStore:
        """Return the store of targets."""
        return self._targets

    async def click(self, click: Click) -> Located | str:
        """Return the ground point at a pixel, or why there is none; within a second."""
        key = click.aircraft, click.stamp_ns, click.u, click.v
        asked: asyncio.Future[Answer] = asyncio.get_running_loop().create_future()
        with self._lock:
            self._asked[key].append(asked)
        try:
            for wait_s in _TRIES_S:
                heard = self._aircraft[click.aircraft].click(*key[1:])
                done, _ = await asyncio.wait([asked], timeout=wait_s)
                if done:
                    answer = asked.result()
                    return answer.reason.value if isinstance(answer, Refusal) else answer
        finally:
            with self._lock:
                self._asked[key].remove(asked)
                if not self._asked[key]:
                    del self._asked[key]
        lacks = "did not answer within a second: press again" if heard else "does not run"
        return f"the overlay program {lacks}"

    def answered(self, aircraft: str, answer: Answer) -> None:
        """Pass an answer to whoever clicked there."""
        with self._lock:
            for asked in self._asked.get((aircraft, answer.stamp_ns, *answer.uv), ()):
                asked.get_loop().call_soon_threadsafe(_settle, asked, answer)

    async def where(self, aircraft: str, latitude_deg: float, longitude_deg: float) -> Pixel | str:
        """Return where a place is in the newest picture, or why it isn't there."""
        place = math.radians(latitude_deg), math.radians(longitude_deg)
        pixel = await asyncio.to_thread(self._aircraft[aircraft].where, *place)
        return pixel if isinstance(pixel, str) else Pixel(*pixel)

    async def record(self, aircraft: str, on: bool) -> str:
        """Begin or end a recording; return words for the operator."""
        work = self._recordings.begin if on else self._recordings.end
        words = await asyncio.to_thread(work, aircraft)
        return words + await self._kept(f"record {aircraft}", self._recordings.is_on(aircraft))

    async def share(self, on: bool) -> str:
        """Begin or end to send Cursor-on-Target; return words for the operator."""
        if self._cot is None:
            return "there is nowhere to send to: set the parameter cot of viewer_node"
        return self._cot.share(on) + await self._kept("share", on)

    async def _kept(self, what: str, on: bool) -> str:
        """Remember what is on, for the next run if this one is killed; return why it can't be."""
        try:
            await asyncio.to_thread(self._targets.switch, what, on)
        except TargetError as error:
            return f"; after a crash this is forgotten: {error}"
        return ""

    def vector_map(self, aircraft: str) -> bytes:  # noqa: ARG002  one map for all
        """Return the map as GeoJSON in WGS84; empty without one."""
        return self._map.read()


def _settle(asked: asyncio.Future[Answer], answer: Answer) -> None:
    if not asked.done():
        asked.set_result(answer)

"""Define what the page's server asks of the node behind it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.io.targets.store import TargetStore


@dataclass(frozen=True, slots=True)
class Click:
    """Hold a place in a picture that somebody clicked."""

    aircraft: str  # id; "" for the only one
    stamp_ns: int  # of the clicked picture
    u: float  # column and row in the full picture, pixels
    v: float


@dataclass(frozen=True, slots=True)
class Pixel:
    """Hold where a place of the map is in a picture."""

    stamp_ns: int  # of the picture
    u: float  # column and row in the full picture, pixels
    v: float


class Backend(Protocol):
    """Answer the page's requests.

    The server's asyncio loop awaits the coroutines, which must never block it. What is not a
    coroutine is called in threads. A refusal is its words, for the operator.
    """

    async def click(self, click: Click) -> Located | str:
        """Return the ground point at a pixel, or why there is none; within a second."""
        ...

    async def where(self, aircraft: str, latitude_deg: float, longitude_deg: float) -> Pixel | str:
        """Return where a place is in the newest picture, or why it isn't there."""
        ...

    async def record(self, aircraft: str, on: bool) -> str:
        """Begin or end a recording; return words for the operator."""
        ...

    async def share(self, on: bool) -> str:
        """Begin or end to send Cursor-on-Target; return words for the operator."""
        ...

    def vector_map(self, aircraft: str) -> bytes:
        """Return the map as GeoJSON in WGS84; empty without one."""
        ...

    @property
    def targets(self) -> TargetStore:
        """Return the store of targets."""
        ...

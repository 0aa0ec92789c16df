"""Decode and encode the broadcast push (set 02, id 00): a mask, then the parts that it names.

There are two layouts. The frame does not contain its layout, but its length identifies it. For the
same mask, no length fits both unless the parts have the same bytes and the same meaning. So a
frame is decoded in the layout that fits, the newer first, and refused if neither does.
"""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from functools import lru_cache
from typing import Any, NamedTuple

from tirgeo_ros.dji.protocol.broadcast_parts import (
    Battery,
    Device,
    Gimbal,
    Gps,
    GpsDetail,
    Position,
    Quaternion,
    Rc,
    RelativePosition,
    Rtk,
    Status,
    Time,
    Vector,
    Velocity,
)
from tirgeo_ros.dji.protocol.packed_fields import Make, PackedFields


class Layout(Enum):
    """List the layouts, by the firmware that packs them."""

    MODERN = "a3_osdk33"  # A3, N3, M600 with a firmware of 2017 or later (3.2.41 and so on)
    LEGACY = "a3_osdk31"  # M600 with 3.2.15.62, A3 with 3.1


class Broadcast(NamedTuple):
    """Hold one broadcast in the aircraft's own units (``broadcast_parts``).

    An absent part is None. Axes: ``quaternion_wxyz`` turns body FRD into ground NED.
    ``acceleration_as_packed`` is in g or m/s2, in the axes that DJI Assistant is set to (raw: g,
    FRD).
    """

    layout: Layout = Layout.MODERN
    time: Time | None = None
    quaternion_wxyz: Quaternion | None = None
    acceleration_as_packed: Vector | None = None
    velocity: Velocity | None = None
    angular_rate_radps: Vector | None = None
    position: Position | None = None
    relative_position: RelativePosition | None = None  # shares the bit of ``position``
    gps: Gps | None = None
    rtk: Rtk | None = None
    mag: tuple[int, int, int] | None = None
    rc: Rc | None = None
    gimbal: Gimbal | None = None
    status: Status | None = None
    battery: Battery | None = None
    device: Device | None = None
    compass: int | None = None

    @property
    def mask(self) -> int:
        """Return the frame's mask: a bit for each part that is present."""
        parts = _LAYOUTS[self.layout]
        return sum({1 << bit for bit, (name, *_) in parts if getattr(self, name) is not None})


_Part = tuple[str, str, Make]  # name in Broadcast, form as in ``struct``, maker

_MOTION: tuple[_Part, ...] = (
    ("quaternion_wxyz", "4f", tuple),
    ("acceleration_as_packed", "3f", tuple),
    ("velocity", "3fB", lambda v: Velocity(v[:3], v[3])),
    ("angular_rate_radps", "3f", tuple),
    ("position", "2d2fB", Position._make),
)
_RTK: _Part = ("rtk", "2I2d4fh2B", lambda v: Rtk._make((*v[:5], v[5:8], *v[8:])))
_MAG_RC_GIMBAL: tuple[_Part, ...] = (
    ("mag", "3h", tuple),
    ("rc", "6h", Rc._make),
    ("gimbal", "3fB", Gimbal._make),
)
_DEVICE: _Part = ("device", "2B", Device._make)

#: Bit of the mask and part, in the order of the bytes.
_LAYOUTS: dict[Layout, tuple[tuple[int, _Part], ...]] = {
    Layout.MODERN: (
        *enumerate([("time", "3IHB", Time._make), *_MOTION]),
        (5, ("relative_position", "6fB", RelativePosition._make)),
        (
            6,
            ("gps", "2I3i3f6f2I2H", lambda v: Gps._make((*v[:5], v[5:8], GpsDetail._make(v[8:])))),
        ),
        (7, _RTK),
        *enumerate(_MAG_RC_GIMBAL, 8),
        (11, ("status", "4B", Status._make)),
        (12, ("battery", "I2iB", Battery._make)),
        (13, _DEVICE),
        (14, ("compass", "B", lambda v: v[0])),
    ),
    Layout.LEGACY: (
        (0, ("time", "2IB", lambda v: Time(v[0], v[1], None, None, v[2]))),
        *enumerate(_MOTION, 1),
        (6, ("gps", "2I3i3f", lambda v: Gps._make((*v[:5], v[5:], None)))),
        (7, _RTK),
        *enumerate(_MAG_RC_GIMBAL, 8),
        (11, ("status", "B", lambda v: Status(v[0]))),
        (12, ("battery", "B", lambda v: Battery(None, None, None, v[0]))),
        (13, _DEVICE),
    ),
}


# Up to 2**16 masks in three layouts could be requested; an aircraft sends a handful.
@lru_cache(maxsize=256)
def _packed(layout: Layout, mask: int) -> PackedFields | None:
    """Return how the parts are packed; None where the layout does not define a bit of the mask."""
    parts = _LAYOUTS[layout]
    if mask & ~sum({1 << bit for bit, _ in parts}):
        return None
    return PackedFields("<H", [part for bit, part in parts if mask >> bit & 1])


class _Plan(NamedTuple):
    """Hold how to read the frames of one mask and length."""

    layout: Layout
    numbers: Callable[[bytes], tuple[Any, ...]]
    parts: tuple[tuple[int, int, int, Make], ...]  # place in Broadcast, numbers from, to


@lru_cache(maxsize=256)
def _fitting(mask: int, length: int) -> _Plan | None:
    for layout in Layout:
        packed = _packed(layout, mask)
        if packed and packed.size == length:
            place = Broadcast._fields.index
            return _Plan(
                layout,
                packed.numbers,
                tuple((place(name), a, b, make) for name, a, b, make in packed.parts),
            )
    return None


def broadcast_length(layout: Layout, mask: int) -> int | None:
    """Return the bytes of a broadcast's value with its mask; None if the layout lacks a bit."""
    packed = _packed(layout, mask)
    return None if packed is None else packed.size


def decode_broadcast(value: bytes) -> Broadcast | None:
    """Decode a broadcast's value (what follows set and id); None if no layout has its length."""
    plan = _fitting(value[0] | value[1] << 8, len(value)) if len(value) > 1 else None
    if plan is None:
        return None
    numbers = plan.numbers(value)
    parts: list[Any] = [None] * len(Broadcast._fields)
    parts[0] = plan.layout
    for place, start, stop, make in plan.parts:
        parts[place] = make(numbers[start:stop])
    return Broadcast._make(parts)


def encode_broadcast(broadcast: Broadcast) -> bytes:
    """Encode a broadcast's value; its parts must be those of its layout."""
    packed = _packed(broadcast.layout, broadcast.mask)
    assert packed is not None  # ``mask`` contains only bits of the layout
    return packed.pack([broadcast.mask], broadcast._asdict())

"""Decode and encode the broadcast push (set 02, id 00): a mask, then the parts that it names.

There are two layouts. The frame does not contain its layout, but its length identifies it. For the
same mask, no length fits both unless the parts have the same bytes and the same meaning. So a
frame is decoded in the layout that fits, the newer first, and refused if neither does.
"""

from __future__ import annotations

from enum import Enum
from functools import lru_cache
from typing import Any, NamedTuple

from tirgeo_ros.dji.protocol import rtk_gps_imu_parts as parts
from tirgeo_ros.dji.protocol.rtk_gps_imu_parts import Make, PackedFields


class Layout(Enum):
    """List the layouts, by the firmware that packs them."""

    MODERN = "a3_osdk33"  # A3, N3, M600 with a firmware of 2017 or later (3.2.41 and so on)
    LEGACY = "a3_osdk31"  # M600 with 3.2.15.62, A3 with 3.1


class Broadcast(NamedTuple):
    """Hold one broadcast in the aircraft's own units (``rtk_gps_imu_parts``).

    An absent part is None. Axes: ``quaternion_wxyz`` turns body FRD into ground NED.
    ``acceleration_as_packed`` is in g or m/s2, in the axes that DJI Assistant is set to (raw: g,
    FRD).
    """

    layout: Layout = Layout.MODERN
    time: parts.Time | None = None
    quaternion_wxyz: parts.Quaternion | None = None
    acceleration_as_packed: parts.Vector | None = None
    velocity: parts.Velocity | None = None
    angular_rate_radps: parts.Vector | None = None
    position: parts.Position | None = None
    relative_position: parts.RelativePosition | None = None  # shares the bit of ``position``
    gps: parts.Gps | None = None
    rtk: parts.Rtk | None = None
    mag: tuple[int, int, int] | None = None
    rc: parts.Rc | None = None
    gimbal: parts.Gimbal | None = None
    status: parts.Status | None = None
    battery: parts.Battery | None = None
    device: parts.Device | None = None
    compass: int | None = None

    @property
    def mask(self) -> int:
        """Return the frame's mask: a bit for each part that is present."""
        bits = _LAYOUTS[self.layout]
        return sum({1 << bit for bit, name, *_ in bits if getattr(self, name) is not None})


def _gps(v: tuple[Any, ...]) -> parts.Gps:
    return parts.Gps._make([*v[:5], v[5:8], parts.GpsDetail._make(v[8:]) if v[8:] else None])


_Part = tuple[int, str, str, Make]  # bit of the mask, name in Broadcast, form, maker

_MOTION: tuple[_Part, ...] = (
    (1, "quaternion_wxyz", "4f", tuple),
    (2, "acceleration_as_packed", "3f", tuple),
    (3, "velocity", "3fB", lambda v: parts.Velocity(v[:3], v[3])),
    (4, "angular_rate_radps", "3f", tuple),
    (5, "position", "2d2fB", parts.Position._make),
)
_MIDDLE: tuple[_Part, ...] = (
    (7, "rtk", "2I2d4fh2B", lambda v: parts.Rtk._make((*v[:5], v[5:8], *v[8:]))),
    (8, "mag", "3h", tuple),
    (9, "rc", "6h", parts.Rc._make),
    (10, "gimbal", "3fB", parts.Gimbal._make),
)
_DEVICE: _Part = (13, "device", "2B", parts.Device._make)

#: The parts in the order of the bytes, with their forms as in ``struct``.
_LAYOUTS: dict[Layout, tuple[_Part, ...]] = {
    Layout.MODERN: (
        (0, "time", "3IHB", parts.Time._make),
        *_MOTION,
        (5, "relative_position", "6fB", parts.RelativePosition._make),
        (6, "gps", "2I3i3f6f2I2H", _gps),
        *_MIDDLE,
        (11, "status", "4B", parts.Status._make),
        (12, "battery", "I2iB", parts.Battery._make),
        _DEVICE,
        (14, "compass", "B", lambda v: v[0]),
    ),
    Layout.LEGACY: (
        (0, "time", "2IB", lambda v: parts.Time(v[0], v[1], None, None, v[2])),
        *_MOTION,
        (6, "gps", "2I3i3f", _gps),
        *_MIDDLE,
        (11, "status", "B", lambda v: parts.Status(v[0])),
        (12, "battery", "B", lambda v: parts.Battery(None, None, None, v[0])),
        _DEVICE,
    ),
}


# Up to 2**16 masks in three layouts could be requested; an aircraft sends a handful.
@lru_cache(maxsize=256)
def _packed(layout: Layout, mask: int) -> PackedFields | None:
    """Return how the parts are packed; None where the layout does not define a bit of the mask."""
    bits = _LAYOUTS[layout]
    if mask & ~sum({1 << bit for bit, *_ in bits}):
        return None
    return PackedFields("<H", [part for bit, *part in bits if mask >> bit & 1])


@lru_cache(maxsize=256)
def _fitting(mask: int, length: int) -> tuple[Layout, PackedFields] | None:
    for layout in Layout:
        packed = _packed(layout, mask)
        if packed and packed.size == length:
            return layout, packed
    return None


def broadcast_length(layout: Layout, mask: int) -> int | None:
    """Return the bytes of a broadcast's value with its mask; None if the layout lacks a bit."""
    packed = _packed(layout, mask)
    return None if packed is None else packed.size


def decode_broadcast(value: bytes) -> Broadcast | None:
    """Decode a broadcast's value (what follows set and id); None if no layout has its length."""
    fitting = _fitting(value[0] | value[1] << 8, len(value)) if len(value) > 1 else None
    if fitting is None:
        return None
    layout, packed = fitting
    return Broadcast(layout, **packed.unpack(value)[1])


def encode_broadcast(broadcast: Broadcast) -> bytes:
    """Encode a broadcast's value; its parts must be those of its layout."""
    packed = _packed(broadcast.layout, broadcast.mask)
    assert packed is not None  # ``mask`` contains only bits of the layout
    return packed.pack([broadcast.mask], broadcast._asdict())

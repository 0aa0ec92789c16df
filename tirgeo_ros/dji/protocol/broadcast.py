"""Decode and encode the broadcast push (set 02, id 00): a mask, then the parts that it names.

There are three layouts. The frame does not contain its layout, but its length identifies it. For
the same mask, no length fits two layouts unless the parts have the same bytes and the same
meaning. So a frame is decoded in the layout that fits, the newest first, and refused if none does.
This holds for the M100's other meaning of bits 6 to 11 as well, hence nobody has to name the
aircraft.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from enum import Enum
from functools import lru_cache
from typing import Any, NamedTuple

from tirgeo_ros.core.types.errors import DjiError
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
    flat,
)

_MASK = struct.Struct("<H")


class Layout(Enum):
    """List the layouts, by the firmware that packs them."""

    MODERN = "a3_osdk33"  # A3, N3, M600 with a firmware of 2017 or later (3.2.41 and so on)
    LEGACY = "a3_osdk31"  # M600 with 3.2.15.62, A3 with 3.1
    M100 = "m100_osdk31"


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
        return sum(
            {1 << bit for bit, part in _LAYOUTS[self.layout] if self[part.slot] is not None}
        )


class _Part(NamedTuple):
    slot: int  # in Broadcast
    form: str  # as in ``struct``
    make: Callable[[tuple[Any, ...]], Any]


def _part(name: str, form: str, make: Callable[[tuple[Any, ...]], Any]) -> _Part:
    return _Part(Broadcast._fields.index(name), form, make)


def _time_31(v: tuple[Any, ...]) -> Time:
    return Time(v[0], v[1], None, None, v[2])


def _velocity(v: tuple[Any, ...]) -> Velocity:
    return Velocity(v[:3], v[3])


def _gps_31(v: tuple[Any, ...]) -> Gps:
    return Gps._make((*v[:5], v[5:], None))


def _gps(v: tuple[Any, ...]) -> Gps:
    return Gps._make((*v[:5], v[5:8], GpsDetail._make(v[8:])))


def _rtk(v: tuple[Any, ...]) -> Rtk:
    return Rtk._make((*v[:5], v[5:8], *v[8:]))


_QUATERNION = _part("quaternion_wxyz", "4f", tuple)
_ACCELERATION = _part("acceleration_as_packed", "3f", tuple)
_VELOCITY = _part("velocity", "3fB", _velocity)
_ANGULAR_RATE = _part("angular_rate_radps", "3f", tuple)
_POSITION = _part("position", "2d2fB", Position._make)
_OBSTACLES = _part("relative_position", "6fB", RelativePosition._make)
_RTK = _part("rtk", "2I2d4fh2B", _rtk)
_MAG = _part("mag", "3h", tuple)
_RC = _part("rc", "6h", Rc._make)
_GIMBAL = _part("gimbal", "3fB", Gimbal._make)
_DEVICE = _part("device", "2B", Device._make)
_TIME_31 = _part("time", "2IB", _time_31)
_STATUS_31 = _part("status", "B", lambda v: Status(v[0]))
_BATTERY_31 = _part("battery", "B", lambda v: Battery(None, None, None, v[0]))

#: Bit of the mask and part, in the order of the bytes.
_LAYOUTS: dict[Layout, tuple[tuple[int, _Part], ...]] = {
    Layout.MODERN: (
        (0, _part("time", "3IHB", Time._make)),
        (1, _QUATERNION),
        (2, _ACCELERATION),
        (3, _VELOCITY),
        (4, _ANGULAR_RATE),
        (5, _POSITION),
        (5, _OBSTACLES),
        (6, _part("gps", "2I3i3f6f2I2H", _gps)),
        (7, _RTK),
        (8, _MAG),
        (9, _RC),
        (10, _GIMBAL),
        (11, _part("status", "4B", Status._make)),
        (12, _part("battery", "I2iB", Battery._make)),
        (13, _DEVICE),
        (14, _part("compass", "B", lambda v: v[0])),
    ),
    Layout.LEGACY: (
        (0, _TIME_31),
        (1, _QUATERNION),
        (2, _ACCELERATION),
        (3, _VELOCITY),
        (4, _ANGULAR_RATE),
        (5, _POSITION),
        (6, _part("gps", "2I3i3f", _gps_31)),
        (7, _RTK),
        (8, _MAG),
        (9, _RC),
        (10, _GIMBAL),
        (11, _STATUS_31),
        (12, _BATTERY_31),
        (13, _DEVICE),
    ),
    Layout.M100: (
        (0, _TIME_31),
        (1, _QUATERNION),
        (2, _ACCELERATION),
        (3, _VELOCITY),
        (4, _ANGULAR_RATE),
        (5, _POSITION),
        (6, _MAG),
        (7, _RC),
        (8, _GIMBAL),
        (9, _STATUS_31),
        (10, _BATTERY_31),
        (11, _DEVICE),
    ),
}


class _Plan(NamedTuple):
    """Hold how to read or write the frames of one mask in one layout."""

    layout: Layout
    whole: struct.Struct
    parts: tuple[tuple[int, int, int, Callable[[tuple[Any, ...]], Any]], ...]  # slot, from, to


# Up to 2**16 masks in three layouts could be requested; an aircraft sends a handful.
@lru_cache(maxsize=256)
def _plan(layout: Layout, mask: int) -> _Plan | None:
    """Return the plan; None where the layout does not define a bit of the mask."""
    if mask & ~sum({1 << bit for bit, _ in _LAYOUTS[layout]}):
        return None
    form, at, parts = "<H", 1, []
    for bit, part in _LAYOUTS[layout]:
        if mask >> bit & 1:
            count = _numbers(part.form)
            parts.append((part.slot, at, at + count, part.make))
            form, at = form + part.form, at + count
    return _Plan(layout, struct.Struct(form), tuple(parts))


def _numbers(form: str) -> int:
    packed = struct.Struct(f"<{form}")
    return len(packed.unpack(bytes(packed.size)))


@lru_cache(maxsize=256)
def _fitting(mask: int, length: int) -> _Plan | None:
    plans = (_plan(layout, mask) for layout in Layout)
    return next((plan for plan in plans if plan and plan.whole.size == length), None)


def broadcast_length(layout: Layout, mask: int) -> int | None:
    """Return the bytes of a broadcast's value, mask included.

    Returns None where the layout lacks a bit.
    """
    plan = _plan(layout, mask)
    return None if plan is None else plan.whole.size


def decode_broadcast(value: bytes) -> Broadcast | None:
    """Decode a broadcast's value (what follows set and id).

    Returns None where no layout has its length.
    """
    if len(value) < _MASK.size:
        return None
    plan = _fitting(value[0] | value[1] << 8, len(value))
    if plan is None:
        return None
    numbers = plan.whole.unpack(value)
    parts: list[Any] = [None] * len(Broadcast._fields)
    parts[0] = plan.layout
    for slot, start, stop, make in plan.parts:
        parts[slot] = make(numbers[start:stop])
    return Broadcast._make(parts)


def encode_broadcast(broadcast: Broadcast) -> bytes:
    """Encode a broadcast's value.

    Raises DjiError for a part or number that the layout cannot hold.
    """
    plan = _plan(broadcast.layout, broadcast.mask)
    assert plan is not None  # ``mask`` contains only bits of the layout
    _refuse_strays(broadcast, plan)
    numbers: list[Any] = [broadcast.mask]
    for slot, start, stop, _ in plan.parts:
        part = flat(broadcast[slot])
        if len(part) != stop - start:
            raise DjiError(
                f"broadcast: {Broadcast._fields[slot]} needs {stop - start} numbers in "
                f"{broadcast.layout.value}"
            )
        numbers += part
    try:
        return plan.whole.pack(*numbers)
    except (struct.error, OverflowError) as error:
        raise DjiError(f"broadcast cannot be sent: {error}") from None


def _refuse_strays(broadcast: Broadcast, plan: _Plan) -> None:
    """Refuse parts for which the layout has no bit: they would be lost silently."""
    given = {slot for slot, part in enumerate(broadcast) if slot and part is not None}
    strays = given - {slot for slot, *_ in plan.parts}
    if strays:
        names = ", ".join(Broadcast._fields[slot] for slot in sorted(strays))
        raise DjiError(f"broadcast: {broadcast.layout.value} has no {names}")

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
"""Write the metadata of a picture, what it shows and from where, as MISB ST 0601.

A packet is a key, a length and items: tag, length, value, big endian. Numbers are mapped to
integers. ITEMS holds the items that are written, with their ranges; the reader of other makers'
streams (``io/logs/misb.py``) decodes them by the same table. An item is left out if its
value is unknown or out of range. The standard's error codes for such values are not used, because
common parsers (klvdata, QGIS FMV) lose the whole packet if it has one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

import numpy as np

from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.ground.frame_geometry import FrameGeometry, Sight, frame_geometry
from tirgeo_ros.core.types.arrays import Array, Vector

KEY = bytes.fromhex("060e2b34020b01010e01030101000000")
CHECKSUM, TIME, VERSION = 1, 2, 65
REVISION = 19  # of ST 0601
_MOST_TEXT = 127  # bytes
_SHORT = 128  # the smallest length that takes more than one byte
#: Beyond the range of these items, the same angle goes into the item with the larger range.
_FULL = {6: 90, 7: 91}
_CORNERS, _OFFSETS = range(82, 90), range(26, 34)  # tags

Value: TypeAlias = float | int | str


class Item(NamedTuple):
    """Define an item; ``low`` and ``high`` are nan for text and integers.

    A range from -m to m is mapped to signed integers, whose lowest stands for an error; any other
    to unsigned ones.
    """

    name: str
    unit: str
    length: int  # bytes; for text the most
    low: float = math.nan
    high: float = math.nan

    @property
    def step(self) -> float:
        """Return the difference between neighbouring values; nan for texts and integers."""
        return (self.high - self.low) / ((1 << 8 * self.length) - (2 if self._signed else 1))

    @property
    def _signed(self) -> bool:
        return self.low == -self.high

    def encoded(self, value: Value) -> bytes | None:
        """Return a value's bytes; None if it is unknown (nan) or out of range."""
        if isinstance(value, str):
            return value.encode()[:_MOST_TEXT].decode(errors="ignore").encode() or None
        if math.isnan(self.low):
            fits = math.isfinite(value) and 0 <= value < 1 << 8 * self.length
            return int(value).to_bytes(self.length, "big") if fits else None
        if not self.low <= value <= self.high:
            return None
        zero = 0.0 if self._signed else self.low
        number = round((value - zero) / self.step)
        return number.to_bytes(self.length, "big", signed=self._signed)

    def decoded(self, content: bytes) -> float:
        """Return a number's value from its bytes; nan for another length or the error code."""
        number = int.from_bytes(content, "big", signed=self._signed)
        if len(content) != self.length or (self._signed and number == -1 << 8 * self.length - 1):
            return math.nan
        if math.isnan(self.low):
            return float(number)
        return (0.0 if self._signed else self.low) + number * self.step


def _degrees(name: str, length: int, most: float) -> Item:
    return Item(name, "deg", length, -most, most)


def _turn(name: str, length: int) -> Item:
    return Item(name, "deg", length, 0.0, 360.0)


def _height(name: str) -> Item:
    return Item(name, "m", 2, -900.0, 19000.0)


def _places(first: int, name: str, length: int, most: tuple[float, float]) -> dict[int, Item]:
    """Return the items of four corners' latitudes and longitudes, the first with tag ``first``."""
    return {
        first + 2 * corner + axis: _degrees(name.format(word, corner + 1), length, most[axis])
        for corner in range(4)
        for axis, word in enumerate(("Latitude", "Longitude"))
    }


#: The items by tag.
ITEMS: Mapping[int, Item] = {
    CHECKSUM: Item("Checksum", "", 2),
    TIME: Item("Precision Time Stamp", "us", 8),
    5: _turn("Platform Heading Angle", 2),
    6: _degrees("Platform Pitch Angle", 2, 20.0),
    7: _degrees("Platform Roll Angle", 2, 50.0),
    10: Item("Platform Designation", "text", _MOST_TEXT),
    11: Item("Image Source Sensor", "text", _MOST_TEXT),
    12: Item("Image Coordinate System", "text", _MOST_TEXT),
    13: _degrees("Sensor Latitude", 4, 90.0),
    14: _degrees("Sensor Longitude", 4, 180.0),
    15: _height("Sensor True Altitude"),
    16: Item("Sensor Horizontal Field of View", "deg", 2, 0.0, 180.0),
    17: Item("Sensor Vertical Field of View", "deg", 2, 0.0, 180.0),
    18: _turn("Sensor Relative Azimuth Angle", 4),
    19: _degrees("Sensor Relative Elevation Angle", 4, 180.0),
    20: _turn("Sensor Relative Roll Angle", 4),
    21: Item("Slant Range", "m", 4, 0.0, 5e6),
    22: Item("Target Width", "m", 2, 0.0, 10000.0),
    23: _degrees("Frame Center Latitude", 4, 90.0),
    24: _degrees("Frame Center Longitude", 4, 180.0),
    25: _height("Frame Center Elevation"),
    **_places(26, "Offset Corner {} Point {}", 2, (0.075, 0.075)),
    45: Item("Target Error Estimate - CE90", "m", 2, 0.0, 4095.0),
    46: Item("Target Error Estimate - LE90", "m", 2, 0.0, 4095.0),
    VERSION: Item("UAS Datalink LS Version Number", "", 1),
    75: _height("Sensor Ellipsoid Height"),
    78: _height("Frame Center Height Above Ellipsoid"),
    **_places(82, "Corner {} Point {} (Full)", 4, (90.0, 180.0)),
    90: _degrees("Platform Pitch Angle (Full)", 4, 90.0),
    91: _degrees("Platform Roll Angle (Full)", 4, 90.0),
}


def packet(time_ns: int, values: Mapping[int, Value]) -> bytes:
    """Return a packet: the time since 1970 first, then version, values by tag and checksum.

    Values are in their items' units, mapped to the nearest step; nan is an unknown value.
    """
    first: dict[int, Value] = {TIME: max(time_ns, 0) // 1000, VERSION: REVISION}
    items = b""
    for tag, value in (first | dict(sorted(values.items()))).items():
        content = ITEMS[tag].encoded(value)
        if content is not None:
            items += bytes((tag,)) + ber(len(content)) + content  # tags below 128 take one byte
    head = KEY + ber(len(items) + 4) + items + bytes((CHECKSUM, 2))
    return head + checksum(head).to_bytes(2, "big")


def ber(length: int) -> bytes:
    """Return a length as BER: one byte below 128, else the number of bytes and the bytes."""
    if length < _SHORT:
        return bytes((length,))
    content = length.to_bytes((length.bit_length() + 7) // 8, "big")
    return bytes((0x80 + len(content),)) + content


def checksum(head: bytes) -> int:
    """Return the sum of the 16-bit words up to the checksum's own tag and length."""
    words = np.frombuffer(head + bytes(len(head) % 2), ">u2")
    return int(words.sum(dtype=np.uint64)) & 0xFFFF


class FrameMetadata:
    """Make packets for the pictures of one camera.

    ``confidence`` gives the sigmas besides the pose's; it may be replaced. Without
    ``undulation_m``, the height of the geoid above the ellipsoid, there are no heights above sea
    level. ``platform`` names the aircraft; it may be empty.
    """

    def __init__(
        self, confidence: ConfidenceConfig, undulation_m: float = math.nan, platform: str = ""
    ) -> None:
        self.confidence, self._undulation_m = confidence, undulation_m
        self._same: dict[int, Value] = {10: platform, 11: "Thermal", 12: "Geodetic WGS84"}

    def packet(self, time_ns: int, sight: Sight | None) -> bytes:
        """Return the packet of a picture that was exposed at ``time_ns``, ns since 1970.

        Without a trusted pose (None) it has only the time, never an old place.
        """
        if sight is None:
            return packet(time_ns, {})
        geometry = frame_geometry(sight, self.confidence)
        return packet(time_ns, {**self._same, **items_of(geometry, self._undulation_m)})


def items_of(geometry: FrameGeometry, undulation_m: float) -> dict[int, Value]:
    """Return a picture's values by tag, in the items' units; nan for unknown values."""
    tilt, pitch, heading = geometry.platform_rpy
    roll, elevation, azimuth = geometry.sensor_rpy
    values: dict[int, Value] = {
        5: _turn_deg(heading),
        **_platform(6, pitch),
        **_platform(7, tilt),
        **_place((13, 14, 75, 15), geometry.sensor, undulation_m),
        16: math.degrees(geometry.fields_of_view[0]),
        17: math.degrees(geometry.fields_of_view[1]),
        18: _turn_deg(azimuth),
        19: math.degrees(elevation),
        20: _turn_deg(roll),
        21: geometry.slant_range_m,
        22: geometry.width_m,
        **_place((23, 24, 78, 25), geometry.centre, undulation_m),
        45: geometry.ce90_m,
        46: geometry.le90_m,
    }
    return values | _corners(geometry)


def _turn_deg(angle_rad: float) -> float:
    return math.degrees(angle_rad) % 360.0


def _platform(tag: int, angle_rad: float) -> dict[int, Value]:
    angle_deg = math.degrees(angle_rad)
    return {_FULL[tag] if abs(angle_deg) > ITEMS[tag].high else tag: angle_deg}


def _place(
    tags: tuple[int, int, int, int], place: Vector, undulation_m: float
) -> dict[int, Value]:
    """Return latitude, longitude, ellipsoidal height and height above sea level by tag."""
    latitude_rad, longitude_rad, height_m = place
    degrees = math.degrees(latitude_rad), math.degrees(longitude_rad)
    return dict(zip(tags, (*degrees, height_m, height_m - undulation_m), strict=True))


def _corners(geometry: FrameGeometry) -> dict[int, Value]:
    """Return the corners by tag, also as offsets from the centre if all are in range."""
    corners_deg = np.degrees(geometry.corners)
    offsets_deg = corners_deg - np.degrees(geometry.centre[:2])
    offsets_deg[:, 1] = (offsets_deg[:, 1] + 180.0) % 360.0 - 180.0
    in_range = bool((np.abs(offsets_deg) <= ITEMS[_OFFSETS[0]].high).all())
    near = _by_tag(_OFFSETS, offsets_deg) if in_range else {}
    return {**near, **_by_tag(_CORNERS, corners_deg)}


def _by_tag(tags: range, corners_deg: Array) -> dict[int, Value]:
    return dict(zip(tags, corners_deg.ravel().tolist(), strict=True))

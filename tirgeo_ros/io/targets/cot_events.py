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
"""Encode targets, aircraft and what their cameras look at as Cursor-on-Target events.

Version 2.0, XML. The schema calls ``ce`` and ``le`` one standard deviation; TAK's programs read,
show and write CE90 and LE90 there, and so does this module. Every remark says so.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from tirgeo_ros.core.ground.frame_geometry import FrameGeometry
from tirgeo_ros.core.ground.ground_point import circular_error_90, linear_error_90
from tirgeo_ros.core.targets.target import COLOURS, NEW, Target
from tirgeo_ros.core.types.errors import cut
from tirgeo_ros.core.types.texts import legible, utc

#: Written in place of an unknown number.
UNKNOWN = "9999999.0"
_HEADER = b'<?xml version="1.0" encoding="UTF-8"?>\n'
#: Types: a spot on the map; a friendly drone with rotors, which TAK has only as a military symbol;
#: a sensor's point of interest; an order to delete.
_SPOT, _AIRCRAFT, _LOOKS_AT, _DELETE = "b-m-p-s-m", "a-f-A-M-H-Q", "b-m-p-s-p-i", "t-x-d-d"
#: How a position was obtained: from fused sensors; measured in a picture.
_FUSED, _IN_PICTURE = "m-f", "m-i"
#: After these times an event is stale. Until then servers keep it for clients that join.
_TARGET_VALID_S, _WITHDRAWN_VALID_S, _AIRCRAFT_VALID_S = 86400.0, 5.0, 30.0
#: Most characters. A datagram holds 65507 bytes, and a character may take six (``&quot;``). The
#: remarks that follow a note need some room.
_MOST_TEXT, _MOST_NOTE = 4000, 3000


@dataclass(frozen=True, slots=True)
class AircraftState:
    """Hold what the team sees of an aircraft; nan and None are unknown values."""

    name: str
    latitude_deg: float
    longitude_deg: float
    height_m: float  # ellipsoidal
    ce90_m: float = math.nan  # of the position
    le90_m: float = math.nan
    course_deg: float = math.nan  # of the motion, from true north, clockwise
    speed_m_s: float = math.nan
    view: FrameGeometry | None = None  # of the newest picture


def target_uid(target: Target) -> str:
    """Return the uid of a target's events: the same through all edits and exports."""
    return f"tirgeo-{target.id}"


def target_event(target: Target, now_ns: int, valid_s: float = _TARGET_VALID_S) -> ET.Element:
    """Return a target as a spot on the map, in its kind's colour, by default for a day."""
    place, colour = target.place, _argb(COLOURS[target.kind])
    errors = circular_error_90(place.covariance_n), linear_error_90(place.covariance_n)
    event = _event(target_uid(target), _SPOT, _IN_PICTURE, now_ns, valid_s)
    _add_point(event, place.latitude_deg, place.longitude_deg, place.height_m, *errors)
    clicks = len(target.clicks)
    remarks = (
        target.kind,
        "" if target.status == NEW else target.status,
        cut(target.note, _MOST_NOTE),
        f"seen {utc(place.stamp_ns)}",
        f"by {target.aircraft}" if target.aircraft else "",
        f"{clicks} clicks" if clicks > 1 else "",
        "" if target.clicks_agree else "the clicks disagree",
        _error_words(*errors),
    )
    name = f"{target.number} {target.name or target.kind}"
    detail = _add_detail(event, name, "; ".join(filter(None, remarks)))
    ET.SubElement(detail, "color", argb=str(colour))
    icon = f"COT_MAPPING_SPOTMAP/{_SPOT}/{colour}"
    ET.SubElement(detail, "usericon", iconsetpath=icon)
    ET.SubElement(detail, "precisionlocation", altsrc="CALC", geopointsrc="CALC")
    ET.SubElement(detail, "archive")
    return event


def withdrawn_event(target: Target, now_ns: int) -> ET.Element:
    """Return a deleted target's last event: stale so soon that clients that join don't get it."""
    return target_event(target, now_ns, _WITHDRAWN_VALID_S)


def deletion_event(target: Target, now_ns: int) -> ET.Element:
    """Return the event, with a uid of its own, that takes a target off the maps."""
    uid = target_uid(target)
    event = _event(f"{uid}-deleted", _DELETE, _IN_PICTURE, now_ns, _TARGET_VALID_S)
    _add_point(event, 0.0, 0.0)
    detail = ET.SubElement(event, "detail")
    # Without __forcedelete the target only goes stale; an empty type or relation is refused.
    ET.SubElement(detail, "link", uid=uid, relation="none", type="none")
    ET.SubElement(detail, "__forcedelete")
    return event


def aircraft_event(uid: str, state: AircraftState, now_ns: int) -> ET.Element:
    """Return an aircraft: place, course and speed, and its camera's field of view."""
    event = _event(uid, _AIRCRAFT, _FUSED, now_ns, _AIRCRAFT_VALID_S)
    errors = state.ce90_m, state.le90_m
    _add_point(event, state.latitude_deg, state.longitude_deg, state.height_m, *errors)
    detail = _add_detail(event, state.name, _error_words(*errors))
    motion = {"course": _direction(state.course_deg), "speed": state.speed_m_s}
    _add_finite(detail, "track", motion)
    if state.view is not None:
        roll, elevation, azimuth = map(math.degrees, state.view.sight_rpy)
        width, height = map(math.degrees, state.view.fields_of_view)
        # TAK draws a fan as long as ``range``: it ends at the ground in the picture's middle.
        reach_m = state.view.slant_range_m * math.cos(state.view.sight_rpy[1])
        angles = {"azimuth": _direction(azimuth), "elevation": elevation, "roll": roll}
        _add_finite(detail, "sensor", angles | {"fov": width, "vfov": height, "range": reach_m})
    ET.SubElement(detail, "precisionlocation", altsrc="GPS", geopointsrc="GPS")
    return event


def looks_at_event(uid: str, state: AircraftState, now_ns: int) -> ET.Element | None:
    """Return the ground in the picture's middle, linked to the aircraft; None if unknown."""
    view = state.view
    if view is None or not all(map(math.isfinite, view.centre)):
        return None
    event = _event(f"{uid}-looks-at", _LOOKS_AT, _IN_PICTURE, now_ns, _AIRCRAFT_VALID_S)
    latitude, longitude, height_m = view.centre
    errors = view.ce90_m, view.le90_m
    _add_point(event, math.degrees(latitude), math.degrees(longitude), height_m, *errors)
    detail = _add_detail(event, f"{state.name} looks here", _error_words(*errors))
    ET.SubElement(detail, "link", uid=_one_line(uid), type=_AIRCRAFT, relation="p-p")
    return event


def encoded(event: ET.Element) -> bytes:
    """Return an event for the network: XML header, line feed, event, and nothing after it."""
    return _HEADER + ET.tostring(event, "unicode").encode()


def _event(uid: str, kind: str, how: str, now_ns: int, valid_s: float) -> ET.Element:
    """Return an event without children: made at ``now_ns``, stale ``valid_s`` later."""
    now, stale = utc(now_ns), utc(now_ns + round(valid_s * 1e9))
    event = ET.Element("event", version="2.0", uid=_one_line(uid), type=kind, how=how)
    event.attrib |= {"time": now, "start": now, "stale": stale}
    return event


def _add_point(
    event: ET.Element,
    latitude_deg: float,
    longitude_deg: float,
    height_m: float = math.nan,
    ce90_m: float = math.nan,
    le90_m: float = math.nan,
) -> None:
    """Add the event's point: the height is ellipsoidal; nan is written as unknown."""
    metres = {"hae": height_m, "ce": ce90_m, "le": le90_m}
    place = {"lat": f"{latitude_deg:.7f}", "lon": f"{longitude_deg:.7f}"}
    place |= {key: f"{x:.3f}" if math.isfinite(x) else UNKNOWN for key, x in metres.items()}
    ET.SubElement(event, "point", place)


def _add_detail(event: ET.Element, name: str, remarks: str) -> ET.Element:
    """Add and return the event's detail, with the name that maps show and the remarks."""
    detail = ET.SubElement(event, "detail")
    ET.SubElement(detail, "contact", callsign=_one_line(name))
    ET.SubElement(detail, "remarks").text = _one_line(remarks)
    return detail


def _add_finite(detail: ET.Element, tag: str, numbers: dict[str, float]) -> None:
    """Add a child with the numbers that are finite, if any is."""
    finite = {key: f"{x:.3f}" for key, x in numbers.items() if math.isfinite(x)}
    if finite:
        ET.SubElement(detail, tag, finite)


def _direction(angle_deg: float) -> float:
    """Return an angle in [0, 360), also after rounding to three decimals."""
    return round(angle_deg, 3) % 360 if math.isfinite(angle_deg) else math.nan


def _error_words(ce90_m: float, le90_m: float) -> str:
    """Return what ``ce`` and ``le`` of a point mean, for a person."""
    if not math.isfinite(ce90_m):
        return "accuracy not known"
    return f"90 % within {ce90_m:.1f} m (ce is CE90), height {le90_m:.1f} m (le is LE90)"


def _argb(colour: str) -> int:
    """Return a colour as Android's signed 32-bit number of alpha, red, green, blue."""
    return int(colour[1:], 16) - (1 << 24)


def _one_line(text: str) -> str:
    """Return a text, at most 4000 characters, as XML allows it; line breaks become spaces."""
    return " ".join(legible(cut(text, _MOST_TEXT)).split())

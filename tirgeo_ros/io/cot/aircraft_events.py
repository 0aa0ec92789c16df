"""Say an aircraft, what its camera sees and where it looks as Cursor-on-Target events."""

from __future__ import annotations

import math
from dataclasses import dataclass
from xml.etree import ElementTree as ET

from tirgeo_ros.core.ground.frame_geometry import FrameGeometry
from tirgeo_ros.io.cot.event import add_point, add_text, error_words, new_event, printable

#: A friendly drone with rotors: TAK's symbols have it among the military ones alone.
_AIRCRAFT = "a-f-A-M-H-Q"
_LOOKS_AT = "b-m-p-s-p-i"
#: Fused sensors; measured in a picture.
_FUSED, _IN_PICTURE = "m-f", "m-i"
_VALID_S = 30.0


@dataclass(frozen=True, slots=True)
class AircraftState:
    """Hold what the team sees of an aircraft; nan and None are what is not known."""

    name: str
    latitude_deg: float
    longitude_deg: float
    height_m: float  # ellipsoidal
    ce90_m: float = math.nan  # of the position
    le90_m: float = math.nan
    course_deg: float = math.nan  # of the motion, from true north, clockwise
    speed_m_s: float = math.nan
    view: FrameGeometry | None = None  # of the newest picture


def aircraft_event(uid: str, state: AircraftState, now_ns: int) -> ET.Element:
    """Return an aircraft: place, course and speed, and its camera's field of view."""
    event = new_event(uid, _AIRCRAFT, _FUSED, now_ns, _VALID_S)
    errors = state.ce90_m, state.le90_m
    add_point(event, state.latitude_deg, state.longitude_deg, state.height_m, *errors)
    detail = ET.SubElement(event, "detail")
    ET.SubElement(detail, "contact", callsign=printable(state.name))
    motion = {"course": _direction(state.course_deg), "speed": state.speed_m_s}
    _add_known(detail, "track", motion)
    if state.view is not None:
        _add_known(detail, "sensor", _field_of_view(state.view))
    ET.SubElement(detail, "precisionlocation", altsrc="GPS", geopointsrc="GPS")
    add_text(detail, "remarks", error_words(*errors))
    return event


def looks_at_event(uid: str, state: AircraftState, now_ns: int) -> ET.Element | None:
    """Return the sensor's point of interest, linked to the aircraft; None where it has none.

    It is the ground in the picture's middle.
    """
    view = state.view
    if view is None or not all(map(math.isfinite, view.centre)):
        return None
    event = new_event(f"{uid}-looks-at", _LOOKS_AT, _IN_PICTURE, now_ns, _VALID_S)
    latitude, longitude, height_m = view.centre
    place = math.degrees(latitude), math.degrees(longitude), height_m
    add_point(event, *place, view.ce90_m, view.le90_m)
    detail = ET.SubElement(event, "detail")
    ET.SubElement(detail, "contact", callsign=printable(f"{state.name} looks here"))
    ET.SubElement(detail, "link", uid=printable(uid), type=_AIRCRAFT, relation="p-p")
    add_text(detail, "remarks", error_words(view.ce90_m, view.le90_m))
    return event


def _field_of_view(view: FrameGeometry) -> dict[str, float]:
    """Return the field of view: degrees against the earth, metres.

    TAK's maps draw a flat fan as long as ``range``: the level distance to what the picture's
    middle shows, so that the fan ends there.
    """
    roll, elevation, azimuth = map(math.degrees, view.sight_rpy)
    width, height = map(math.degrees, view.fields_of_view)
    return {
        "azimuth": _direction(azimuth),
        "elevation": elevation,
        "roll": roll,
        "fov": width,
        "vfov": height,
        "range": view.slant_range_m * math.cos(view.sight_rpy[1]),
    }


def _direction(angle_deg: float) -> float:
    """Return an angle in [0, 360), also after rounding to three decimals."""
    return round(angle_deg, 3) % 360 if math.isfinite(angle_deg) else math.nan


def _add_known(detail: ET.Element, tag: str, numbers: dict[str, float]) -> None:
    """Add a child with the numbers that are known, if any is."""
    known = {key: f"{x:.3f}" for key, x in numbers.items() if math.isfinite(x)}
    if known:
        ET.SubElement(detail, tag, known)

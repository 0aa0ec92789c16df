"""Say targets as Cursor-on-Target events, and take them off the maps again."""

from __future__ import annotations

from xml.etree import ElementTree as ET

from tirgeo_ros.core.ground.ground_point import circular_error_90, linear_error_90
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.errors import cut
from tirgeo_ros.io.cot.event import add_point, add_text, error_words, new_event, printable, utc

#: A spot of the map, found in a picture.
_SPOT, _HOW = "b-m-p-s-m", "m-i"
#: Colour of a kind, as Android's signed 32-bit number of alpha, red, green, blue.
COLOURS = {
    "person": -65536,  # red
    "fire": -35072,  # orange
    "vehicle": -16776961,  # blue
    "hydrant": -16711681,  # cyan
    "building": -256,  # yellow
}
_WHITE = -1
_VALID_S = 86400.0
#: So that the words after the note have their place.
_MOST_NOTE = 3000
#: Servers keep an event for newcomers until it is stale.
_WITHDRAWN_VALID_S = 5.0


def target_uid(target: Target) -> str:
    """Return the uid of a target's events: the same through all edits and exports."""
    return f"tirgeo-{target.id}"


def target_event(target: Target, now_ns: int) -> ET.Element:
    """Return a target as a spot of the map, in its kind's colour, for a day."""
    return _target_event(target, now_ns, _VALID_S)


def withdrawn_event(target: Target, now_ns: int) -> ET.Element:
    """Return a deleted target's last event: it is stale so soon that no newcomer gets it."""
    return _target_event(target, now_ns, _WITHDRAWN_VALID_S)


def deletion_event(target: Target, now_ns: int) -> ET.Element:
    """Return the event, with a uid of its own, that takes a target off the maps."""
    uid = target_uid(target)
    event = new_event(f"{uid}-deleted", "t-x-d-d", _HOW, now_ns, _VALID_S)
    add_point(event, 0.0, 0.0)
    detail = ET.SubElement(event, "detail")
    # Without __forcedelete the target only goes stale; an empty type or relation is refused.
    ET.SubElement(detail, "link", uid=uid, relation="none", type="none")
    ET.SubElement(detail, "__forcedelete")
    return event


def _target_event(target: Target, now_ns: int, valid_s: float) -> ET.Element:
    place, colour = target.place, COLOURS.get(target.kind, _WHITE)
    errors = circular_error_90(place.covariance_n), linear_error_90(place.covariance_n)
    event = new_event(target_uid(target), _SPOT, _HOW, now_ns, valid_s)
    add_point(event, place.latitude_deg, place.longitude_deg, place.height_m, *errors)
    detail = ET.SubElement(event, "detail")
    name = printable(f"{target.number} {target.name or target.kind}")
    ET.SubElement(detail, "contact", callsign=name)
    add_text(detail, "remarks", f"{_words(target)}; {error_words(*errors)}")
    ET.SubElement(detail, "color", argb=str(colour))
    icon = f"COT_MAPPING_SPOTMAP/{_SPOT}/{colour}"
    ET.SubElement(detail, "usericon", iconsetpath=icon)
    ET.SubElement(detail, "precisionlocation", altsrc="CALC", geopointsrc="CALC")
    ET.SubElement(detail, "archive")
    return event


def _words(target: Target) -> str:
    """Return what a person is told of a target: kind, note, when, by whom, how often."""
    clicks = len(target.clicks)
    said = (
        target.kind,
        cut(target.note, _MOST_NOTE),
        f"seen {utc(target.place.stamp_ns)}",
        f"by {target.aircraft}" if target.aircraft else "",
        f"{clicks} clicks" if clicks > 1 else "",
        "" if target.clicks_agree else "the clicks disagree",
    )
    return "; ".join(word for word in said if word)

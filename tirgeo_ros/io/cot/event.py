"""Make one Cursor-on-Target event: its attributes, its point, its text.

Version 2.0, XML. The schema calls ``ce`` and ``le`` one standard deviation; TAK's programs read,
show and write CE90 and LE90 there, and so does this package. Every remark says so.
"""

from __future__ import annotations

import math
from datetime import datetime, timedelta, timezone
from xml.etree import ElementTree as ET

from tirgeo_ros.core.types.errors import cut

#: What stands where a number is not known.
UNKNOWN = "9999999.0"
#: A datagram holds 65507 bytes at most; a letter may take six of them (``&quot;``).
_MOST_TEXT = 4000
_HEADER = b'<?xml version="1.0" encoding="UTF-8"?>\n'


def new_event(uid: str, kind: str, how: str, now_ns: int, valid_s: float) -> ET.Element:
    """Return an event without children: made at ``now_ns``, stale ``valid_s`` later."""
    now, stale = utc(now_ns), utc(now_ns + round(valid_s * 1e9))
    event = ET.Element("event", version="2.0", uid=printable(uid), type=kind, how=how)
    event.attrib |= {"time": now, "start": now, "stale": stale}
    return event


def add_point(
    event: ET.Element,
    latitude_deg: float,
    longitude_deg: float,
    height_m: float = math.nan,
    ce90_m: float = math.nan,
    le90_m: float = math.nan,
) -> None:
    """Add the event's point: the height is ellipsoidal; nan is written as not known."""
    metres = {"hae": height_m, "ce": ce90_m, "le": le90_m}
    said = {"lat": f"{latitude_deg:.7f}", "lon": f"{longitude_deg:.7f}"}
    said |= {key: f"{x:.3f}" if math.isfinite(x) else UNKNOWN for key, x in metres.items()}
    ET.SubElement(event, "point", said)


def error_words(ce90_m: float, le90_m: float) -> str:
    """Say for a person what ``ce`` and ``le`` of a point mean."""
    if not math.isfinite(ce90_m):
        return "accuracy not known"
    return f"90 % within {ce90_m:.1f} m (ce is CE90), height {le90_m:.1f} m (le is LE90)"


def add_text(parent: ET.Element, tag: str, text: str) -> None:
    """Add a child that holds a text."""
    ET.SubElement(parent, tag).text = printable(text)


def printable(text: str) -> str:
    """Return a text, at most 4000 characters, as XML allows it; line breaks become spaces."""
    known = "".join(c for c in cut(text, _MOST_TEXT) if c.isprintable() or c.isspace())
    return " ".join(known.split())


def utc(stamp_ns: int) -> str:
    """Return ISO 8601, UTC with Z, to a millisecond, rounded down."""
    since = timedelta(milliseconds=stamp_ns // 1_000_000)
    moment = datetime(1970, 1, 1, tzinfo=timezone.utc) + since
    return moment.replace(tzinfo=None).isoformat(timespec="milliseconds") + "Z"


def encoded(event: ET.Element) -> bytes:
    """Return an event as it goes over the network: XML header, line feed, event, nothing more."""
    return _HEADER + ET.tostring(event, "unicode").encode()

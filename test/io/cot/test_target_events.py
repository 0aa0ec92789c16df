"""Targets as Cursor-on-Target: what TAK reads in the events."""

from __future__ import annotations

import dataclasses
import math
from xml.etree import ElementTree as ET

import pytest

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import KINDS, Target
from tirgeo_ros.io.cot.events import (
    COLOURS,
    deletion_event,
    encoded,
    target_event,
    withdrawn_event,
)

SEEN_NS = 1_634_731_235_605_555_556  # 2021-10-20, 12:00:35.605 UTC
NOW_NS = SEEN_NS + 60_000_000_000
#: 2 m in each level direction and 0.5 m up, one standard deviation.
ROUND = (4.0, 0, 0, 0, 4.0, 0, 0, 0, 0.25)
CLICK = Located(SEEN_NS, 48.20817425, -16.37381885, 211.25, ROUND)
TARGET = Target("0123456789abcdef" * 2, 7, "", "fire", "", "", SEEN_NS, SEEN_NS, (CLICK,))
HOSTILE = "</remarks><__forcedelete/> \"'&<![CDATA[ ]]> \x00\x07\ud800\u202e\nnext line"


def parsed(event):
    return ET.fromstring(encoded(event))


def test_a_target_is_a_spot_with_place_errors_and_colour():
    event = parsed(target_event(TARGET, NOW_NS))
    assert event.attrib == {
        "version": "2.0",
        "uid": "tirgeo-" + TARGET.id,
        "type": "b-m-p-s-m",
        "how": "m-i",
        "time": "2021-10-20T12:01:35.605Z",
        "start": "2021-10-20T12:01:35.605Z",
        "stale": "2021-10-21T12:01:35.605Z",
    }
    point = event.find("point").attrib
    assert (point["lat"], point["lon"], point["hae"]) == ("48.2081742", "-16.3738188", "211.250")
    # CE90 of a circular normal distribution is sqrt(-2 ln 0.1) sigma, LE90 1.6449 sigma.
    assert float(point["ce"]) == pytest.approx(2 * math.sqrt(-2 * math.log(0.1)), abs=1e-3)
    assert float(point["le"]) == pytest.approx(0.5 * 1.644854, abs=1e-3)
    assert event.find("detail/contact").get("callsign") == "7 fire"
    assert event.find("detail/color").get("argb") == "-35072"
    icon = event.find("detail/usericon").get("iconsetpath")
    assert icon == "COT_MAPPING_SPOTMAP/b-m-p-s-m/-35072"
    assert event.find("detail/archive") is not None
    remarks = event.find("detail/remarks").text
    assert remarks.startswith("fire; seen 2021-10-20T12:00:35.605Z; 90 % within 4.3 m")
    assert "CE90" in remarks
    assert "LE90" in remarks


def test_colours_are_those_that_their_names_say():
    as_rgb = {kind: f"{colour & 0xFFFFFFFF:08x}" for kind, colour in COLOURS.items()}
    assert as_rgb == {
        "person": "ffff0000",
        "fire": "ffff7700",
        "vehicle": "ff0000ff",
        "hydrant": "ff00ffff",
        "building": "ffffff00",
    }
    assert {*COLOURS} | {"other"} == {*KINDS}


def test_name_note_and_clicks_are_said():
    clicks = (CLICK, dataclasses.replace(CLICK, latitude_deg=48.21, stamp_ns=SEEN_NS + 10**9))
    told = dataclasses.replace(
        TARGET, name="roof", note="two floors", aircraft="uav1", clicks=clicks
    )
    event = parsed(target_event(told, NOW_NS))
    assert event.find("detail/contact").get("callsign") == "7 roof"
    remarks = event.find("detail/remarks").text
    for words in ("two floors", "by uav1", "2 clicks", "the clicks disagree"):
        assert words in remarks


def test_hostile_text_stays_text():
    event = parsed(
        target_event(dataclasses.replace(TARGET, name=HOSTILE, note=HOSTILE + "x" * 9000), NOW_NS)
    )
    harmless = "</remarks><__forcedelete/> \"'&<![CDATA[ ]]> next line"
    assert event.find("detail/contact").get("callsign") == "7 " + harmless
    remarks = event.find("detail/remarks").text
    assert harmless in remarks
    assert "CE90" in remarks  # a long note does not push it out
    assert event.find(".//__forcedelete") is None
    assert len(encoded(target_event(dataclasses.replace(TARGET, note='"' * 9000), 0))) < 65507


def test_a_deletion_names_the_target_and_is_no_event_of_it():
    event = parsed(deletion_event(TARGET, NOW_NS))
    assert event.get("type") == "t-x-d-d"
    assert event.get("uid") not in {"", "tirgeo-" + TARGET.id}
    link = event.find("detail/link").attrib
    assert link == {"uid": "tirgeo-" + TARGET.id, "relation": "none", "type": "none"}
    assert event.find("detail/__forcedelete") is not None
    assert set(event.find("point").attrib) == {"lat", "lon", "hae", "ce", "le"}


def test_a_withdrawn_target_is_soon_stale():
    event = withdrawn_event(TARGET, NOW_NS)
    assert event.get("uid") == "tirgeo-" + TARGET.id
    assert event.get("stale") == "2021-10-20T12:01:40.605Z"


def test_bytes_are_one_header_one_event_and_nothing_after():
    data = encoded(target_event(TARGET, NOW_NS))
    assert data.startswith(b'<?xml version="1.0" encoding="UTF-8"?>\n<event ')
    assert data.endswith(b"</event>")
    assert data.count(b"<?xml") == 1

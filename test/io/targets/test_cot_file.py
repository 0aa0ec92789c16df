"""Located points as Cursor-on-Target: what its readers find."""

from __future__ import annotations

import math
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Located, Refusal
from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.cot_file import cot

STAMP_NS = 1_634_731_235_605_555_556  # 2021-10-20, 12:00:35.605 UTC
PLACE = TangentPlane(math.radians(39.85), math.radians(116.7), 11.5)
#: 2 m and 0.5 m (one sigma), the longer towards 30 deg; 0.1 m up.
TURN = math.radians(30)
AXES = np.array([[math.cos(TURN), -math.sin(TURN)], [math.sin(TURN), math.cos(TURN)]])
COVARIANCE = np.zeros((3, 3))
COVARIANCE[:2, :2] = AXES @ np.diag([4.0, 0.25]) @ AXES.T
COVARIANCE[2, 2] = 0.01
FOUND = Located(
    STAMP_NS,
    (320.5, 256.25),
    np.zeros(3),
    COVARIANCE,
    PLACE.latitude_rad,
    PLACE.longitude_rad,
    PLACE.height_m,
)
REFUSED = Refusal(STAMP_NS + 5, (1.0, 2.0), Reason.ABOVE_HORIZON)
ANSWERS = [Answered("sheep <1> & \x07Ü", FOUND), Answered("cloud", REFUSED)]


def test_cursor_on_target_events_are_those_of_targets_with_ce90_and_le90():
    events = list(ET.fromstring(cot(ANSWERS)).iter("event"))
    assert len(events) == 1
    event = events[0].attrib
    assert event["uid"].startswith("tirgeo-")
    assert (event["version"], event["type"], event["how"]) == ("2.0", "b-m-p-s-m", "m-i")
    assert event["time"] == event["start"] == "2021-10-20T12:00:35.605Z"
    assert event["stale"] == "2021-10-21T12:00:35.605Z"
    assert events[0].find("detail/contact").get("callsign") == "1 sheep <1> & Ü"
    assert "CE90" in events[0].find("detail/remarks").text
    point = {key: float(value) for key, value in events[0].find("point").attrib.items()}
    ce90_m, le90_m = point.pop("ce"), point.pop("le")
    assert point == {"lat": 39.85, "lon": 116.7, "hae": 11.5}
    # 90 % of a normal distribution with these sigmas lie in the circle: drawn, to 4 sigma of 4e5
    drawn = np.random.default_rng(1).normal(size=(400_000, 2)) * [2.0, 0.5]
    share = np.mean(np.hypot(*drawn.T) <= ce90_m)
    assert abs(share - 0.9) < 4 * math.sqrt(0.09 / 400_000)
    assert le90_m == pytest.approx(0.1 * 1.644854, abs=1e-3)

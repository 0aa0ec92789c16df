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
"""Clicks and targets for tests."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Located, Refusal
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.io.surveys.survey import Answered

STAMP_NS = 1_634_731_235_605_555_556  # 2021-10-20, 12:00:35.605 UTC
PLACE = TangentPlane(math.radians(39.85), math.radians(116.7), 11.5)
#: 2 m and 0.5 m (one sigma), the longer towards 30 deg; 0.1 m up.
_TURN = math.radians(30)
_AXES_EN = np.array([[math.cos(_TURN), math.sin(_TURN)], [-math.sin(_TURN), math.cos(_TURN)]])
COVARIANCE = np.zeros((3, 3))
COVARIANCE[:2, :2] = _AXES_EN @ np.diag([0.25, 4.0]) @ _AXES_EN.T
COVARIANCE[2, 2] = 0.01


def click(east_m=0.0, north_m=0.0, up_m=0.0, *, after_s=0.0, covariance=COVARIANCE, plane=PLACE):
    """A click at some metres from a place."""
    latitude, longitude, height_m = plane.geodetic_from_ned(np.array([north_m, east_m, -up_m]))
    return Located(
        STAMP_NS + round(after_s * 1e9),
        math.degrees(latitude),
        math.degrees(longitude),
        float(height_m),
        tuple(np.ravel(covariance).tolist()),
    )


def target(number=1, *clicks, **text):
    """A target, at the place unless there are clicks."""
    text = {"name": "", "kind": "person", "note": "", "aircraft": ""} | text
    times = {"created_ns": STAMP_NS, "changed_ns": STAMP_NS + number}
    return Target(f"{number:032x}", number, **text, **times, clicks=clicks or (click(),))


def east_north_up(one, plane=PLACE):
    """Where a click is (3,), in the axes at the place, m."""
    place = np.radians([one.latitude_deg, one.longitude_deg])
    north, east, down = plane.ned_from_geodetic(*place, one.height_m)
    return np.array([east, north, -down])


FOUND = dataclasses.replace(click(), uv=(320.5, 256.25))
REFUSED = Refusal(STAMP_NS + 5, (1.0, 2.0), Reason.ABOVE_HORIZON)
ANSWERS = [Answered("sheep <1> & \x07Ü", FOUND), Answered("cloud", REFUSED)]
TARGETS = [
    target(1, name="Huber", kind="fire", note="roof\nwest", aircraft="uav1"),
    target(3, click(5), click(6, after_s=60)),
]
#: Formulae, markup, control characters.
HOSTILE = [
    "=1+1",
    "@SUM(A1)",
    "'=1+1",
    "+49 171",
    "-2",
    "<script>alert(1)</script>",
    "</name><x>&lt;b>&amp;]]>",
    "$[description]",
    'a,"b";c\nd',
    "\u202egpj",
    "\ud800",
    "'",
    "\ttab",
]

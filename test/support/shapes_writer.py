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
"""Shapes of a frame from plain lists, written as the node writes them."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.io.messages.shapes_codec import Strokes, WrittenShapes

PLAIN = {
    "v": 1,
    "size": [640, 512],
    "grey": True,
    "celsius": None,
    "layers": [],
    "labels": [],
    "ellipses": [],
    "targets": [],
    "notices": [],
    "status": [],
    "bar": None,
    "heading_deg": None,
}


def encoded(words, rings=(), lines=(), marks=()):
    """Return the bytes of shapes.

    ``words`` hold what differs from PLAIN. A ring is (layer, flag, points (N, 2)), a line is
    (layer, opacity in quarters, points), a mark is (layer, point (2,)).
    """
    marks = [(layer, 0, [point]) for layer, point in marks]
    strokes = (_strokes(runs) for runs in (rings, lines, marks))
    return WrittenShapes({**PLAIN, **words}, *strokes).to_bytes()


def _strokes(runs):
    points = np.vstack([np.empty((0, 2)), *(run[2] for run in runs)])
    starts = np.cumsum([0, *(len(run[2]) for run in runs)])
    layer, extra = (np.array([run[k] for run in runs], np.int64) for k in (0, 1))
    return Strokes(np.rint(4 * points).astype(np.int64).T, starts, layer, extra)

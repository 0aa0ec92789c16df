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
"""The page as it is served, with the simulated node of page_backend.py behind it."""

from __future__ import annotations

import cv2
import numpy as np
import page_backend
from browser import Screen
from page_backend import (
    EAST_M,
    HEIGHT,
    M_PER_PIXEL,
    NORTH_M,
    PLOT_M,
    PLOTS,
    WIDTH,
    pixel_of,
    place_of,
)
from page_clients import Served

from tirgeo_ros.core.targets.target import Target

#: Chi-square of two degrees of freedom, 95 %.
ELLIPSE = 5.991


class ServedPage(Served):
    """A page for a browser: its address has the token, and its pictures leave time to draw."""

    hz = 10.0

    @property
    def url(self) -> str:
        return self.server.operator_url

    @property
    def targets(self) -> list[Target]:
        return self.backend.targets.all()


def well(monkeypatch, **changes):
    """Let the simulated aircraft report no finding, and ``changes``."""
    state_at = page_backend.state_at

    def report(*of):
        return {**state_at(*of), "findings": [], **changes}

    monkeypatch.setattr(page_backend, "state_at", report)


def corner_in(stamp_ns: int) -> tuple[float, float]:
    """Return the pixel of the plots' upper left corner that is nearest to the picture's middle."""
    corners = [place_of(e - PLOT_M, n + PLOT_M) for e, n in PLOTS]
    pixels = [pixel_of(stamp_ns, *corner) for corner in corners]
    return min(pixels, key=lambda pixel: np.hypot(pixel[0] - WIDTH / 2, pixel[1] - HEIGHT / 2))


def press(screen: Screen) -> None:
    """Touch the corner of a plot in a still picture; its row is then there."""
    before = screen.page.locator(".row").count()
    screen.tap(*screen.on_screen(*corner_in(screen.hold_still())))
    screen.wait("(n) => document.querySelectorAll('.row').length > n", before)
    screen.tap_on("#still")


def corner_on(screenshot: bytes) -> tuple[float, float] | None:
    """Return where a plot's corner is on a picture of the screen; None if none is seen whole."""
    image = cv2.imdecode(np.frombuffer(screenshot, np.uint8), cv2.IMREAD_COLOR).astype(np.float32)
    blue, green, red = np.moveaxis(image, 2, 0)
    yellow = np.maximum(np.minimum(green, red) - blue, 0)
    high, wide = yellow.shape
    side = round(2 * PLOT_M / M_PER_PIXEL * min(high / HEIGHT, wide / WIDTH))
    outline = np.zeros((side + 9, side + 9), np.float32)
    cv2.rectangle(outline, (4, 4), (4 + side, 4 + side), 1.0, 2)
    alike = cv2.matchTemplate(yellow, outline, cv2.TM_CCOEFF_NORMED)
    down, right = np.mgrid[: alike.shape[0], : alike.shape[1]]
    aside = np.hypot(right + side / 2 - wide / 2, down + side / 2 - high / 2)
    alike[aside > high / 3] = 0  # the sky and the words over the picture are above
    _, likeness, _, (left, top) = cv2.minMaxLoc(alike)
    return (left + 4.0, top + 4.0) if likeness > 0.5 else None


def off_corner(target: Target) -> tuple[float, float]:
    """Return how far a target is from the nearest true corner: metres, and chi-square."""
    corners = [(e - PLOT_M, n + PLOT_M) for e, n in PLOTS]
    places = [place_of(*corner) for corner in corners]
    place = target.place
    offsets = [
        np.array([(place.longitude_deg - lon) * EAST_M, (place.latitude_deg - lat) * NORTH_M])
        for lat, lon in places
    ]
    off = min(offsets, key=np.linalg.norm)
    covariance = np.reshape(place.covariance_enu, (3, 3))[:2, :2]
    return float(np.linalg.norm(off)), float(off @ np.linalg.solve(covariance, off))

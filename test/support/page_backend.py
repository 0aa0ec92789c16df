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
"""A simulated node behind the page: a camera that circles over a square of coloured plots.

``python test/support/page_backend.py`` serves the page with it. ``--help`` says what else it can.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import math
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from shapes_writer import encoded

from tirgeo_ros.core.config.viewer_parameters import ViewerConfig
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.page.actions import Click, Pixel
from tirgeo_ros.page.routes import invitation
from tirgeo_ros.page.server import PageServer

WIDTH, HEIGHT, HZ = 640, 512, 30.0
LATITUDE, LONGITUDE, GROUND_M = 48.2081743, 16.3738189, 190.0
M_PER_PIXEL, SKY_ROWS = 0.1, 40  # nothing above SKY_ROWS has a ground point
NORTH_M, EAST_M = 111_200.0, 111_320.0 * math.cos(math.radians(LATITUDE))  # in a degree
SIGMA_M = (0.5, 0.3, 0.4)
PLOTS = [(e, n) for e in range(-60, 61, 20) for n in range(-60, 61, 20)]  # centres, m
PLOT_M = 3.0  # half a side
GO = {"word": "GO", "tone": "good", "kind": "", "text": "", "more": "", "alarm": False}
LOST = {
    "word": "LOST",
    "tone": "bad",
    "kind": "position",
    "text": "No position, as the IMU's time went back",
    "more": "imu/data went back by 29.990 s",
    "alarm": True,
}


def camera_at(stamp_ns):
    """East, north (m) of what is in the middle of the picture of a stamp."""
    turn = stamp_ns * 1e-9 % 60 / 60 * 2 * math.pi
    return 30 * math.cos(turn), 30 * math.sin(turn)


def place_of(east, north):
    return LATITUDE + north / NORTH_M, LONGITUDE + east / EAST_M


def place_at(stamp_ns, u, v):
    """Latitude, longitude (deg) at a pixel."""
    east, north = camera_at(stamp_ns)
    right, up = (u - WIDTH / 2) * M_PER_PIXEL, (HEIGHT / 2 - v) * M_PER_PIXEL
    return place_of(east + right, north + up)


def pixel_of(stamp_ns, latitude_deg, longitude_deg):
    east, north = camera_at(stamp_ns)
    right = (longitude_deg - LONGITUDE) * EAST_M - east
    up = (latitude_deg - LATITUDE) * NORTH_M - north
    return WIDTH / 2 + right / M_PER_PIXEL, HEIGHT / 2 - up / M_PER_PIXEL


class SimulatedBackend:
    """Answers clicks from the pose of their stamp, as ``page/actions.py`` says."""

    def __init__(self, targets, answer_s=0.02, has_outages=False):
        self.targets = targets
        self._has_outages = has_outages
        self.newest_ns = {}
        self.recording, self.sharing = {}, False
        self._answer_s = answer_s
        rings = [[_corner(e, n, k) for k in (0, 1, 2, 3, 0)] for e, n in PLOTS]
        features = [
            {
                "type": "Feature",
                "properties": {"name": f"plot {k}"},
                "geometry": {"type": "Polygon", "coordinates": [ring]},
            }
            for k, ring in enumerate(rings)
        ]
        result = {"type": "FeatureCollection", "features": features}
        self._map = json.dumps(result).encode()

    def is_out(self, stamp_ns):
        """Return whether there is no pose: for five seconds of each minute, or never."""
        return self._has_outages and stamp_ns * 1e-9 % 60 > 55

    async def click(self, click: Click) -> Located | str:
        await asyncio.sleep(self._answer_s)
        if not (0 <= click.u < WIDTH and 0 <= click.v < HEIGHT):
            return "the pixel is outside the picture"
        if click.v < SKY_ROWS:
            return "the ray does not meet the ground"
        place = place_at(click.stamp_ns, click.u, click.v)
        covariance = tuple(np.diag(SIGMA_M).ravel() ** 2)
        return Located(click.stamp_ns, *place, GROUND_M, covariance, temperature_c=21.5)

    async def where(self, aircraft, latitude_deg, longitude_deg) -> Pixel | str:
        stamp_ns = self.newest_ns.get(aircraft)
        if stamp_ns is None:
            return "there is no video yet"
        u, v = pixel_of(stamp_ns, latitude_deg, longitude_deg)
        if not (0 <= u < WIDTH and 0 <= v < HEIGHT):
            return "it is outside the picture"
        return Pixel(stamp_ns, u, v)

    async def record(self, aircraft, on):
        self.recording[aircraft] = on
        return "recording" if on else "recorded 12 s"

    async def share(self, on):
        self.sharing = on
        return "sharing" if on else "sharing ended"

    def vector_map(self, aircraft):  # noqa: ARG002 the same for all
        return self._map


def _corner(east, north, k):
    east += PLOT_M if k in {1, 2} else -PLOT_M
    north += PLOT_M if k in {2, 3} else -PLOT_M
    latitude, longitude = place_of(east, north)
    return longitude, latitude


LAYERS = [
    {"name": "plots", "line": "#ffff00", "width": 1, "fill": "#00a0ff", "fill_opacity": 0.15},
    {"name": "hydrants", "line": "#ff8040", "width": 2, "fill": None, "fill_opacity": 0},
]
CELSIUS = (10.0, 61.0)  # of black and white


CODE_BITS, CODE_PX = 16, 24


def code_of(stamp_ns):
    """Return the bits of a stamp that are in the picture's bottom row, as black and white."""
    return stamp_ns // 1_000_000 % 2**CODE_BITS


class Pictures:
    """Makes what the camera sees, as JPEG of some 90 kB, and the map of it."""

    def __init__(self):
        rng = np.random.default_rng(1)
        self._noise = rng.integers(40, 110, (2 * HEIGHT, 2 * WIDTH), np.uint8)
        self._noise = cv2.GaussianBlur(self._noise, (0, 0), 0.8)

    def jpeg(self, stamp_ns):
        shift = stamp_ns // 7919 % HEIGHT, stamp_ns // 104729 % WIDTH
        grey = self._noise[shift[0] : shift[0] + HEIGHT, shift[1] : shift[1] + WIDTH].copy()
        for _, pixels in _plots_in(stamp_ns):
            cv2.fillPoly(grey, [np.rint(pixels).astype(np.int32)], (150,))
            cv2.circle(grey, [round(x) for x in pixels.mean(axis=0)], 8, (230,), -1)
        for bit in range(CODE_BITS):
            left, white = bit * CODE_PX, code_of(stamp_ns) >> bit & 1
            grey[-CODE_PX:, left : left + CODE_PX] = 235 if white else 20
        return cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, 85])[1].tobytes()

    def shapes(self, stamp_ns, targets, is_out=False):
        """Return outlines and names of the plots, a hydrant in each, and the targets."""
        plots = _plots_in(stamp_ns)
        marks = [(1, pixels.mean(axis=0)) for _, pixels in plots]
        half = PLOT_M / M_PER_PIXEL
        head = {
            "size": [WIDTH, HEIGHT],
            "celsius": CELSIUS,
            "layers": LAYERS,
            "labels": [
                *(
                    [f"plot {k}", *pixels.mean(axis=0), 0, 2, half, half, False]
                    for k, pixels in plots
                ),
                *([f"H{k}", *pixels.mean(axis=0), 1, 1, 0, 0, k % 4 == 0] for k, pixels in plots),
            ],
            "ellipses": [[*mark[1], 18, 12, 0.4, 1, False] for mark in marks],
            "targets": [_target_mark(stamp_ns, target) for target in targets],
            "status": [["filter", 0], ["40 m above ground", 0], [str(stamp_ns), 0]],
            "bar": [12, 112, HEIGHT - 30, 100 * M_PER_PIXEL],
            "heading_deg": stamp_ns * 1e-9 * 6 % 360,
        }
        if is_out:
            return encoded(
                {**head, "labels": [], "targets": [], "ellipses": [], "bar": None}
                | {"notices": [["NO MAP: no pose for 2.0 s", 2]]}
            )
        rings = [(0, 0, pixels) for _, pixels in plots]
        lines = [(0, 4, pixels[[0, 1, 2, 3, 0]]) for _, pixels in plots]
        return encoded(head, rings, lines, marks)


def _plots_in(stamp_ns):
    """Return number and corners (4, 2) of the plots in view."""
    result = []
    for k, (east, north) in enumerate(PLOTS):
        corners = [_corner(east, north, c) for c in range(4)]
        pixels = np.array([pixel_of(stamp_ns, lat, lon) for lon, lat in corners])
        if (pixels > -60).all() and (pixels < 700).all():
            result.append((k, pixels))
    return result


def _target_mark(stamp_ns, target):
    u, v = pixel_of(stamp_ns, target.place.latitude_deg, target.place.longitude_deg)
    text = f"{target.number} {target.name}".strip()
    return [target.id, text, u, v, SIGMA_M[0] * 2.45 / M_PER_PIXEL, 8, 0.0]


def state_at(backend, aircraft, stamp_ns, points):
    """A state as viewer_node reports it."""
    east, north = camera_at(stamp_ns)
    bad = backend.is_out(stamp_ns)
    corners = [(0, 0), (WIDTH, 0), (WIDTH, HEIGHT), (0, HEIGHT)]
    finding = {
        "severity": "STOP" if bad else "NOTE",
        "subject": "RTK is not fixed" if bad else "no boresight was given",
        "evidence": "status 1 for 5 s" if bad else "the default is no angle",
        "parameter": "rtk/fix" if bad else "gimbal_node boresight_rpy_deg",
        "remedy": "wait, or look at the base station" if bad else "tirgeo calibrate boresight",
    }
    return {
        "stamp_ns": str(stamp_ns),
        "navigation": {"state": "lost" if bad else "running", "reason": "no RTK" if bad else ""},
        "no_map": "no pose for 2.0 s" if bad else "",
        "rtk": "float" if bad else "fixed",
        "position": [*place_of(east, north), GROUND_M + 40],
        "heading_deg": stamp_ns * 1e-9 * 6 % 360,
        "heading_sigma_deg": math.nan if bad else 0.21,
        "position_sigma_m": 0.03,
        "speed_m_s": 3.1,
        "above_ground_m": 40.0,
        "ages_s": {"video": 0.05, "pose": 0.02, "camera": 0.03, "rtk": 0.1},
        "video_hz": HZ,
        "track": points,
        "footprint": [place_at(stamp_ns, u, v) for u, v in corners],
        "findings": [finding],
        "verdict": LOST if bad else GO,
        "recording": backend.recording.get(aircraft, False),
        "sharing": {"on": backend.sharing, "queued": 0, "connected": backend.sharing},
    }


class SimulatedFlight:
    """Feeds a server with pictures and states from a thread of its own until it is stopped."""

    def __init__(self, server, backend, aircraft=("",), hz=HZ):
        self._server, self._backend = server, backend
        self._aircraft, self._hz = aircraft, hz
        self._pictures = Pictures()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self):
        self._thread.start()
        return self

    def __exit__(self, *_):
        self._over.set()
        self._thread.join()

    def _run(self):
        count = 0
        while not self._over.wait(1 / self._hz - time.time() % (1 / self._hz)):
            stamp_ns = time.time_ns()
            jpeg = self._pictures.jpeg(stamp_ns)
            if count % round(self._hz / 5) == 0:
                targets = self._backend.targets.all()
            shapes = self._pictures.shapes(stamp_ns, targets, self._backend.is_out(stamp_ns))
            for aircraft in self._aircraft:
                self._backend.newest_ns[aircraft] = stamp_ns
                self._server.show(aircraft, stamp_ns, jpeg, shapes=shapes)
                if count % round(self._hz / 5) == 0:
                    point = place_of(*camera_at(stamp_ns))
                    state = state_at(self._backend, aircraft, stamp_ns, [point])
                    self._server.report(aircraft, state)
            count += 1


def main():
    parser = argparse.ArgumentParser(prog="python test/support/page_backend.py")
    parser.add_argument("--listen", default="127.0.0.1:8080", help="default: %(default)s")
    parser.add_argument("--token", default="", help="of operators")
    parser.add_argument("--tiles", default="", help="MBTiles file")
    parser.add_argument("--targets", type=Path, help="file of the targets; default: a new one")
    parser.add_argument("--aircraft", default="", help="ids, separated by commas")
    parser.add_argument("--outages", action="store_true", help="no map in 5 s of each minute")
    args = parser.parse_args()
    config = replace(ViewerConfig(), listen=args.listen, token=args.token, tiles=args.tiles)
    with tempfile.TemporaryDirectory() as folder:
        targets = TargetStore(args.targets or Path(folder) / "targets.gpkg")
        backend = SimulatedBackend(targets, has_outages=args.outages)
        aircraft = {name: name or "aircraft" for name in args.aircraft.split(",")}
        server = PageServer(backend, config, aircraft)
        server.start()
        sys.stdout.write(f"{invitation(server.operator_url)}\n")
        sys.stdout.write(f"viewers: {server.viewer_url or 'the same'}\n")
        sys.stdout.flush()
        try:
            with SimulatedFlight(server, backend, tuple(aircraft)):
                threading.Event().wait()
        except KeyboardInterrupt:
            server.stop()


if __name__ == "__main__":
    main()

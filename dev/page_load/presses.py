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
"""Press on surveyed points, live and later: ``python -m dev.page_load.presses FLIGHT``.

FLIGHT is a folder as ``tirgeo simulate`` leaves it. ``tirgeo demo --page``
plays it to the real nodes. Each observation is pressed as soon as its picture is there, and again
after the last of them, when its whole picture is fetched to go back to.
"""

from __future__ import annotations

import argparse
import asyncio
import csv
import json
import math
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import aiohttp
import numpy as np
import pyproj

from dev.graphs import shown_demo
from dev.judging import Figure, print_figures
from dev.page_load.served import click_text

_LATE_NS, _LAST_NS, _LIMIT_S = 500_000_000, 15_000_000_000, 20.0
_GEOD = pyproj.Geod(ellps="WGS84")


class Observation(NamedTuple):
    """Hold where a surveyed point is in a picture, and its place."""

    stamp_ns: int
    u: float
    v: float
    latitude_deg: float
    longitude_deg: float


def observations(flight: Path) -> list[Observation]:
    """Read the observations of a flight, in order of time."""
    survey = json.loads((flight / "survey.geojson").read_text())["features"]
    places = {f["properties"]["id"]: f["geometry"]["coordinates"] for f in survey}
    seen = []
    with (flight / "observations.csv").open() as file:
        for row in csv.DictReader(file):
            longitude_deg, latitude_deg = places[row["id"]][:2]
            pixel = float(row["u"]), float(row["v"])
            seen.append(Observation(int(row["stamp_ns"]), *pixel, latitude_deg, longitude_deg))
    return sorted(seen)


class Presser:
    """Press through the page's sockets, as a browser does."""

    def __init__(self, state: aiohttp.ClientWebSocketResponse) -> None:
        self._state = state
        self._newest_ns, self._news, self._count = 0, asyncio.Event(), 0
        self._answers: dict[str, asyncio.Future[dict[str, Any]]] = {}

    async def read(self) -> None:
        """Take states and answers, for ever."""
        async for message in self._state:
            data = json.loads(message.data)
            if data["type"] == "state" and data["stamp_ns"]:
                self._newest_ns = int(data["stamp_ns"])
                self._news.set()
            elif data["type"] == "answer":
                self._answers.pop(data["request"]).set_result(data)

    async def until(self, stamp_ns: int) -> None:
        """Wait for a state that is not older."""
        while self._newest_ns < stamp_ns:
            self._news.clear()
            await self._news.wait()

    async def press(self, seen: Observation) -> dict[str, Any]:
        """Return the answer to a press on an observation."""
        self._count += 1
        name = f"press {self._count} of {seen.stamp_ns}"
        self._answers[name] = asyncio.get_running_loop().create_future()
        answer = self._answers[name]
        click = json.loads(click_text(name, seen.stamp_ns)) | {"u": seen.u, "v": seen.v}
        await self._state.send_str(json.dumps(click))
        return await asyncio.wait_for(answer, _LIMIT_S)


def figures(flight: Path) -> Iterator[Figure]:
    """Yield how far the places are off, and how many lie in their ellipses."""
    seen = observations(flight)
    seen = [one for one in seen if one.stamp_ns < seen[-1].stamp_ns - _LAST_NS]  # time to press
    files = "--params", flight / "params.yaml", "--map", flight / "map.geojson"
    with (
        tempfile.TemporaryDirectory() as name,
        shown_demo(Path(name), "--bag", flight / "flight.mcap", *files) as (url, _),
    ):
        live, rewound = asyncio.run(_pressed(url, seen))
    for what, answers in (("live", live), ("rewound", rewound)):
        yield from _judged(what, seen, answers)


async def _pressed(url: str, seen: list[Observation]) -> tuple[list[Any], list[Any]]:
    async with (
        aiohttp.ClientSession(headers={"Origin": url}) as session,
        session.ws_connect(f"{url}/state", max_msg_size=0) as state,
    ):
        presser = Presser(state)
        reading = asyncio.create_task(presser.read())
        live, rewound = [], []
        for one in seen:
            await presser.until(one.stamp_ns + _LATE_NS)
            live.append(await presser.press(one))
        for one in seen:
            async with session.get(f"{url}/frame//{one.stamp_ns}") as answer:
                gone = {"ok": False, "reason": "gone"}
                rewound.append(await presser.press(one) if answer.status == 200 else gone)
        reading.cancel()
    return live, rewound


def _judged(what: str, seen: list[Observation], answers: list[dict[str, Any]]) -> Iterator[Figure]:
    pairs = [(o, a["target"]) for o, a in zip(seen, answers, strict=True) if a["ok"]]
    refused = {a["reason"] for a in answers if not a["ok"]}
    off = np.array([_off(one, target) for one, target in pairs])
    yield Figure(f"{what}: presses answered", len(pairs), f"of {len(seen)} {refused or ''}")
    yield Figure(f"{what}: root mean square", math.sqrt((off[:, 0] ** 2).mean()), "m", "<= 0.15")
    yield Figure(f"{what}: in their ellipses", 100 * (off[:, 1] <= 1).mean(), "%", ">= 95")


def _off(one: Observation, target: dict[str, Any]) -> tuple[float, float]:
    """Return how far a target is off, m, and squared in units of its 95 % ellipse."""
    there = target["longitude_deg"], target["latitude_deg"]
    azimuth_deg, _, off_m = _GEOD.inv(one.longitude_deg, one.latitude_deg, *there)
    ellipse = target["ellipse"]
    turn = math.radians(azimuth_deg - ellipse["azimuth_deg"])
    along, across = off_m * math.cos(turn), off_m * math.sin(turn)
    return off_m, (along / ellipse["major_m"]) ** 2 + (across / ellipse["minor_m"]) ** 2


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m dev.page_load.presses")
    parser.add_argument("flight", type=Path, metavar="FLIGHT", help="folder of a simulated flight")
    print_figures(figures(parser.parse_args().flight))
    return 0


if __name__ == "__main__":
    sys.exit(main())

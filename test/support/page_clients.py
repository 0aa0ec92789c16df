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
"""Served pages for tests, and who opens them: as a page would, and with bytes of one's own."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import re
import resource
import socket
import sqlite3
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

import aiohttp
from page_backend import HZ, SimulatedBackend, SimulatedFlight
from project import PROJECT

from tirgeo_ros.core.config.viewer_parameters import ViewerConfig
from tirgeo_ros.io.targets.store import TargetStore
from tirgeo_ros.page.server import PageServer

OPERATOR_TOKEN, VIEWER_TOKEN = "operator-of-a-test", "viewer-of-a-test"
LIMIT_S = 90.0  # a node starts slowly on a busy machine
UPGRADE = (
    *("Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13"),
    "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
)
TOKENS = {"token": OPERATOR_TOKEN, "viewer_token": VIEWER_TOKEN}


class Served:
    """A server on a free port, a flight to look at, and what both hold.

    ``stop`` and ``start`` are a restart of the node. Parked aircraft send nothing.
    """

    hz = HZ

    def __init__(self, folder, aircraft=("",), parked=(), **config):
        self.file = folder / "targets.gpkg"
        self.config = replace(ViewerConfig(), **{"listen": "127.0.0.1:0", **config})
        self.flying = tuple(aircraft)
        self.aircraft = {name: name or "aircraft" for name in (*aircraft, *parked)}
        self.start()

    def start(self):
        self.backend = SimulatedBackend(TargetStore(self.file))
        self.server = PageServer(self.backend, self.config, self.aircraft)
        self.server.start()
        self.config = replace(self.config, listen=f"127.0.0.1:{self.port}")  # after a restart too
        self._flight = SimulatedFlight(self.server, self.backend, self.flying, self.hz)
        self._flight.__enter__()

    def stop(self):
        self._flight.__exit__()
        self.server.stop()
        self.backend.targets.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.stop()

    @property
    def url(self):
        return self.server.operator_url.partition("?")[0].rstrip("/")

    @property
    def port(self):
        return urlsplit(self.server.operator_url).port


class ServedApart:
    """A page in a process of its own, with its own memory; ``words`` are page_backend.py's."""

    def __init__(self, *words):
        command = [sys.executable, "test/support/page_backend.py", "--listen", "127.0.0.1:0"]
        paths = os.pathsep.join([str(PROJECT), str(PROJECT / "test/support")])
        self.process = subprocess.Popen(
            [*command, *map(str, words)],
            cwd=PROJECT,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "PYTHONPATH": paths},
        )

    def __enter__(self):
        for line in self.process.stdout:
            if result := re.match(r"http://127.0.0.1:(\d+)", line):
                self.url, self.port = result[0], int(result[1])
                return self
        raise AssertionError("the page did not start")

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()

    @property
    def memory_bytes(self):
        pages = Path(f"/proc/{self.process.pid}/statm").read_text().split()[1]
        return int(pages) * resource.getpagesize()


class Page:
    """What a browser does: its origin goes with all it sends."""

    def __init__(self, url, **options):
        self.url = url
        jar = aiohttp.CookieJar(unsafe=True)  # of an address, not a name
        self.session = aiohttp.ClientSession(headers={"Origin": url}, cookie_jar=jar, **options)

    async def __aenter__(self):
        return self

    async def __aexit__(self, *_):
        await self.session.close()

    async def enter(self, token):
        async with self.session.post(f"{self.url}/enter", json={"token": token}) as answer:
            return answer.status

    async def get(self, path, **options):
        async with self.session.get(f"{self.url}{path}", **options) as answer:
            return answer.status, await answer.read()

    @contextlib.asynccontextmanager
    async def state(self):
        async with self.session.ws_connect(f"{self.url}/state") as socket_:
            yield StateClient(socket_)

    def video(self, **options):
        return self.session.ws_connect(f"{self.url}/video/", **options)


class StateClient:
    """A page's WebSocket of states and requests."""

    def __init__(self, socket_):
        self.socket = socket_
        self._count = 0
        self._told = []

    async def until(self, kind, good=lambda _: True):
        """The first message of a type that is good, of those not asked for yet."""
        return await asyncio.wait_for(self._until(kind, good), LIMIT_S)

    async def _until(self, kind, good):
        observed = 0
        while True:
            for at in range(observed, len(self._told)):
                if self._told[at]["type"] == kind and good(self._told[at]):
                    return self._told.pop(at)
            observed = len(self._told)
            self._told.append(json.loads((await self.socket.receive()).data))

    async def ask(self, kind, /, **fields):
        """The answer to a request."""
        self._count += 1
        name = fields.pop("request", f"r{self._count}")
        await self.socket.send_str(json.dumps({"type": kind, "request": name, **fields}))
        return await self.until("answer", lambda told: told["request"] == name)

    async def click(self, stamp_ns, u=320.0, v=256.0, **fields):
        place = {"aircraft": "", "stamp_ns": str(stamp_ns), "u": u, "v": v}
        return await self.ask("click", **{**place, "kind": "person", "refine": None, **fields})


async def next_picture(video):
    """Stamp and number of the next picture, which is answered."""
    data = (await asyncio.wait_for(video.receive(), LIMIT_S)).data
    number = int.from_bytes(data[16:20], "little")
    await video.send_str(f"shown {number}")
    return int.from_bytes(data[:8], "little"), number


def tile_file(path, form="png"):
    """An MBTiles file with two pictures, if that is what they are."""
    with sqlite3.connect(path) as db:
        db.execute("create table metadata (name text, value text)")
        db.execute(
            "create table tiles (zoom_level int, tile_column int, tile_row int, tile_data blob)"
        )
        db.execute("insert into metadata values ('format', ?)", (form,))
        db.execute("insert into tiles values (2, 1, 3, ?)", (b"north",))
        db.execute("insert into tiles values (5, 1, 3, ?)", (b"deep",))
    db.close()
    return path


def status(port, request):
    """The status of the answer to bytes."""
    with socket.create_connection(("127.0.0.1", port), 20) as own:
        own.sendall(request)
        return int(own.recv(1024).split()[1])


def raw_answer(port, request, wait_s=20.0):
    """All that a server says to bytes, until it closes or 1 kB has come."""
    with socket.create_connection(("127.0.0.1", port), wait_s) as own:
        own.sendall(request)
        return received(own)


def received(own):
    message_text = b""
    with contextlib.suppress(ConnectionResetError):
        while len(message_text) < 1024 and (part := own.recv(4096)):
            message_text += part
    return message_text


def http(path, *headers, method="GET"):
    """A request's bytes, as nobody checks them."""
    return "\r\n".join([f"{method} {path} HTTP/1.1", *headers, "", ""]).encode("latin-1")

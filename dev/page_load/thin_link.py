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
"""Be a thin link of a long way: a proxy in a process of its own."""

from __future__ import annotations

import asyncio
import multiprocessing
import socket
from multiprocessing.connection import Connection

_PACKET, _BUFFER = 1400, 16 * 1024  # bytes


class ThinLink:
    """Pass connections on to a port of this computer: so many bits a second, so late each way."""

    def __init__(self, port: int, bits_a_s: float, delay_s: float) -> None:
        context = multiprocessing.get_context("spawn")
        self._ours, theirs = context.Pipe()
        self._process = context.Process(
            target=_run, args=(port, bits_a_s, delay_s, theirs), daemon=True
        )

    def __enter__(self) -> int:
        """Return the port of the near end."""
        self._process.start()
        return int(self._ours.recv())

    def __exit__(self, *_: object) -> None:
        """End all connections."""
        self._process.terminate()
        self._process.join()


def _run(port: int, bits_a_s: float, delay_s: float, theirs: Connection) -> None:
    asyncio.run(_pass_on(port, bits_a_s, delay_s, theirs))


async def _pass_on(port: int, bits_a_s: float, delay_s: float, theirs: Connection) -> None:
    loop = asyncio.get_running_loop()
    near = _small(socket.socket())
    near.bind(("127.0.0.1", 0))
    near.listen()
    near.setblocking(False)
    down, up = _Wire(bits_a_s, delay_s), _Wire(bits_a_s, delay_s)
    theirs.send(near.getsockname()[1])
    tasks = []
    while True:
        client, _ = await loop.sock_accept(near)
        far = _small(socket.socket())
        far.setblocking(False)
        await loop.sock_connect(far, ("127.0.0.1", port))
        _small(client).setblocking(False)
        tasks += [
            loop.create_task(down.carry(far, client)),
            loop.create_task(up.carry(client, far)),
        ]


class _Wire:
    """Carry bytes one way; all connections share it."""

    def __init__(self, bits_a_s: float, delay_s: float) -> None:
        self._byte_s, self._delay_s = 8 / bits_a_s, delay_s
        self._free_s = 0.0

    async def carry(self, source: socket.socket, sink: socket.socket) -> None:
        """Pass packets on, each when the wire is free."""
        loop = asyncio.get_running_loop()
        flying: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()
        landing = loop.create_task(_land(flying, sink))
        while data := await loop.sock_recv(source, _PACKET):
            self._free_s = max(self._free_s, loop.time()) + len(data) * self._byte_s
            await asyncio.sleep(self._free_s - loop.time())
            flying.put_nowait((loop.time() + self._delay_s, data))
        landing.cancel()


async def _land(flying: asyncio.Queue[tuple[float, bytes]], sink: socket.socket) -> None:
    loop = asyncio.get_running_loop()
    while True:
        at_s, data = await flying.get()
        await asyncio.sleep(max(0.0, at_s - loop.time()))
        await loop.sock_sendall(sink, data)


def _small(own: socket.socket) -> socket.socket:
    """Give a socket small buffers: a link holds little."""
    for option in (socket.SO_SNDBUF, socket.SO_RCVBUF):
        own.setsockopt(socket.SOL_SOCKET, option, _BUFFER)
    own.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return own

"""Connect to the team once, and send what waits until the connection ends."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import time
from collections.abc import Callable
from configparser import SectionProxy
from typing import Any

import pytak

from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io.cot.events import encoded
from tirgeo_ros.page.cot.outbox import Entry, Outbox

#: A peer that takes nothing for so long is gone: a cut radio link says nothing of itself.
_PATIENCE_S = 10.0
#: A server refuses a client's certificate after the client has counted itself as connected.
_REFUSAL_S = 0.5
#: Servers and radios forget; all is said again after this.
_AGAIN_S = 60.0
_LOOK_S = 0.1
#: A hundred events a second at most: a radio loses a burst of datagrams.
_PACE_S = 0.01
_CHUNK = 65536


async def transmit(settings: SectionProxy, outbox: Outbox, connected: Callable[[], None]) -> None:
    """Connect, call ``connected``, and send until the connection is lost: always raises."""
    reader, writer = await _patiently(pytak.protocol_factory(settings))
    tasks = [asyncio.create_task(_until_closed(reader))]
    try:
        _notice_cuts(writer)
        await _first_failure(tasks, _REFUSAL_S if reader else 0.0)
        connected()
        sender = pytak.TXWorker(asyncio.Queue(), settings, writer)
        tasks.append(asyncio.create_task(_send(sender, outbox)))
        await _first_failure(tasks, None)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        await _closed(writer)


async def _until_closed(reader: asyncio.StreamReader | None) -> None:
    """Read and drop what a server sends; raise when it ends the connection."""
    if reader is None:  # UDP
        await asyncio.Event().wait()
    while reader is not None and await reader.read(_CHUNK):
        pass
    raise ConnectionResetError("closed by the server")


async def _send(sender: pytak.TXWorker, outbox: Outbox) -> None:
    again_s = time.monotonic() + _AGAIN_S
    while True:
        if time.monotonic() >= again_s:
            outbox.all_again()
            again_s = time.monotonic() + _AGAIN_S
        while (entry := outbox.first()) is not None:
            data = _data(entry)
            if data is None:
                outbox.drop(entry)
                continue
            await _patiently(sender.send_data(data))
            outbox.sent(entry)
            await asyncio.sleep(_PACE_S)
        await asyncio.sleep(_LOOK_S)


def _data(entry: Entry) -> bytes | None:
    """Return an entry's event; None where its numbers make none: the others must not wait."""
    try:
        return encoded(entry.make(time.time_ns()))
    except (ValueError, ArithmeticError, TirgeoError):
        return None


async def _first_failure(tasks: list[asyncio.Task[None]], timeout_s: float | None) -> None:
    """Wait, at most for a time, until one of the tasks fails; raise its error."""
    done, _ = await asyncio.wait(tasks, timeout=timeout_s, return_when=asyncio.FIRST_COMPLETED)
    for task in done:
        task.result()


async def _patiently(work: Any) -> Any:
    try:
        return await asyncio.wait_for(work, _PATIENCE_S)
    except asyncio.TimeoutError:  # another class than TimeoutError before Python 3.11
        raise TimeoutError("no answer") from None


def _notice_cuts(writer: Any) -> None:
    """Let the system end a connection whose bytes nobody acknowledges."""
    plug = writer.get_extra_info("socket") if hasattr(writer, "get_extra_info") else None
    if plug is not None and hasattr(socket, "TCP_USER_TIMEOUT"):
        patience_ms = round(_PATIENCE_S * 1e3)
        plug.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, patience_ms)


async def _closed(writer: Any) -> None:
    writer.close()
    if hasattr(writer, "wait_closed"):
        with contextlib.suppress(OSError, asyncio.TimeoutError):
            await asyncio.wait_for(writer.wait_closed(), 1.0)

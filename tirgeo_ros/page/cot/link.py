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
"""Send targets, aircraft and what their cameras see to the team, by PyTAK.

PyTAK connects, encrypts and waits between attempts. What is to be sent is kept here, in an
``Outbox``, since a lost connection takes PyTAK's own queue with it. A lost connection may also
have taken events that never arrived, so each new one begins with all targets and deletions.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import socket
import ssl
import threading
import time
import uuid
from collections.abc import Callable, Sequence
from configparser import SectionProxy
from dataclasses import dataclass
from functools import partial
from typing import Any
from xml.etree import ElementTree as ET

import pytak
from pytak.client_functions import supervise_with_reconnect

from tirgeo_ros.core.config.viewer_parameters import ViewerConfig
from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.errors import TirgeoError, shown
from tirgeo_ros.io.targets.cot_events import (
    AircraftState,
    aircraft_event,
    deletion_event,
    encoded,
    looks_at_event,
    target_event,
    target_uid,
    withdrawn_event,
)
from tirgeo_ros.page.cot.address import endpoint, pytak_settings

#: Makes an event for a time of sending (ns).
Maker = Callable[[int], ET.Element]
#: Most entries that wait; each is below 10 kB.
_MOST = 5000
#: An aircraft that reports faster is sent once a second.
_LEAST_STEP_S = 0.8
#: Deletions that are sent again each minute, for those who missed them.
_DELETIONS_KEPT = 100
#: A peer that takes nothing for so long is gone: a broken radio link gives no error.
_PATIENCE_S = 10.0
#: A server refuses a client's certificate after the client has counted itself as connected.
_REFUSAL_S = 0.5
#: Servers and radios forget: all is sent again after this.
_AGAIN_S = 60.0
#: A hundred events a second at most: a radio loses a burst of datagrams.
_PACE_S = 0.01
_LOOK_S, _STOP_S, _CHUNK = 0.1, 5.0, 65536
_DELETED = "-deleted"  # ends the uid of a deletion
_TLS_REMEDY = (
    "check cot_ca, cot_certificate, the port, this clock, and the server's name in cot "
    "(or add ?name=THAT_NAME)"
)
#: What an operator can do about an error, of the first kind that fits.
_REMEDIES = (
    (ssl.SSLError, _TLS_REMEDY),
    (socket.gaierror, "write its IP address in cot"),
    (ConnectionError, "is the TAK server running, is it tcp or tls there, is the port right?"),
    (OSError, "is this computer in the team's network?"),
)


class Outbox:
    """Hold the newest event of each object, in the order of sending; safe in all threads.

    Targets and their deletions are kept: they wait again after ``all_again``. A waiting entry is
    lost only by ``drop``, or as the oldest of more than _MOST entries; ``dropped`` counts both.
    """

    def __init__(self) -> None:
        self._lock = threading.RLock()
        self._waiting: dict[str, Maker] = {}
        self._kept: dict[str, Maker] = {}
        self._team_has: set[str] = set()  # targets and deletions that the team may have
        self._targets: dict[str, Target] | None = None
        self._taken_s: dict[str, float] = {}  # when the state of each aircraft was taken
        self.shut = False  # True: nothing is sent
        self.dropped = 0

    def __len__(self) -> int:
        """Return how many entries wait."""
        return len(self._waiting)

    def put(self, uid: str, make: Maker, *, keep: bool) -> None:
        """Let an object's newest event wait, instead of an older one that waits."""
        with self._lock:
            self._forget(uid)
            self._waiting[uid] = make
            if keep:
                self._kept[uid] = make
            self._bound()

    def targets(self, targets: Sequence[Target]) -> None:
        """Take the whole list of targets, at each change of one."""
        now = {target_uid(target): target for target in targets}
        with self._lock:
            if self._targets is None:  # the team may have them from an earlier run
                self._team_has.update(now)
            before, self._targets = self._targets or {}, now
            for uid, target in now.items():
                if before.get(uid) != target:
                    self._forget(uid + _DELETED)  # the deletion was undone
                    self.put(uid, partial(target_event, target), keep=True)
            for uid in before.keys() - now.keys():
                self._forget(uid)
                if uid in self._team_has:
                    self.put(uid, partial(withdrawn_event, before[uid]), keep=False)
                    self.put(uid + _DELETED, partial(deletion_event, before[uid]), keep=True)
            deletions = [uid for uid in self._kept if uid.endswith(_DELETED)]
            for uid in deletions[:-_DELETIONS_KEPT]:
                del self._kept[uid]

    def aircraft(self, aircraft: str, state: AircraftState) -> None:
        """Take an aircraft's present state; ignore a state without a position."""
        place = state.latitude_deg, state.longitude_deg, state.height_m
        now_s = time.monotonic()
        with self._lock:
            soon = now_s - self._taken_s.get(aircraft, -math.inf) < _LEAST_STEP_S
            if soon or not all(map(math.isfinite, place)):
                return
            self._taken_s[aircraft] = now_s
        # The event has the time of the state, even if it waits for the network.
        uid, now_ns = aircraft_uid(aircraft), time.time_ns()
        self.put(uid, lambda _: aircraft_event(uid, state, now_ns), keep=False)
        looks_at = looks_at_event(uid, state, now_ns)
        if looks_at is not None:
            self.put(f"{uid}-looks-at", lambda _: looks_at, keep=False)

    def all_again(self) -> None:
        """Let all kept entries wait again."""
        with self._lock:
            self._waiting = self._waiting | {
                uid: make for uid, make in self._kept.items() if uid not in self._waiting
            }
            self._bound()

    def first(self) -> tuple[str, Maker] | None:
        """Return the next entry to send, None while shut; it waits until ``sent``."""
        with self._lock:
            entry = None if self.shut else next(iter(self._waiting.items()), None)
            if entry and entry[0] in self._kept:  # from now on, also if the sending fails
                self._team_has.add(entry[0])
            return entry

    def sent(self, uid: str, make: Maker) -> None:
        """Remove a sent entry, unless a newer one has replaced it meanwhile."""
        with self._lock:
            if self._waiting.get(uid) is make:
                del self._waiting[uid]

    def drop(self, uid: str) -> None:
        """Remove an object whose numbers make no valid event; count it."""
        with self._lock:
            self._forget(uid)
        self.dropped += 1

    def _forget(self, uid: str) -> None:
        self._waiting.pop(uid, None)
        self._kept.pop(uid, None)

    def _bound(self) -> None:
        while len(self._waiting) > _MOST:
            del self._waiting[next(iter(self._waiting))]
            self.dropped += 1


def aircraft_uid(aircraft: str) -> str:
    """Return an aircraft's uid: the same in each run, different on each computer."""
    return f"tirgeo-{uuid.uuid5(uuid.NAMESPACE_OID, f'{uuid.getnode()}/{aircraft}')}"


def _not_of_retries(record: logging.LogRecord) -> bool:
    """Return False for PyTAK's line at each attempt, which would fill a log all night."""
    return not str(record.msg).startswith("TAK transport unavailable")


@dataclass(frozen=True, slots=True)
class CotStatus:
    """Hold what the page shows of the link."""

    on: bool
    connected: bool
    queued: int  # events that wait for the network
    error: str  # why it is not connected, in plain words; "" if it is


class CotLink:
    """Send Cursor-on-Target from a thread of its own; all methods return at once.

    Raises ConfigError for parameters that cannot work. It is off until ``share(True)``. ``say`` is
    called with a line, in that thread, each time the connection is made or lost.
    """

    def __init__(self, config: ViewerConfig, say: Callable[[str], None]) -> None:
        self._settings = pytak_settings(config)
        self.endpoint = endpoint(self._settings)
        self._outbox = Outbox()
        self._say = say
        self._on, self._connected, self._ended = False, False, False
        self._error = ""
        self._thread = threading.Thread(
            target=lambda: asyncio.run(self._serve()), name="cursor-on-target", daemon=True
        )

    def start(self) -> None:
        """Begin; nothing is sent before ``share(True)``."""
        logging.getLogger().addFilter(_not_of_retries)
        self._thread.start()

    def stop(self) -> None:
        """End the connection and the thread."""
        self._ended = True
        if self._thread.is_alive():
            self._thread.join(_STOP_S)

    def share(self, on: bool) -> str:
        """Switch on or off; return words for the operator. While it is off, targets wait."""
        self._on = on
        self._outbox.shut = not on  # at once, also where the connection takes a moment to end
        if on:
            return f"the team gets targets and aircraft at {self.endpoint}"
        return "nothing more is sent; what the team has stays on its maps"

    def targets(self, targets: Sequence[Target]) -> None:
        """Take the whole list of targets, at the start and at each change of one."""
        self._outbox.targets(targets)

    def aircraft(self, aircraft: str, state: AircraftState) -> None:
        """Take an aircraft's newest state, at any rate; about one a second is sent."""
        if self._on:
            self._outbox.aircraft(aircraft, state)

    @property
    def status(self) -> CotStatus:
        """Return what the page shows."""
        error = self._error
        if self._outbox.dropped:
            lost = f"{self._outbox.dropped} events could not be sent"
            error = f"{error}; {lost}" if error else lost
        if not self._on:
            return CotStatus(on=False, connected=False, queued=0, error="")
        return CotStatus(self._on, self._connected, len(self._outbox), error)

    async def _serve(self) -> None:
        """Keep the connection while sharing is on."""
        sharing: asyncio.Task[None] | None = None
        while not self._ended:
            if self._on and sharing is None:
                sharing = asyncio.create_task(supervise_with_reconnect(self._settings, self._once))
            elif not self._on and sharing is not None:
                sharing.cancel()
                await asyncio.gather(sharing, return_exceptions=True)
                sharing = None
            await asyncio.sleep(_LOOK_S)
        # asyncio.run cancels and awaits the rest.

    async def _once(self) -> None:
        """Send until the connection fails; raise ConnectionError: then PyTAK tries again."""
        try:
            await transmit(self._settings, self._outbox, self._note_connected)
        except Exception as error:
            words = words_of(error, self.endpoint)
            if words != self._error:
                self._say(words)
            self._error = words
            raise ConnectionError(self._error) from error
        finally:
            self._connected = False
            self._outbox.all_again()  # events sent before the loss may never have arrived

    def _note_connected(self) -> None:
        self._connected = True
        self._error = ""
        self._say(f"{self.endpoint}: connected")


async def transmit(settings: SectionProxy, outbox: Outbox, connected: Callable[[], None]) -> None:
    """Connect, call ``connected``, and send until the connection is lost: always raises."""
    reader, writer = await _patiently(pytak.protocol_factory(settings))
    tasks = [asyncio.create_task(_until_closed(reader))]
    try:
        tcp = writer.get_extra_info("socket") if hasattr(writer, "get_extra_info") else None
        if tcp is not None and hasattr(socket, "TCP_USER_TIMEOUT"):
            # The system ends a connection whose bytes nobody acknowledges.
            tcp.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, round(_PATIENCE_S * 1e3))
        await _first_failure(tasks, _REFUSAL_S if reader else 0.0)
        connected()
        sender = pytak.TXWorker(asyncio.Queue(), settings, writer)
        tasks.append(asyncio.create_task(_send(sender, outbox)))
        await _first_failure(tasks, None)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        writer.close()
        if hasattr(writer, "wait_closed"):
            with contextlib.suppress(OSError, asyncio.TimeoutError):
                await asyncio.wait_for(writer.wait_closed(), 1.0)


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
            uid, make = entry
            try:
                data = encoded(make(time.time_ns()))
            except (ValueError, ArithmeticError, TirgeoError):  # the others must not wait for it
                outbox.drop(uid)
                continue
            await _patiently(sender.send_data(data))
            outbox.sent(uid, make)
            await asyncio.sleep(_PACE_S)
        await asyncio.sleep(_LOOK_S)


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


def words_of(error: BaseException, endpoint: str) -> str:
    """Return one line for the operator: what is wrong, and what to do."""
    # PyTAK wraps a certificate that it distrusts.
    cause = error.__cause__ if isinstance(error.__cause__, ssl.SSLError) else error
    remedies = (text for kind, text in _REMEDIES if isinstance(cause, kind))
    return "; ".join([f"{endpoint}: {shown(cause, 200)}", *remedies][:2])

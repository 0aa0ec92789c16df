"""Send targets, aircraft and what their cameras see to the team, by PyTAK.

PyTAK connects, encrypts and waits between attempts. What is to be sent is kept here, in an
``Outbox``, since a lost connection takes PyTAK's own queue with it. A lost connection may also
have taken events that never arrived, so each new one begins with all targets and deletions.
"""

from __future__ import annotations

import asyncio
import errno
import logging
import math
import socket
import ssl
import threading
import time
import uuid
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pytak.client_functions import supervise_with_reconnect

from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.core.types.errors import shown
from tirgeo_ros.io.cot.events import (
    AircraftState,
    aircraft_event,
    deletion_event,
    looks_at_event,
    target_event,
    target_uid,
    withdrawn_event,
)
from tirgeo_ros.page.cot.address import CotParameters, endpoint, pytak_settings
from tirgeo_ros.page.cot.outbox import Outbox
from tirgeo_ros.page.cot.transmission import transmit

#: An aircraft that reports faster is sent once a second.
_LEAST_STEP_S = 0.8
#: Deletions that are said again each minute, for those who missed them.
_DELETIONS_KEPT = 100


class TeamPicture:
    """Put what changed into an outbox; safe in all threads."""

    def __init__(self, outbox: Outbox) -> None:
        self._outbox = outbox
        self._lock = threading.Lock()
        self._targets: dict[str, Target] | None = None
        self._deleted: deque[str] = deque()
        self._flown_s: dict[str, float] = {}

    def targets(self, targets: Sequence[Target]) -> None:
        """Take the whole list of targets, at each change of one."""
        now = {target_uid(target): target for target in targets}
        with self._lock:
            if self._targets is None:  # the team may have them from an earlier run
                self._outbox.assume_sent(now)
            before, self._targets = self._targets or {}, now
            for uid, target in now.items():
                if before.get(uid) != target:
                    self._changed(uid, target)
            for uid in before.keys() - now.keys():
                self._gone(uid, before[uid])

    def _changed(self, uid: str, target: Target) -> None:
        self._outbox.forget(_deletion(uid))  # an undone one
        self._outbox.put(uid, lambda now_ns: target_event(target, now_ns), keep=True)

    def _gone(self, uid: str, target: Target) -> None:
        if not self._outbox.was_sent(uid):
            self._outbox.forget(uid)
            return
        self._outbox.put(uid, lambda now_ns: withdrawn_event(target, now_ns), keep=False)
        deletion = _deletion(uid)
        self._outbox.put(deletion, lambda now_ns: deletion_event(target, now_ns), keep=True)
        self._deleted.append(deletion)
        if len(self._deleted) > _DELETIONS_KEPT:
            self._outbox.keep_no_more(self._deleted.popleft())

    def aircraft(self, aircraft: str, state: AircraftState) -> None:
        """Take an aircraft's newest state, which is that of now; one without a place is left."""
        place = state.latitude_deg, state.longitude_deg, state.height_m
        now_s = time.monotonic()
        with self._lock:
            soon = now_s - self._flown_s.get(aircraft, -math.inf) < _LEAST_STEP_S
            if soon or not all(map(math.isfinite, place)):
                return
            self._flown_s[aircraft] = now_s
        # Its time is that of the state, also if it waits for the network.
        uid, now_ns = aircraft_uid(aircraft), time.time_ns()
        self._outbox.put(uid, lambda _: aircraft_event(uid, state, now_ns), keep=False)
        looks_at = looks_at_event(uid, state, now_ns)
        if looks_at is not None:
            self._outbox.put(f"{uid}-looks-at", lambda _: looks_at, keep=False)


def aircraft_uid(aircraft: str) -> str:
    """Return an aircraft's uid: the same in each run, and of this computer alone."""
    return f"tirgeo-{uuid.uuid5(uuid.NAMESPACE_OID, f'{uuid.getnode()}/{aircraft}')}"


def _deletion(uid: str) -> str:
    return f"{uid}-deleted"


_LOOK_S = 0.1
_STOP_S = 5.0
_NO_WAY = {errno.ENETUNREACH, errno.ENETDOWN, errno.EHOSTUNREACH, errno.EADDRNOTAVAIL}
_IN_NETWORK = "is this computer in the team's network?"
_CLOCK = "is the clock of this computer right?"
_OUT_OF_DATE = ("expired", "not yet valid")
_WORDS = {
    socket.gaierror: "no computer of this name is known here; write its IP address in cot",
    PermissionError: "this computer may not send there; to all in a network: udp://239.2.3.1:6969",
    ConnectionRefusedError: "nobody answers; is the TAK server running, is the port right?",
    ConnectionError: "the server ended the connection; is it running, is it tcp or tls there?",
    TimeoutError: f"no answer; {_IN_NETWORK}",
}


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

    Raises ConfigError for parameters that cannot work. It is off until ``share(True)``. ``say``
    gets a line, in that thread, at each change from connected to not connected and back.
    """

    def __init__(self, given: CotParameters, say: Callable[[str], None] = lambda _: None) -> None:
        self._settings = pytak_settings(given)
        self.endpoint = endpoint(self._settings)
        self._outbox = Outbox()
        self._picture = TeamPicture(self._outbox)
        self._say = say
        self._on, self._connected, self._ended = False, False, False
        self._error = ""
        self._thread = threading.Thread(target=self._run, name="cursor-on-target", daemon=True)

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
        """Switch on or off; return words for the operator.

        Off, nothing goes out; targets and deletions of that time go once it is on again.
        """
        self._on = on
        self._outbox.shut = not on  # at once, also where the connection takes a moment to end
        if on:
            return f"the team gets targets and aircraft at {self.endpoint}"
        return "nothing goes to the team; what it has stays on its maps"

    def targets(self, targets: Sequence[Target]) -> None:
        """Take the whole list of targets, at the start and at each change of one."""
        self._picture.targets(targets)

    def aircraft(self, aircraft: str, state: AircraftState) -> None:
        """Take an aircraft's newest state, as often as it is known; about one a second is sent."""
        if self._on:
            self._picture.aircraft(aircraft, state)

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

    def _run(self) -> None:
        asyncio.run(self._serve())

    async def _serve(self) -> None:
        """Be connected while it is on."""
        sharing: asyncio.Task[None] | None = None
        while not self._ended:
            if self._on and sharing is None:
                sharing = asyncio.create_task(self._share())
            elif not self._on and sharing is not None:
                sharing.cancel()
                await asyncio.gather(sharing, return_exceptions=True)
                sharing = None
            await asyncio.sleep(_LOOK_S)
        # asyncio.run cancels and awaits the rest.

    async def _share(self) -> None:
        await supervise_with_reconnect(self._settings, self._once)

    async def _once(self) -> None:
        """Send until the connection fails; raise ConnectionError: then PyTAK tries again."""
        try:
            await transmit(self._settings, self._outbox, self._note_connected)
        except Exception as error:
            self._note(words_of(error, self.endpoint))
            raise ConnectionError(self._error) from error
        finally:
            self._connected = False
            self._outbox.all_again()  # what a lost connection took may never have arrived

    def _note_connected(self) -> None:
        self._connected = True
        self._error = ""
        self._say(f"{self.endpoint}: connected")

    def _note(self, error: str) -> None:
        if error != self._error:
            self._say(error)
        self._error = error


def words_of(error: BaseException, endpoint: str) -> str:
    """Return one line for the operator: what is wrong, and with which parameter."""
    # PyTAK wraps a certificate that it distrusts.
    cause = error.__cause__ if isinstance(error.__cause__, ssl.SSLError) else error
    return f"{endpoint}: {_words(cause)}"


def _words(error: BaseException) -> str:
    if isinstance(error, ssl.SSLCertVerificationError):
        return _distrusted(error)
    if isinstance(error, ssl.SSLError):
        return _refused(error)
    if isinstance(error, OSError) and error.errno in _NO_WAY:
        return f"no way there; {_IN_NETWORK}"
    known = (words for kind, words in _WORDS.items() if isinstance(error, kind))
    return next(known, shown(error, 200))


def _distrusted(error: ssl.SSLCertVerificationError) -> str:
    if "mismatch" in error.verify_message:
        return (
            "the server's certificate has another name; write in cot the name that it has, or "
            "add ?name=THAT_NAME"
        )
    if any(words in error.verify_message for words in _OUT_OF_DATE):
        return f"the server's certificate: {error.verify_message}; {_CLOCK}"
    return (
        f"the server's certificate is not trusted ({error.verify_message}); cot_ca must be that "
        "of the authority that signed it"
    )


def _refused(error: ssl.SSLError) -> str:
    reason = (getattr(error, "reason", None) or str(error)).lower().replace("_", " ")
    if "expired" in reason:
        return f"cot_certificate has expired; its server's owner makes a new one; {_CLOCK}"
    if "alert" in reason or "certificate" in reason:
        return (
            f"the server refuses cot_certificate ({reason}); it must be one that the server's own "
            "authority made"
        )
    return f"no TLS there ({reason}); is the port right?"

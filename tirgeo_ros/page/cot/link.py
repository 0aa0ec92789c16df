"""Send targets, aircraft and what their cameras see to the team, by PyTAK.

PyTAK connects, encrypts and waits between attempts. What is to be sent is kept here, in an
``Outbox``, since a lost connection takes PyTAK's own queue with it. A lost connection may also
have taken events that never arrived, so each new one begins with all targets and deletions.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from pytak.client_functions import supervise_with_reconnect

from tirgeo_ros.core.targets.target import Target
from tirgeo_ros.io.cot.aircraft_events import AircraftState
from tirgeo_ros.page.cot.address import CotParameters, endpoint, pytak_settings
from tirgeo_ros.page.cot.outbox import Outbox
from tirgeo_ros.page.cot.team_picture import TeamPicture
from tirgeo_ros.page.cot.transmission import transmit
from tirgeo_ros.page.cot.trouble import words_of

_LOOK_S = 0.1
_STOP_S = 5.0


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

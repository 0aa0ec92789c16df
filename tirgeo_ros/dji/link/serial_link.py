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
"""Open and read the serial port, and open it again after the cable was pulled.

Errors of the port are not raised: ``state`` names them, and ``message`` explains them to a person.
"""

from __future__ import annotations

import errno
import os
import select
import stat
import termios
import time
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from pathlib import Path
from typing import Any, NamedTuple

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.core.types.missing_package import needed

#: Opens the port at a path with a baud rate; returns a non-blocking file with fileno and close.
#: Raises OSError with the number of the cause, or without a number if the device is no serial
#: port; ValueError if the port's driver does not support the rate.
Opener = Callable[[str, int], Any]

# Reading the port.

#: After the first byte, wait this long for more. At 921600 baud 280 bytes come in 3 ms, about a
#: frame. So the port is read at most 300 times a second, and the added delay is at most this.
_GATHER_S = 0.003
_READ_BYTES = 65536
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.05, 0.8  # between attempts to open the port

# Watching the link.

#: Time without data before a warning; the slowest useful stream, 5 Hz of RTK, pauses 0.2 s.
PATIENCE_S = 2.0
_STEP_S = 0.1  # smallest interval between the totals that are kept
#: Bytes within this time after a frame are the beginning of a cut frame, not a wrong baud rate.
_CUT_FRAME_S = 0.2
#: If at least this percentage of the frames cannot be decrypted, the key is not the aircraft's. Of
#: the frames that are decrypted with a wrong key, one in 256 looks right by chance.
_LOCKED_PERCENT = 90
#: Rates of DJI's own samples and wrapper, the likelier one first.
_USUAL_BAUDS = (921600, 230400, 115200, 1000000)
_NEVER_S = float("-inf")


class LinkState(Enum):
    """List the states of the port."""

    NO_DEVICE = "no_device"
    PERMISSION_DENIED = "permission_denied"
    BUSY = "busy"  # another program has opened it
    NOT_A_PORT = "not_a_port"
    BAUD_REFUSED = "baud_refused"  # its driver does not support the rate
    OPEN = "open"
    LOST = "lost"  # it was open and disappeared


_STATES = {
    errno.EACCES: LinkState.PERMISSION_DENIED,
    errno.EPERM: LinkState.PERMISSION_DENIED,
    errno.EBUSY: LinkState.BUSY,
    errno.EAGAIN: LinkState.BUSY,  # another program's lock
    errno.ENOTTY: LinkState.NOT_A_PORT,
    None: LinkState.NOT_A_PORT,
}

_MESSAGES = {
    LinkState.NO_DEVICE: "there is no such device: plug the cable in, or set the "
    "parameter port (ls /dev/serial/by-id lists the ports)",
    LinkState.PERMISSION_DENIED: "permission denied: add the user to the group dialout "
    "(sudo usermod -aG dialout $USER) and log in again",
    LinkState.BUSY: "another program uses the port: end that program (fuser -v names it)",
    LinkState.NOT_A_PORT: "this is not a serial port: set the parameter port",
    LinkState.BAUD_REFUSED: "the port's driver refuses this rate: set the parameter baud",
    LinkState.OPEN: "open",
    LinkState.LOST: "the port is gone: the cable is unplugged, or another program reads "
    "the port too; it is opened again when it is back",
}

#: Message of each condition of an open port.
_CONDITIONS = {
    "receiving": "receiving at {baud} baud",
    "waiting": "open, no valid frame yet",
    "silent": f"open but no bytes for {PATIENCE_S:.0f} s: check that the aircraft is on, the "
    "cable (TX to RX) and that 'API control' is ticked in DJI Assistant 2 (SDK tab)",
    "wrong_key": "the frames are encrypted, and the parameter key {wrong_key}: set it to the app "
    "key with which the aircraft was activated (DJI's developer site)",
    "wrong_baud": f"bytes come but no valid frame for {PATIENCE_S:.0f} s at {{baud}} baud: set "
    "baud as in DJI Assistant 2 (SDK tab); usual are {others}",
}
#: How serious a condition is; all others, and every state of a port that is not open: STOP.
_SEVERITIES = {
    "receiving": Severity.NOTE,
    "waiting": Severity.CAUTION,
    "silent": Severity.CAUTION,
}


class SerialLink:
    """Read the port ``port`` with ``baud``, 8 data bits, no parity, 1 stop bit, in one thread.

    ``opener`` opens the port, by default by pyserial. Raises DjiError if that is not installed.
    """

    def __init__(self, port: str, baud: int, opener: Opener | None = None) -> None:
        self._port, self._baud = port, baud
        self._opener = opener or pyserial_opener()
        self._handle: Any = None
        self._poll = select.poll()
        self.state = LinkState.NO_DEVICE
        self._reason = ""
        self._pause_s = 0.0
        self._next_try_s = time.monotonic()
        self.openings = 0  # how often the port was opened
        self.gathered_s = 0.0  # age of the last batch's first byte when the batch was read

    @property
    def message(self) -> str:
        """Return the state as a line for a person: port, what to do, cause."""
        reason = f" ({self._reason})" if self._reason else ""
        return f"{self._port}: {_MESSAGES[self.state]}{reason}"

    def read(self, timeout_s: float) -> bytes:
        """Return the received bytes in one batch; wait ``timeout_s`` for the first byte.

        Returns b"" if none came. Opens the port if it is not open and the next attempt is due.
        """
        if self._handle is None:
            wait_s = self._next_try_s - time.monotonic()
            time.sleep(max(min(wait_s, timeout_s), 0.0))
            if wait_s > timeout_s or not self._open():
                return b""
        try:
            return self._batch(timeout_s)
        except (OSError, ValueError) as error:
            self.close()
            self.state, self._reason = LinkState.LOST, _reason(error)
            self._next_try_s = time.monotonic()
            return b""

    def close(self) -> None:
        """Close the port."""
        handle, self._handle = self._handle, None
        if handle is not None:
            with suppress(OSError, ValueError):  # it may be gone already
                handle.close()

    def _batch(self, timeout_s: float) -> bytes:
        if not self._poll.poll(timeout_s * 1e3):
            return b""
        ready_s = time.monotonic()
        time.sleep(_GATHER_S)
        data = os.read(self._handle.fileno(), _READ_BYTES)
        if not data:  # readable, but without data: the device hung up
            raise OSError(errno.EIO, "the device hung up")
        self.gathered_s = time.monotonic() - ready_s
        return data

    def _open(self) -> bool:
        """Try to open the port; return whether it is open."""
        try:
            self._handle = self._opener(self._port, self._baud)
        except (OSError, ValueError) as error:
            self._pause_s = min(max(2 * self._pause_s, _FIRST_PAUSE_S), _LONGEST_PAUSE_S)
            self._next_try_s = time.monotonic() + self._pause_s
            refusal = _STATES.get(getattr(error, "errno", None), LinkState.NO_DEVICE)
            state = LinkState.BAUD_REFUSED if isinstance(error, ValueError) else refusal
            # the reason why the port was lost is kept until the port is back
            if (state, self.state) != (LinkState.NO_DEVICE, LinkState.LOST):
                self.state, self._reason = state, _reason(error)
            return False
        self._poll = select.poll()
        self._poll.register(self._handle.fileno(), select.POLLIN)
        self.state, self._reason = LinkState.OPEN, ""
        self._pause_s = 0.0
        self.openings += 1
        return True


def _reason(error: OSError | ValueError) -> str:
    return str(getattr(error, "strerror", None) or error).replace("\n", " ")


def pyserial_opener() -> Opener:
    """Return the function that opens real ports. Raises DjiError if pyserial is not installed."""
    serial = needed("serial", "reading a serial port", DjiError)

    def opened(path: str, baud: int) -> Any:
        if not stat.S_ISCHR(Path(path).stat().st_mode):
            raise OSError(errno.ENOTTY, "this is a file or a folder")
        try:
            port = serial.Serial(path, baud, timeout=0, exclusive=True)
        except termios.error as error:
            code, reason = error.args
            if code == errno.EINVAL:
                raise ValueError(f"the driver refuses {baud} baud") from error
            raise OSError(code, reason) from error
        # Without this an FTDI adapter delays bytes by 16 ms; other adapters lack this mode.
        with suppress(OSError, ValueError):
            port.set_low_latency_mode(True)
        return port

    return opened


class LinkReport(NamedTuple):
    """Hold the condition of the link."""

    condition: str
    level: Severity
    message: str  # one line: the port and what to do


class Totals(NamedTuple):
    """Hold the total numbers of bytes, frames and undecrypted frames at a time (s)."""

    at_s: float  # of a monotonic clock
    bytes: int
    frames: int
    locked: int = 0


class LinkWatch:
    """Watch the port ``port`` that is read with ``baud``, with a key or without.

    The port's state shows whether it is open. Its bytes and frames show whether the cable, the
    aircraft's settings, the baud rate and the key are right.
    """

    def __init__(self, port: str, baud: int, *, has_key: bool = False) -> None:
        self._port = port
        self._words = {
            "baud": baud,
            "others": ", ".join(str(usual) for usual in _USUAL_BAUDS if usual != baud),
            "wrong_key": "is not the aircraft's" if has_key else "is not set",
        }
        self._history: deque[Totals] = deque()
        self._last = Totals(0.0, 0, 0)
        self._opened_s = self._last_bytes_s = self._last_frame_s = _NEVER_S
        self.report: LinkReport | None = None  # of the last call of ``look``

    def look(self, state: LinkState, message: str, totals: Totals) -> LinkReport | None:
        """Take the port's state and message, and the total numbers of bytes and frames.

        Returns the report if the condition has changed since the last call, else None.
        """
        if state is LinkState.OPEN:
            condition = self._condition(totals)
            message = f"{self._port}: {_CONDITIONS[condition].format(**self._words)}"
        else:
            self._history.clear()
            condition = state.value
        report = LinkReport(condition, _SEVERITIES.get(condition, Severity.STOP), message)
        changed = self.report is None or self.report.condition != report.condition
        self.report = report
        return report if changed else None

    def _condition(self, totals: Totals) -> str:
        """Take the totals of the open port; return its condition."""
        if not self._history:  # bytes from before the port was opened do not count
            self._opened_s, self._last = totals.at_s, totals
            self._last_bytes_s = self._last_frame_s = _NEVER_S
        if totals.bytes > self._last.bytes:
            self._last_bytes_s = totals.at_s
        if totals.frames > self._last.frames:
            self._last_frame_s = totals.at_s
        self._last = totals
        if not self._history or totals.at_s - self._history[-1].at_s >= _STEP_S:
            self._history.append(totals)
        while len(self._history) > 1 and totals.at_s - self._history[1].at_s >= PATIENCE_S:
            self._history.popleft()
        if totals.at_s - self._last_frame_s < PATIENCE_S:
            first = self._history[0]
            frames, locked = totals.frames - first.frames, totals.locked - first.locked
            return "wrong_key" if 0 < _LOCKED_PERCENT * frames <= 100 * locked else "receiving"
        if totals.at_s - self._opened_s < PATIENCE_S:
            return "waiting"
        garbage = self._last_bytes_s > self._last_frame_s + _CUT_FRAME_S
        if garbage and totals.at_s - self._last_bytes_s < PATIENCE_S:
            return "wrong_baud"
        return "silent"

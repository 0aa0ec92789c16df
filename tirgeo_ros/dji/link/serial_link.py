"""Open and read the serial port, and open it again after the cable was pulled.

Errors of the cable are not raised: ``state`` names them and ``message`` is a line for a person.
"""

from __future__ import annotations

import errno
import os
import select
import stat
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from enum import Enum
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import DjiError

#: A write waits this long for a port that does not accept its bytes.
_WRITE_TIMEOUT_S = 0.05
#: A rate that every driver accepts, for a pseudo-terminal, where the rate means nothing.
_ANY_BAUD = 38400
_PTY_MAJORS = range(136, 144)  # of Linux: Documentation/admin-guide/devices.txt
#: How long to wait for more once bytes have come. At 921600 baud 3 ms bring 280 bytes, about a
#: frame. So the port is read at most 300 times a second, and the added delay is no longer than
#: this.
_GATHER_S = 0.003
_READ_BYTES = 65536
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.05, 0.8  # between tries to open

#: Opens the port of a path with a baud rate, to be used as pyserial's: fileno (which does not
#: block), write, close. Raises OSError with the cause's number, or without one if the device is
#: no serial port; ValueError if its driver does not know the rate.
Opener = Callable[[str, int], Any]


class LinkState(Enum):
    """List the states of the port."""

    NO_DEVICE = "no_device"
    PERMISSION_DENIED = "permission_denied"
    BUSY = "busy"  # another program has it
    NOT_A_PORT = "not_a_port"
    BAUD_REFUSED = "baud_refused"  # its driver does not know the rate
    OPEN = "open"
    LOST = "lost"  # it was open and went away


_STATES = {
    errno.EACCES: LinkState.PERMISSION_DENIED,
    errno.EPERM: LinkState.PERMISSION_DENIED,
    errno.EBUSY: LinkState.BUSY,
    errno.EAGAIN: LinkState.BUSY,  # another program's lock
    errno.ENOTTY: LinkState.NOT_A_PORT,
    None: LinkState.NOT_A_PORT,
}

_MESSAGES = {
    LinkState.NO_DEVICE: "there is no such device: plug the cable in, or set port "
    "(ls /dev/serial/by-id shows what there is)",
    LinkState.PERMISSION_DENIED: "permission denied: add the user to the group dialout "
    "(sudo usermod -aG dialout $USER) and log in again",
    LinkState.BUSY: "another program uses it: close that one (fuser -v names it)",
    LinkState.NOT_A_PORT: "this is not a serial port: set the parameter port",
    LinkState.BAUD_REFUSED: "the port's driver does not know this rate: set baud",
    LinkState.OPEN: "open",
    LinkState.LOST: "the port is gone: the cable is unplugged, or another program reads "
    "it too; it is opened again when it is back",
}


class SerialLink:
    """Read and write the port ``port`` with ``baud``, 8 data bits, no parity, 1 stop bit.

    One thread reads; others may write and close. ``opener`` opens the port, pyserial's by default.
    Raises DjiError if pyserial is not installed.
    """

    def __init__(self, port: str, baud: int, opener: Opener | None = None) -> None:
        self._port, self._baud = port, baud
        self._opener = opener or pyserial_opener()
        self._handle: Any = None
        self._guard = threading.Lock()  # nobody may close the handle while it is used
        self._closed = threading.Event()
        self._poll = select.poll()
        self.state = LinkState.NO_DEVICE
        self._reason = ""
        self._pause_s = 0.0
        self._next_try_s = time.monotonic()
        self.openings = 0  # number of times that it was opened
        self.gathered_s = 0.0  # age of the last batch's first byte when the batch was read

    @property
    def message(self) -> str:
        """Return the state as a line for a person: port, what to do, cause."""
        reason = f" ({self._reason})" if self._reason else ""
        return f"{self._port}: {_MESSAGES[self.state]}{reason}"

    def read(self, timeout_s: float) -> bytes:
        """Return what has come, in one batch; wait ``timeout_s`` for the first byte.

        Returns b"" if nothing has come. Opens the port if it is not open and the next try is due.
        """
        handle = self._handle or self._try_to_open(timeout_s)
        if handle is None:
            return b""
        try:
            return self._take(handle, timeout_s)
        except (OSError, ValueError) as error:
            self._drop()
            self.state, self._reason = LinkState.LOST, _reason(error)
            self._next_try_s = time.monotonic()
            return b""

    def write(self, data: bytes) -> bool:
        """Send; return False if the port is not open or does not accept all bytes."""
        with self._guard:
            if self._handle is None:
                return False
            try:
                return bool(self._handle.write(data) == len(data))
            except (OSError, ValueError):
                return False  # the next read finds out whether the port is gone

    def close(self) -> None:
        """Close the port for good; a waiting read still returns within its time-out."""
        self._closed.set()
        self._drop()

    def _take(self, handle: Any, timeout_s: float) -> bytes:
        number = handle.fileno()
        if not self._poll.poll(timeout_s * 1e3):
            return b""
        ready_s = time.monotonic()
        time.sleep(_GATHER_S)
        with self._guard:
            if self._handle is not handle:  # closed meanwhile
                return b""
            data = os.read(number, _READ_BYTES)
        if not data:  # readable, but without data: the device hung up
            raise OSError(errno.EIO, "it hung up")
        self.gathered_s = time.monotonic() - ready_s
        return data

    def _try_to_open(self, timeout_s: float) -> Any:
        wait_s = self._next_try_s - time.monotonic()
        if self._closed.wait(max(min(wait_s, timeout_s), 0.0)) or wait_s > timeout_s:
            return None
        try:
            handle = self._opener(self._port, self._baud)
        except (OSError, ValueError) as error:
            self._refused(error)
            return None
        with self._guard:
            if self._closed.is_set():
                handle.close()
                return None
            self._handle = handle
        self._poll = select.poll()
        self._poll.register(handle.fileno(), select.POLLIN)
        self.state, self._reason = LinkState.OPEN, ""
        self._pause_s = 0.0
        self.openings += 1
        return handle

    def _refused(self, error: OSError | ValueError) -> None:
        self._pause_s = min(max(2 * self._pause_s, _FIRST_PAUSE_S), _LONGEST_PAUSE_S)
        self._next_try_s = time.monotonic() + self._pause_s
        known = _STATES.get(getattr(error, "errno", None), LinkState.NO_DEVICE)
        state = LinkState.BAUD_REFUSED if isinstance(error, ValueError) else known
        if state is LinkState.NO_DEVICE and self.state is LinkState.LOST:
            return  # keep the reason why the port was lost for as long as it is away
        self.state, self._reason = state, _reason(error)

    def _drop(self) -> None:
        with self._guard:
            handle, self._handle = self._handle, None
            if handle is not None:
                with suppress(OSError, ValueError):  # it may be gone already
                    handle.close()


def _reason(error: OSError | ValueError) -> str:
    return str(getattr(error, "strerror", None) or error).replace("\n", " ")


def pyserial_opener() -> Opener:
    """Return the function that opens real ports. Raises DjiError if pyserial is not installed."""
    try:
        from serial import Serial  # noqa: PLC0415 - only who has a cable needs it
    except ImportError as error:
        raise DjiError("a serial port needs pyserial: pip install pyserial") from error

    def opened(path: str, baud: int) -> Any:
        device = Path(path).stat()
        if not stat.S_ISCHR(device.st_mode):
            raise OSError(errno.ENOTTY, "it is a file or a folder")
        try:
            return _opened(Serial, path, baud)
        except ValueError:
            if os.major(device.st_rdev) not in _PTY_MAJORS:
                raise
            return _opened(Serial, path, _ANY_BAUD)

    return opened


def _opened(make: Callable[..., Any], path: str, baud: int) -> Any:
    import termios  # noqa: PLC0415 - not on every system

    try:
        port = make(path, baud, timeout=0, write_timeout=_WRITE_TIMEOUT_S, exclusive=True)
    except termios.error as error:
        code, reason = error.args
        if code == errno.EINVAL:
            raise ValueError(f"the driver refuses {baud} baud") from error
        raise OSError(code, reason) from error
    # An FTDI adapter holds bytes back for 16 ms otherwise; others do not know this mode.
    with suppress(OSError, ValueError):
        port.set_low_latency_mode(True)
    return port

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
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from enum import Enum, IntEnum
from pathlib import Path
from typing import Any, NamedTuple

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
        refusal = _STATES.get(getattr(error, "errno", None), LinkState.NO_DEVICE)
        state = LinkState.BAUD_REFUSED if isinstance(error, ValueError) else refusal
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


#: Time without data before a warning; the slowest useful stream, 5 Hz of RTK, pauses 0.2 s.
PATIENCE_S = 2.0
_STEP_S = 0.1  # smallest interval between the looks that are kept
#: Bytes within this time after a frame are the beginning of a cut frame, not a wrong baud rate.
_CUT_FRAME_S = 0.2
#: If at least this percentage of the frames cannot be decrypted, the key is not the aircraft's. Of
#: those that a wrong key decrypts, one in 256 looks right by chance.
_LOCKED_PERCENT = 90
#: Rates of DJI's own samples and wrapper, the likelier one first.
_USUAL_BAUDS = (921600, 230400, 115200, 1000000)
_NEVER_S = float("-inf")


class LinkLevel(IntEnum):
    """List the severities; the numbers are those of a DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


#: Level (others are errors) and message of the conditions of an open port. A port that is not open
#: has its state for a condition.
_LEVELS = {
    "waiting": LinkLevel.WARN,  # just opened
    "silent": LinkLevel.WARN,
    "receiving": LinkLevel.OK,
}
_WORDS = {
    "receiving": "receiving at {baud} baud",
    "waiting": "open, nothing understood yet",
    "silent": (
        f"open but no bytes for {PATIENCE_S:.0f} s: check that the aircraft is on, the "
        "cable (TX to RX) and that 'API control' is ticked in DJI Assistant 2 (SDK tab)"
    ),
    "wrong_key": (
        "frames come, but they are encrypted and the parameter key {wrong_key}: set it "
        "to the app key with which the aircraft was activated (DJI's developer site)"
    ),
    "wrong_baud": (
        f"bytes come but no valid frame for {PATIENCE_S:.0f} s at {{baud}} baud: set "
        "baud as in DJI Assistant 2 (SDK tab); usual are {others}"
    ),
}


class LinkReport(NamedTuple):
    """Hold the condition of the link."""

    condition: str
    level: LinkLevel
    message: str  # one line: the port and what to do
    since_s: float  # when it began, by the clock of ``look``
    bytes_per_s: float  # over the last two seconds
    frames_per_s: float


class LinkWatch:
    """Watch the port ``port`` that is read with ``baud``, with a key or without.

    The port's own state shows whether it is open. What comes through it shows whether the cable,
    the aircraft's settings, the baud rate and the key are right.
    """

    def __init__(self, port: str, baud: int, *, has_key: bool = False) -> None:
        self._port = port
        self._words = {
            "baud": baud,
            "others": ", ".join(str(usual) for usual in _USUAL_BAUDS if usual != baud),
            "wrong_key": "is not the aircraft's" if has_key else "is not set",
        }
        #: Time, and total numbers of bytes, frames and frames that were not decrypted.
        self._looks: deque[tuple[float, int, int, int]] = deque()
        self._last = (0.0, 0, 0, 0)
        self._opened_s = self._heard_bytes_s = self._heard_frame_s = _NEVER_S
        self.report: LinkReport | None = None  # the condition at the last look

    def look(
        self,
        now_s: float,
        state: LinkState,
        message: str,
        byte_count: int,
        frame_count: int,
        locked_count: int = 0,
    ) -> LinkReport | None:
        """Take the port's state and message, and the total numbers of bytes and frames.

        Returns the report if the condition has changed since the last look, else None. ``now_s``:
        of a monotonic clock. ``locked_count``: number of frames that were not decrypted.
        """
        if state is LinkState.OPEN:
            self._listen(now_s, byte_count, frame_count, locked_count)
            condition = self._condition(now_s)
            message = f"{self._port}: {_WORDS[condition].format(**self._words)}"
        else:
            self._looks.clear()
            condition = state.value
        before = self.report
        changed = before is None or before.condition != condition
        since_s = now_s if before is None or changed else before.since_s
        level = _LEVELS.get(condition, LinkLevel.ERROR)
        span_s, byte_count, frame_count, _ = self._counted
        rates = (byte_count / span_s, frame_count / span_s) if span_s > 0 else (0.0, 0.0)
        self.report = LinkReport(condition, level, message, since_s, *rates)
        return self.report if changed else None

    @property
    def _counted(self) -> tuple[float, int, int, int]:
        """Return time, bytes, frames and undecrypted frames over the last two seconds."""
        first, last = (self._looks[0] if self._looks else self._last), self._last
        return last[0] - first[0], last[1] - first[1], last[2] - first[2], last[3] - first[3]

    def _listen(self, now_s: float, byte_count: int, frame_count: int, locked_count: int) -> None:
        look = (now_s, byte_count, frame_count, locked_count)
        if not self._looks:  # what came before the port was open does not count
            self._opened_s, self._heard_bytes_s, self._heard_frame_s = now_s, _NEVER_S, _NEVER_S
            self._looks.append(look)
            self._last = look
        if byte_count > self._last[1]:
            self._heard_bytes_s = now_s
        if frame_count > self._last[2]:
            self._heard_frame_s = now_s
        self._last = look
        if now_s - self._looks[-1][0] >= _STEP_S:
            self._looks.append(look)
        while len(self._looks) > 1 and now_s - self._looks[1][0] >= PATIENCE_S:
            self._looks.popleft()

    def _condition(self, now_s: float) -> str:
        if now_s - self._heard_frame_s < PATIENCE_S:
            _, _, frames, locked = self._counted
            is_locked = 0 < _LOCKED_PERCENT * frames <= 100 * locked
            return "wrong_key" if is_locked else "receiving"
        if now_s - self._opened_s < PATIENCE_S:
            return "waiting"
        garbage = self._heard_bytes_s > self._heard_frame_s + _CUT_FRAME_S
        if garbage and now_s - self._heard_bytes_s < PATIENCE_S:
            return "wrong_baud"
        return "silent"

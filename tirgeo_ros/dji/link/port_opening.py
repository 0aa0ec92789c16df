"""Open a serial port with pyserial: raw, and for this program alone."""

from __future__ import annotations

import errno
import os
import stat
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol

from tirgeo_ros.core.types.errors import DjiError

#: A write waits this long for a port that does not accept its bytes.
_WRITE_TIMEOUT_S = 0.05
#: A rate that every driver accepts, for a pseudo-terminal, where the rate means nothing.
_ANY_BAUD = 38400
_PTY_MAJORS = range(136, 144)  # of Linux: Documentation/admin-guide/devices.txt


class Port(Protocol):
    """Specify an open serial port, as pyserial's."""

    def fileno(self) -> int:
        """Return the file descriptor to read from, which does not block."""

    def write(self, data: bytes, /) -> int | None:
        """Send; raises OSError if the port is gone or accepts nothing."""

    def close(self) -> None:
        """Close the port."""


#: Opens the port of a path with a baud rate. Raises OSError with the cause's number, or without
#: one if the device is no serial port; ValueError if its driver does not know the rate.
Opener = Callable[[str, int], Port]


def pyserial_opener() -> Opener:
    """Return the function that opens real ports. Raises DjiError if pyserial is not installed."""
    try:
        from serial import Serial  # noqa: PLC0415 - only who has a cable needs it
    except ImportError as error:
        raise DjiError("a serial port needs pyserial: pip install pyserial") from error

    def opened(path: str, baud: int) -> Port:
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


def _opened(make: Callable[..., Any], path: str, baud: int) -> Port:
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
    return port  # type: ignore[no-any-return]

"""Simulate a serial port: a pseudo-terminal whose other end this program holds.

On Linux the master can see whether somebody has the port open, and the speed that it was set to.
"""

from __future__ import annotations

import os
import random
import select
import termios
import tty
from contextlib import suppress
from pathlib import Path
from typing import Final, final

from tirgeo_ros.core.types.errors import DjiError


@final
class PseudoTerminal:
    """Make a port at ``path`` (a symbolic link) and hold its far end. A context manager.

    What is written goes to whoever has the port open, as far as there is room: nothing here waits
    for a reader. With a ``baud``, a reader who set another speed gets noise, as from a wire.
    Raises DjiError where the port cannot be made.
    """

    def __init__(self, path: str | os.PathLike[str], baud: int | None = None) -> None:
        self.path: Final = Path(path)
        self.dropped = 0  # bytes that nobody took
        self._speed = None if baud is None else _speed_of(baud)
        self._noise = random.Random(0)  # noqa: S311 noise, not a secret
        self._master: int | None = None
        self.plug()

    @property
    def is_open(self) -> bool:
        """Return whether somebody has the port open."""
        if self._master is None:
            return False
        poll = select.poll()
        poll.register(self._master, 0)
        return not poll.poll(0)  # otherwise it is hung up

    def write(self, data: bytes) -> int:
        """Send; return the number of bytes that the port took. ``dropped`` counts the others."""
        taken = 0
        if self._master is not None and self.is_open:
            if self._speed is not None and termios.tcgetattr(self._master)[4] != self._speed:
                data = self._noise.randbytes(len(data))
            with suppress(BlockingIOError):
                taken = os.write(self._master, data)
        self.dropped += len(data) - taken
        return taken

    def pull(self) -> None:
        """Pull the cable: hang up the program that has the port open, and remove the port."""
        if self._master is not None:
            os.close(self._master)
            self._master = None
            self.path.unlink(missing_ok=True)

    def plug(self) -> None:
        """Plug the cable in again: make a new port under the same path."""
        if self._master is not None:
            return
        try:
            self._master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(self._master, False)
            name = os.ttyname(slave)
            os.close(slave)
            if self.path.is_symlink():  # left by a run that was killed
                self.path.unlink()
            self.path.symlink_to(name)
        except OSError as error:
            if self._master is not None:
                os.close(self._master)
                self._master = None
            raise DjiError(
                f"{self.path}: no pseudo-terminal can be made there: {error.strerror or error}"
            ) from None

    def __enter__(self) -> PseudoTerminal:
        return self

    def __exit__(self, *_: object) -> None:
        self.pull()


def _speed_of(baud: int) -> int:
    """Return the system's number of a speed. Raises DjiError for one that it does not have."""
    speed = getattr(termios, f"B{baud}", None)
    if not isinstance(speed, int):
        raise DjiError(f"{baud} is not a speed of a serial port")
    return speed

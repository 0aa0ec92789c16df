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
"""Simulate a serial port by a pseudo-terminal, whose master end this program holds.

On Linux the master shows whether a program has opened the port, and with which speed.
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
    """Make a port at ``path`` (a symbolic link) and hold its master end. A context manager.

    Written bytes go to the program that has opened the port, as far as its buffer has room:
    ``write`` does not wait for a reader. With a ``baud``, a reader with another speed gets noise,
    as from a wire. Raises DjiError if the port cannot be made.
    """

    def __init__(self, path: str | os.PathLike[str], baud: int | None = None) -> None:
        self.path: Final = Path(path)
        self.dropped = 0  # bytes that no program took
        self._speed = None if baud is None else _speed_of(baud)
        self._noise = random.Random(0)  # noqa: S311 noise, not a secret
        self._master: int | None = None
        self.plug()

    @property
    def is_open(self) -> bool:
        """Return whether a program has opened the port."""
        if self._master is None:
            return False
        poll = select.poll()
        poll.register(self._master, 0)
        return not poll.poll(0)  # otherwise it is hung up

    def write(self, data: bytes) -> int:
        """Write; return the number of bytes that the port took. ``dropped`` counts the others."""
        taken = 0
        if self._master is not None and self.is_open:
            if self._speed is not None and termios.tcgetattr(self._master)[4] != self._speed:
                data = self._noise.randbytes(len(data))
            with suppress(BlockingIOError):
                taken = os.write(self._master, data)
        self.dropped += len(data) - taken
        return taken

    def pull(self) -> None:
        """Pull the cable: hang up the program that has opened the port, and remove the port."""
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
    """Return the system's number of a speed; raise DjiError if the system lacks the speed."""
    speed = getattr(termios, f"B{baud}", None)
    if not isinstance(speed, int):
        raise DjiError(f"{baud} baud is not a speed of a serial port: use one such as 921600")
    return speed

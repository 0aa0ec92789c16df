"""A pseudo-terminal whose aircraft's end a test holds, under a name that stays."""

from __future__ import annotations

import os
import tty
from contextlib import suppress
from pathlib import Path


class PseudoTerminal:
    """The aircraft's end of a cable; ``path`` is the host's end, a link that outlives a pull."""

    def __init__(self, path):
        self.path = Path(path)
        self.master = -1
        self.plug()

    def plug(self):
        """Make a new terminal under the same name."""
        self.master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        self.path.unlink(missing_ok=True)
        self.path.symlink_to(os.ttyname(slave))
        os.close(slave)

    def pull(self):
        """Hang up; the name remains and leads nowhere."""
        os.close(self.master)
        self.master = -1

    def send(self, data):
        while data:
            with suppress(BlockingIOError):
                data = data[os.write(self.master, data) :]

    def received(self):
        """What the host wrote."""
        try:
            return os.read(self.master, 65536)
        except OSError:  # nothing there, or no host
            return b""

    def close(self):
        if self.master >= 0:
            self.pull()
        self.path.unlink(missing_ok=True)

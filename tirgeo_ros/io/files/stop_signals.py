"""List the signals that end a command or a node."""

from __future__ import annotations

import signal


def stop_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT, SIGTERM and SIGHUP (the terminal was closed).

    SIGHUP is left out if it is ignored: that is how nohup keeps a program running. An ignored
    SIGINT is included all the same, since a shell sets it for everything that it starts in the
    background.
    """
    always = (signal.SIGINT, signal.SIGTERM)
    kept = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return always if kept else (*always, signal.SIGHUP)

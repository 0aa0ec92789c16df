"""The signals that end a command or a node."""

from __future__ import annotations

import signal


def stop_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT, SIGTERM and SIGHUP (the terminal is gone).

    Without SIGHUP where it is ignored: that is how nohup asks to run on. SIGINT ignored asks for
    nothing, since a shell does that to all that it starts in the background.
    """
    always = (signal.SIGINT, signal.SIGTERM)
    kept = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return always if kept else (*always, signal.SIGHUP)

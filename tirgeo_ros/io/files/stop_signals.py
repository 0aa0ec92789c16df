"""Name the signals that stop a program; alone, as nodes block them before anything else."""

from __future__ import annotations

import signal


def stop_signals() -> tuple[signal.Signals, ...]:
    """Return SIGINT, SIGTERM and SIGHUP (the terminal was closed).

    SIGHUP is left out if it is ignored: that is how nohup keeps a program running. SIGINT is
    included even if it is ignored, as it is in everything that a shell starts in the background.
    """
    always = (signal.SIGINT, signal.SIGTERM)
    kept = signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    return always if kept else (*always, signal.SIGHUP)

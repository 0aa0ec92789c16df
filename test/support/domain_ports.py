"""The ports of DDS domains, for tests."""

from __future__ import annotations

import socket


def taken_port(domain: int) -> socket.socket:
    """Hold the port of a domain's first participant (RTPS 2.2, section 9.6.1.1) until closed.

    Raises OSError where somebody has it.
    """
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        taken.bind(("", 7410 + 250 * domain))
    except OSError:
        taken.close()
        raise
    return taken

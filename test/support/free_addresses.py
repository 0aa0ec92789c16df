"""Addresses of this computer at which nobody listens."""

from __future__ import annotations

import socket


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Return a port of 127.0.0.1 that is free, of TCP or with ``SOCK_DGRAM`` of UDP."""
    with socket.socket(socket.AF_INET, kind) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def free_address(host: str = "127.0.0.1") -> str:
    """Return HOST:PORT where a server can listen."""
    return f"{host}:{free_port()}"


def free_udp_address() -> str:
    """Return where to send a stream that nobody else receives."""
    return f"udp://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"

"""Run ``tirgeo demo --page`` as long as something looks at its page."""

from __future__ import annotations

import re
import signal
import socket
import socketserver
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

_LIMIT_S = 90.0


@contextmanager
def shown_demo(folder: Path, *words: object) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Yield the page's address, which ends with no slash, and the demo's process; then end it.

    ``words`` are more arguments of the command. What it writes goes into ``folder``. Raises
    SystemExit if there is no page.
    """
    log = folder / "log"
    with socket.create_server(("127.0.0.1", 0)) as free:  # a page started again has the same
        address = f"127.0.0.1:{free.getsockname()[1]}"
    given = ["demo", "--page", address, "-o", folder, *words]
    with log.open("w") as out:
        command = [sys.executable, "-m", "tirgeo_ros.tools.cli.main", *map(str, given)]
        demo = subprocess.Popen(command, stdout=out, stderr=out)  # noqa: S603 our own
    try:
        yield _address(log, demo), demo
    finally:
        end_demo(demo)


class _Sink(socketserver.StreamRequestHandler):
    def handle(self) -> None:
        while self.rfile.read(1024):
            pass


@contextmanager
def listening_team() -> Iterator[str]:
    """Take what is shared, as a TAK server would, and drop it; yield the address."""
    with socketserver.ThreadingTCPServer(("127.0.0.1", 0), _Sink) as server:
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"tcp://127.0.0.1:{server.server_address[1]}"
        server.shutdown()


def node_pid(demo: int, name: str) -> int:
    """Return the process that runs a node for the demo; 0 if none does."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = path.read_text().rpartition(")")[2].split()[1]
            if int(parent) == demo and name in path.with_name("cmdline").read_text():
                return int(path.parent.name)
    return 0


def end_demo(demo: subprocess.Popen[bytes]) -> None:
    """End the demo, as Ctrl-C does; one that has ended stays so."""
    if demo.poll() is None:
        demo.send_signal(signal.SIGINT)
        demo.wait(_LIMIT_S)


def _address(log: Path, demo: subprocess.Popen[bytes]) -> str:
    end_s = time.monotonic() + _LIMIT_S
    while time.monotonic() < end_s and demo.poll() is None:
        found = re.search(r"http://127\.0\.0\.1:\d+", log.read_text())
        if found:
            return found[0]
        time.sleep(0.1)
    raise SystemExit(f"tirgeo demo shows no page: {log.read_text()}")

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
"""Start node graphs and ``tirgeo demo --page`` for a measurement, and end them with it."""

from __future__ import annotations

import json
import re
import shutil
import signal
import socket
import socketserver
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dev.nodes import package_of
from tirgeo_ros.core.types.errors import GraphError
from tirgeo_ros.io.files.child_process import python_command
from tirgeo_ros.tools.graph.node_graph import (
    GraphSetup,
    NodeProcess,
    await_words,
    graph_environment,
    node_processes,
)

if TYPE_CHECKING:
    from playwright.sync_api import Page

_DEMO_LIMIT_S = 90.0


@dataclass(frozen=True)
class Graph:
    """Start nodes in one environment; their logs go to one folder."""

    folder: Path
    environment: dict[str, str]
    processes: list[NodeProcess]

    def start(
        self,
        name: str,
        values: Mapping[str, object] | None = None,
        words: Sequence[str] = (),
        log: str = "",
    ) -> NodeProcess:
        """Start a node with parameters and more arguments; ``log`` names its log if not it."""
        arguments = [*words]
        for key, value in (values or {}).items():
            arguments += ["-p", f"{key}:={value}"]
        path = self.folder / f"{log or name}.log"
        self.processes.append(
            NodeProcess(name, arguments, self.environment, path, package_of(name))
        )
        return self.processes[-1]

    def start_ready(self, name: str, values: Mapping[str, object], *words: str) -> NodeProcess:
        """Start a node and wait until it is ready."""
        process = self.start(name, values, words)
        await_words(self.processes, "ready")
        return process


@contextmanager
def started_graph(folder: Path) -> Iterator[Graph]:
    """Yield a graph without nodes, in a DDS domain of its own; end all its nodes."""
    folder.mkdir(parents=True, exist_ok=True)
    with node_processes() as processes:
        yield Graph(folder, graph_environment(GraphSetup(folder, folder)), processes)


def await_end(node: NodeProcess, limit_s: float) -> None:
    """Wait until a node ends by itself; raise GraphError if it does not."""
    if node.wait(limit_s) is None:
        raise GraphError(f"{node.name} did not end: {node.last_line()}")


def read_json(path: Path) -> Any:
    """Return what a node wrote at its end."""
    return json.loads(path.read_text())


def memory_mib(pid: int, field: str = "VmRSS") -> float:
    """Return a field of a process's status: its memory now, at most (``VmHWM``), or shared."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.partition(f"{field}:")[2].split()[0]) / 1024


@contextmanager
def busy(number: int) -> Iterator[list[subprocess.Popen[bytes]]]:
    """Keep so many processes busy with nothing for as long as the context lasts."""
    spin = python_command("while True: pass")
    spinning = [subprocess.Popen(spin) for _ in range(number)]  # noqa: S603  this very Python
    try:
        yield spinning
    finally:
        for process in spinning:
            process.kill()
            process.wait()


@contextmanager
def shown_demo(folder: Path, *words: object) -> Iterator[tuple[str, subprocess.Popen[bytes]]]:
    """Yield the page's address, which ends with no slash, and the demo's process; then end it.

    ``words`` are more arguments of the command. What it writes goes into ``folder``. Raises
    SystemExit if there is no page.
    """
    log = folder / "log"
    with socket.create_server(("127.0.0.1", 0)) as free:  # a page started again has the same
        address = f"127.0.0.1:{free.getsockname()[1]}"
    arguments = ["demo", "--page", address, "-o", folder, *words]
    with log.open("w") as out:
        command = [sys.executable, "-m", "tirgeo_ros.tools.cli.main", *map(str, arguments)]
        demo = subprocess.Popen(command, stdout=out, stderr=out)  # noqa: S603 our own
    try:
        yield _address(log, demo), demo
    finally:
        end_demo(demo)


def _address(log: Path, demo: subprocess.Popen[bytes]) -> str:
    end_s = time.monotonic() + _DEMO_LIMIT_S
    while time.monotonic() < end_s and demo.poll() is None:
        address = re.search(r"http://127\.0\.0\.1:\d+", log.read_text())
        if address:
            return address[0]
        time.sleep(0.1)
    raise SystemExit(f"tirgeo demo shows no page: {log.read_text()}")


def end_demo(demo: subprocess.Popen[bytes]) -> None:
    """End the demo, as Ctrl-C does; one that has ended stays so."""
    if demo.poll() is None:
        demo.send_signal(signal.SIGINT)
        demo.wait(_DEMO_LIMIT_S)


def node_pid(demo: int, name: str) -> int:
    """Return the process that runs a node for the demo; 0 if none does."""
    for path in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            parent = path.read_text().rpartition(")")[2].split()[1]
            if int(parent) == demo and name in path.with_name("cmdline").read_text():
                return int(path.parent.name)
    return 0


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


@contextmanager
def chromium() -> Iterator[Page]:
    """Run Chromium; yield an empty page."""
    from playwright.sync_api import sync_playwright  # noqa: PLC0415 of the tests alone

    path = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as driver:
        options = ["--no-sandbox", "--disable-dev-shm-usage", "--mute-audio"]
        browser = driver.chromium.launch(executable_path=path, args=options)
        yield browser.new_page(viewport={"width": 1280, "height": 800})
        browser.close()

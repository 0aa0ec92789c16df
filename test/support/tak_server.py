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
"""A real TAK server (taky), and members of the team who watch it."""

from __future__ import annotations

import contextlib
import queue
import socket
import ssl
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree as ET

from project import free_port, wait_until

PASSWORD = "atakatak"
#: Ends early; enough for the repeats of each minute on a machine that stands still.
WAIT_S = 150.0


class TakServer:
    """taky on a free port of 127.0.0.1, in a folder of its own."""

    def __init__(self, folder: Path, *, tls: bool = False) -> None:
        self.folder, self.tls, self.port = folder / "taky", tls, free_port()
        kind = [] if tls else ["--no-ssl"]
        addresses = ["--host", "localhost", "--bind-ip", "127.0.0.1", "--public-ip", "127.0.0.1"]
        self._takyctl("setup", *kind, *addresses, str(self.folder), cwd=folder)
        conf = self.folder / "taky.conf"
        lines = (
            conf.read_text().replace("port = 8089", "port = X").replace("port = 8087", "port = X")
        )
        conf.write_text(lines.replace("port = X", f"port = {self.port}"))
        self.process: subprocess.Popen[bytes] | None = None

    @property
    def address(self) -> str:
        return f"tls://localhost:{self.port}" if self.tls else f"tcp://127.0.0.1:{self.port}"

    @property
    def ca(self) -> str:
        return str(self.folder / "ssl/ca.crt")

    def client(self, name: str) -> Path:
        """Make a client's certificate: NAME.p12, and .crt and .key beside it."""
        self._takyctl("-c", "taky.conf", "build_client", "--dump_pem", name, cwd=self.folder)
        return next(self.folder.glob(f"{name}-*.p12"))

    def start(self) -> None:
        (self.folder / "taky-mgmt.sock").unlink(missing_ok=True)  # what a kill leaves
        command = [sys.executable, "-W", "ignore", "-m", "taky.cot", "-l", "debug"]
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen(
                [*command, "-c", "taky.conf"], cwd=self.folder, stdout=log, stderr=log
            )
        wait_until(self._listens, WAIT_S)

    def kill(self) -> None:
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process = None

    def _listens(self) -> bool:
        assert self.process is not None
        assert self.process.poll() is None, (self.folder / "log").read_text()
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", self.port), 1):
            return True
        return False

    @staticmethod
    def _takyctl(*words: str, cwd: Path) -> None:
        command = [sys.executable, "-W", "ignore", "-m", "taky.cli", *words]
        subprocess.run(command, cwd=cwd, check=True, capture_output=True, timeout=WAIT_S)


class Member:
    """Someone of the team, who gets all events of a stream or of a socket of datagrams."""

    def __init__(self, plug: socket.socket) -> None:
        self._plug = plug
        self._new: queue.SimpleQueue[ET.Element] = queue.SimpleQueue()
        self.events: list[ET.Element] = []
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    @classmethod
    def of(cls, server: TakServer, certificate: Path | None = None) -> Member:
        plug = socket.create_connection(("127.0.0.1", server.port), WAIT_S)
        if certificate is not None:
            context = ssl.create_default_context(cafile=server.ca)
            context.load_cert_chain(
                certificate.with_suffix(".crt"), certificate.with_suffix(".key"), PASSWORD
            )
            plug = context.wrap_socket(plug, server_hostname="localhost")
        plug.settimeout(None)
        return cls(plug)

    @classmethod
    def of_group(cls, group: str) -> Member:
        """Join a multicast group on the loopback interface, at a free port."""
        plug = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        plug.bind((group, 0))
        join = socket.inet_aton(group) + socket.inet_aton("127.0.0.1")
        plug.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, join)
        return cls(plug)

    @property
    def port(self) -> int:
        return self._plug.getsockname()[1]

    def close(self) -> None:
        with contextlib.suppress(OSError):
            self._plug.shutdown(socket.SHUT_RDWR)
        self._plug.close()

    def got(self, wanted: Callable[[ET.Element], object]) -> ET.Element:
        """Take events, of old and new ones, until one is wanted; return it."""
        end_s = time.monotonic() + WAIT_S
        while time.monotonic() < end_s:
            with contextlib.suppress(queue.Empty):
                event = self._new.get(timeout=0.5)
                self.events.append(event)
                if wanted(event):
                    return event
        observed = [(item.get("type"), item.get("uid")) for item in self.events]
        raise AssertionError(f"no such event within {WAIT_S} s; there were {observed}")

    def _read(self) -> None:
        datagrams = self._plug.type == socket.SOCK_DGRAM
        parser = ET.XMLPullParser(["end"])
        parser.feed("<stream>")
        with contextlib.suppress(OSError):
            while data := self._plug.recv(65536):
                if datagrams:  # each is one whole event
                    self._new.put(ET.fromstring(data))
                    continue
                parser.feed(data)
                for _, element in parser.read_events():
                    if element.tag == "event":
                        self._new.put(element)

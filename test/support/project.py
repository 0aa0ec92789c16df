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
"""Where the project's files are, its nodes, verbs and processes, free ports, and waiting."""

from __future__ import annotations

import argparse
import socket
import subprocess
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

PROJECT = Path(__file__).resolve().parents[2]

#: The executables that a launch file starts.
NODES = frozenset(
    {"dji_node", "ekf_node", "gimbal_node", "overlay_node", "viewer_node", "bag_player"}
)


def verb_parsers(
    parser: argparse.ArgumentParser | None = None, words: str = ""
) -> dict[str, argparse.ArgumentParser]:
    """Return the parser of every verb by its words, those within a verb too."""
    from tirgeo_ros.tools.cli.main import parser_of, verbs  # noqa: PLC0415 for few tests

    parser = parser or parser_of(verbs())
    inner = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not inner:
        return {words: parser}
    result: dict[str, argparse.ArgumentParser] = {}
    for name, item in inner[0].choices.items():
        result |= verb_parsers(item, f"{words} {name}".strip())
    return result


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


def reader_of(pid: int) -> int:
    """The only child of a process that reads maps."""
    return child_of(pid, "tirgeo_ros.io.maps.map_process")


def child_of(pid: int, words: str) -> int:
    """The child of a process that has words in its command: a module, or a node in quotes."""
    for child in children_of(pid):
        with suppress(OSError):  # it has ended meanwhile
            if words in Path(f"/proc/{child}/cmdline").read_text():
                return child
    raise AssertionError(f"process {pid} has none that runs {words}")


def children_of(pid: int) -> list[int]:
    """The processes that a process has started, and has not waited for."""
    result = []
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(OSError):  # that thread has ended meanwhile
            result += map(int, (task / "children").read_text().split())
    return result


def wait_until(
    done: Callable[[], T],
    limit_s: float = 60.0,
    *,
    running: subprocess.Popen | None = None,
    tell: Callable[[], object] = str,
) -> T:
    """Return what the function returns as soon as that counts as true; fail after the limit.

    ``running``: what must not end meanwhile; ``tell``: what is said of a failure.
    """
    end_s = time.monotonic() + limit_s
    while not (result := done()):
        assert running is None or running.poll() is None, tell()
        assert time.monotonic() < end_s, tell()
        time.sleep(0.005)
    return result


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """Return a port of 127.0.0.1 that is free, of TCP or with ``SOCK_DGRAM`` of UDP."""
    with socket.socket(socket.AF_INET, kind) as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])

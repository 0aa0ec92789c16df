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
"""Limit the memory, the time and the network that a file from outside may use.

GDAL opens what a file names: ``/vsicurl/`` in a VRT, the service in a description of a WMS or WFS,
and a dozen more; no single option turns this off. So GDAL runs in a thread to which the kernel
gives no socket (seccomp, Linux); where that is impossible, GDAL is not used. PROJ is told not to
fetch its grids.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import re
import resource
import signal
import struct
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from typing import TypeVar

from tirgeo_ros.core.types.errors import ConfigError

#: A GeoJSON of two million vertices just fits. Together with the program it stays below 1 GB.
MOST_BYTES = 720 << 20
#: Seconds of computing: GDAL reads the largest map that is drawn in one or two.
MOST_S = 7

T = TypeVar("T")

#: Signs of a place on the network, in a path or in a message of GDAL.
_ELSEWHERE = re.compile(r"://|/vsi|curl|resolve host|\.vrt\b", re.IGNORECASE)
HINT = " (over the network only with the parameter network: true)"

_SET_NO_NEW_PRIVS, _SET_SECCOMP, _FILTER = 38, 22, 2  # of prctl (linux/prctl.h)
#: Machine to its number in a filter (linux/audit.h) and the numbers of socket and io_uring_setup.
_MACHINES = {"x86_64": (0xC000003E, 41, 425), "aarch64": (0xC00000B7, 198, 425)}
_LOAD, _JUMP_IF, _RETURN = 0x20, 0x15, 0x06  # instructions of a filter (linux/bpf_common.h)
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000 | errno.EACCES


@contextmanager
def bounded_memory(most_bytes: int = MOST_BYTES) -> Iterator[None]:
    """Limit the process's additional memory; an allocation beyond it gets a MemoryError.

    The kernel (Linux) enforces the limit: it applies to libraries and to all threads, until the
    context ends.
    """
    used = _used_bytes()
    with _limit(resource.RLIMIT_DATA, used + most_bytes) if used else nullcontext():
        yield


@contextmanager
def bounded_time(most_s: int = MOST_S) -> Iterator[None]:
    """Limit the process's additional seconds of computing; SIGPROF ends it beyond them.

    RLIMIT_CPU is no way to it: it counts the kernel's ticks, of which a process that runs for
    minutes may have some seconds more than anything tells it.
    """
    signal.setitimer(signal.ITIMER_PROF, most_s)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


@contextmanager
def _limit(kind: int, most: int) -> Iterator[None]:
    """Lower a limit of the process until the context ends; a limit that is lower already stays."""
    before, hard = resource.getrlimit(kind)
    resource.setrlimit(kind, (min([most, *(each for each in (before, hard) if each >= 0)]), hard))
    try:
        yield
    finally:
        resource.setrlimit(kind, (before, hard))


def _used_bytes() -> int:
    """Return the process's private memory in bytes, as the limit counts it; 0 if not known."""
    with suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text().splitlines()
        size = next(line for line in lines if line.startswith("VmData:"))
        return int(size.split()[1]) << 10
    return 0


def read_map(work: Callable[[], T], *, network: bool) -> T:
    """Return what ``work`` returns, or raise what it raises.

    Without ``network`` it runs in a thread that has no network. Raises ConfigError where a thread
    cannot be cut off from it.
    """
    from pyproj import network as proj  # noqa: PLC0415  not needed to limit memory alone

    proj.set_network_enabled(active=network)  # type: ignore[attr-defined]
    if network:
        return work()
    result = Future[T]()

    def run() -> None:
        try:
            why = _close_network()
            if why:
                raise ConfigError(  # noqa: TRY301  caught below
                    f"GDAL cannot be kept from the network here ({why}); set network: true"
                )
            result.set_result(work())
        except BaseException as error:  # noqa: BLE001  raised again below
            result.set_exception(error)

    threading.Thread(target=run, name="without network", daemon=True).start()
    return result.result()


def elsewhere(text: str) -> str:
    """Return the hint for a message that names a place on the network; else ""."""
    return HINT if _ELSEWHERE.search(text) else ""


def _close_network() -> str:
    """Let the kernel refuse sockets to this thread; return "", or why that is impossible."""
    if platform.system() != "Linux" or platform.machine() not in _MACHINES:
        return f"{platform.system()} on {platform.machine()}"
    program = _program(*_MACHINES[platform.machine()])
    steps = ctypes.create_string_buffer(program, len(program))
    # struct sock_fprog: number of instructions, and their address.
    head = struct.pack("HxxxxxxP", len(program) // 8, ctypes.addressof(steps))
    whole = ctypes.create_string_buffer(head, len(head))
    libc = ctypes.CDLL(None, use_errno=True)
    libc.prctl.argtypes = [ctypes.c_int, *[ctypes.c_ulong] * 4]
    for words in ((_SET_NO_NEW_PRIVS, 1, 0), (_SET_SECCOMP, _FILTER, ctypes.addressof(whole))):
        if libc.prctl(*words, 0, 0):
            return os.strerror(ctypes.get_errno())
    return ""


def _program(machine: int, *calls: int) -> bytes:
    """Return the filter: it refuses these calls, which begin a connection on this machine."""
    steps = [
        (_LOAD, 0, 0, 4),  # seccomp_data.arch
        (_JUMP_IF, 0, len(calls) + 1, machine),
        (_LOAD, 0, 0, 0),  # seccomp_data.nr
        *((_JUMP_IF, len(calls) - i, 0, call) for i, call in enumerate(calls)),
        (_RETURN, 0, 0, _ALLOW),
        (_RETURN, 0, 0, _REFUSE),
    ]
    return b"".join(struct.pack("HBBI", *step) for step in steps)

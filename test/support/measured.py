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
"""Attacks run in a child: what it said, how long it took and how much memory it filled."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass

#: What is asked for; and what no attack may pass whatever the code does.
MOST_BYTES, LONGEST_S = 1_000_000_000, 10.0
_NET_BYTES, _NET_S = 6 << 30, 900.0  # a busy machine gives a child a twentieth of a core


@dataclass(frozen=True)
class Measured:
    """Of a child that has ended."""

    exit_code: int
    said: str
    peak_bytes: int
    cpu_s: float

    def check_modest(self) -> None:
        """Fail where it took more than an attack may take; the clock would tell of other work."""
        assert self.peak_bytes <= MOST_BYTES, self
        assert self.cpu_s <= LONGEST_S, self


def run_measured(program: str, *arguments: str) -> Measured:
    """Run a Python program to its end, in a net that spares the machine."""

    def spread_net() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (_NET_BYTES, _NET_BYTES))

    with tempfile.TemporaryFile() as out:
        child = subprocess.Popen(
            [sys.executable, "-c", program, *arguments],
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.STDOUT,
            preexec_fn=spread_net,  # noqa: PLW1509  it calls the kernel alone
        )
        end_s = time.monotonic() + _NET_S
        pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        while not pid:
            if time.monotonic() > end_s:
                child.kill()
            time.sleep(0.02)
            pid, status, usage = os.wait4(child.pid, os.WNOHANG)
        child.returncode = os.waitstatus_to_exitcode(status)
        out.seek(0)
        said = out.read().decode(errors="replace")[-4000:]
    cpu_s = usage.ru_utime + usage.ru_stime
    return Measured(child.returncode, said, usage.ru_maxrss * 1024, cpu_s)

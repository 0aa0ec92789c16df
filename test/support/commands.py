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
"""A command that runs the graph, as a process whose output is in a file."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

from project import wait_until

START_S = 120.0


class Command:
    """``tirgeo WORDS`` in a folder; ``variables`` are more of its environment."""

    def __init__(self, folder: Path, *words: object, **variables: str) -> None:
        folder.mkdir(exist_ok=True)
        self._log = folder / "log"
        command = [sys.executable, "-m", "tirgeo_ros.tools.cli.main", *map(str, words)]
        env = {**os.environ, **variables}
        with self._log.open("w") as log:
            self.process = subprocess.Popen(command, cwd=folder, env=env, stdout=log, stderr=log)

    @property
    def log(self) -> str:
        return self._log.read_text()

    @property
    def pid(self) -> int:
        """The process that has started the nodes."""
        return self.process.pid

    @property
    def url(self) -> str:
        """Where the page is, as soon as the node says so."""
        return self.await_line(r"the page is at (\S+)/")

    def await_line(self, pattern: str) -> str:
        return self._await(lambda: re.search(pattern, self.log))[1]

    def await_ready(self, nodes: int = 4) -> None:
        self._await(lambda: self.log.count("]: ready") >= nodes)

    def _await(self, done: Any) -> Any:
        return wait_until(done, START_S, running=self.process, tell=self._log.read_text)

    def ended(self) -> int:
        return self.process.wait(60)

    def close(self) -> None:
        self.process.terminate()
        self.process.wait(60)

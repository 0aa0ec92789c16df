"""A command that serves the page of the real nodes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

from project import wait_until

from tirgeo_ros.tools.graph.node_graph import free_domain

START_S = 120.0


class FlownPage:
    """A command that serves the page of the real nodes, in a DDS domain of its own."""

    def __init__(self, folder: Path, *words: str | Path) -> None:
        self._log = folder / "log"
        with self._log.open("w") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "tirgeo_ros.tools.cli.main", *map(str, words)],
                cwd=folder,
                env={**os.environ, "ROS_DOMAIN_ID": str(free_domain())},
                stdout=log,
                stderr=log,
            )

    @property
    def log(self) -> str:
        return self._log.read_text()

    @property
    def url(self) -> str:
        """Where the page is, as soon as the node says so."""
        return wait_until(
            lambda: re.search(r"the page is at (\S+)", self.log),
            START_S,
            running=self._process,
            tell=self._log.read_text,
        )[1]

    @property
    def pid(self) -> int:
        """The process that has started the nodes."""
        return self._process.pid

    def close(self) -> None:
        self._process.terminate()
        self._process.wait(60)

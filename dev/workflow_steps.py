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
"""Run the steps of a workflow's job on this machine, in a fresh clone of what is committed.

    python -m dev.workflow_steps .github/workflows/ci.yml wheels python=3.11

The values are those of the job's matrix. Steps with ``uses:`` are GitHub's own: a checkout is the
clone, the others are named and left out. The first step that fails ends it, with its exit code.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

#: How GitHub calls bash for a step, by the workflow's ``shell:``; without one it has no pipefail.
_SHELLS = {
    None: ("bash", "-e", "-c"),
    "bash": ("bash", "--noprofile", "--norc", "-eo", "pipefail", "-c"),
}


def filled(text: str, matrix: Mapping[str, str]) -> str:
    """Return a text with the matrix's values; raise KeyError where none is given."""
    return re.sub(r"\$\{\{ matrix\.(\w+) \}\}", lambda name: matrix[name[1]], text)


def run_job(job: Mapping[str, Any], matrix: Mapping[str, str], source: Path, work: Path) -> int:
    """Clone ``source`` into the folder ``work`` and run the steps there; return the exit code."""
    shell = _SHELLS[job.get("defaults", {}).get("run", {}).get("shell")]
    environment = {**os.environ, **job.get("env", {}), "CI": "true"}
    for step in job["steps"]:
        if "run" not in step:
            _prepare(step, source, work)
            continue
        text = filled(step["run"], matrix)
        _say(f"+ {text.strip()}")
        start_s = time.monotonic()
        code = subprocess.call([*shell, text], cwd=work, env=environment)  # noqa: S603  the workflow's own
        _say(f"= exit code {code} after {time.monotonic() - start_s:.0f} s")
        if code:
            return code
    return 0


def _prepare(step: Mapping[str, Any], source: Path, work: Path) -> None:
    """Clone for a checkout; name any other action."""
    _say(f"- {step['uses']}")
    if step["uses"].startswith("actions/checkout@"):
        folder = work / step.get("with", {}).get("path", ".")
        command = ["git", "clone", "--quiet", str(source), str(folder)]
        subprocess.run(command, check=True)  # noqa: S603


def _say(line: str) -> None:
    """Write a line before the next step writes its own."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main(workflow: str, name: str, *values: str) -> int:
    """Run a job of a workflow file, with ``name=value`` for its matrix."""
    job = yaml.safe_load(Path(workflow).read_text(encoding="utf-8"))["jobs"][name]
    matrix = dict(value.split("=", 1) for value in values)
    with tempfile.TemporaryDirectory() as work:
        return run_job(job, matrix, Path.cwd(), Path(work))


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))

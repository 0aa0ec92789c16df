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
"""Print the known vulnerabilities of this environment's packages: ``make audit``.

It reads what pip-audit wrote as JSON. Each vulnerability is a line, and the exit code is then 1.
A line says so where nobody was asked: without a network pip-audit knows none of the packages.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def answers(path: Path) -> list[dict[str, Any]]:
    """Return what pip-audit says of each package; nothing if it reached nobody."""
    text = path.read_text() if path.exists() else ""
    return list(json.loads(text)["dependencies"]) if text else []


def vulnerabilities(packages: Sequence[dict[str, Any]]) -> list[str]:
    """Return a line for each known vulnerability, with the version that mends it."""
    return [
        f"{package['name']} {package['version']}: {fault['id']}, mended in "
        f"{', '.join(fault['fix_versions']) or 'no version yet'}"
        for package in packages
        for fault in package.get("vulns", [])
    ]


def main(arguments: Sequence[str] | None = None) -> int:
    """Print what is known of the packages; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m dev.audit", description=__doc__)
    parser.add_argument("said", type=Path, help="what pip-audit --format json wrote")
    packages = answers(parser.parse_args(arguments).said)
    known = sum("vulns" in package for package in packages)
    if not known:
        sys.stdout.write("vulnerabilities: nobody was asked: PyPI's database is out of reach\n")
        return 0
    lines = vulnerabilities(packages)
    others = f"{len(packages) - known} others are not in PyPI's database"
    sys.stdout.write(f"vulnerabilities: {len(lines)} in {known} packages; {others}\n")
    sys.stdout.writelines(f"{line}\n" for line in lines)
    return int(bool(lines))


if __name__ == "__main__":
    sys.exit(main())

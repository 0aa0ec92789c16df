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

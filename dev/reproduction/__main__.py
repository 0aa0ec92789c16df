"""``make reproduction``: runs the commands of ``docs/reproduction.md`` and writes the page."""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from dev.reproduction.page import page
from dev.reproduction.sections import QUICK, SCENARIO, Amounts
from tirgeo_ros.core.types.errors import CalibrationError, TirgeoError
from tirgeo_ros.io.files.whole_files import write_files


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page that the arguments ask for."""
    parser = argparse.ArgumentParser(
        prog="python -m dev.reproduction",
        description="Runs the commands of docs/reproduction.md and writes the page anew.",
    )
    parser.add_argument(
        "--work", type=Path, metavar="DIR", help="keep what the commands write (default: do not)"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        default=Path("docs/reproduction.md"),
        metavar="MD",
        help="default: %(default)s",
    )
    parser.add_argument(
        "--quick", action="store_true", help="little of everything: a look, not a result"
    )
    args = parser.parse_args(argv)
    if not Path(SCENARIO).is_file():
        parser.error(f"{SCENARIO} is not here: run it in the project's folder")
    try:
        with tempfile.TemporaryDirectory() as folder:
            text = page(QUICK if args.quick else Amounts(), args.work or Path(folder))
        write_files({args.output: text}, CalibrationError)
    except (TirgeoError, OSError) as error:
        sys.stderr.write(f"reproduction: {error}\n")
        return 1
    sys.stdout.write(f"wrote {args.output}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

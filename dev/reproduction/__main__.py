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
"""``make reproduction``: run the commands of ``page.md`` and write ``docs/reproduction.md``.

The template's fences name the results of their commands, in order: the commands that a reader
sees are those that were run. Words in braces are filled in from the results. Paths below
``reproduction`` stand on the page, and lie in the folder that is worked in.
"""

from __future__ import annotations

import argparse
import importlib
import re
import shlex
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from dev.judging import exit_code
from dev.reproduction.tables import (
    Results,
    askew,
    boards,
    ground_factors,
    imu_noise,
    located,
    p_values,
)
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.tools.cli.main import parser_of, verbs
from tirgeo_ros.tools.presentation.results import plain

TEMPLATE = Path(__file__).with_name("page.md")
_WORK = "reproduction/"
_FENCE = re.compile(r"^```sh ([^\n]*)\n(.*?)^```\n", re.MULTILINE | re.DOTALL)
_FILE = re.compile(r"^cat > (\S+) <<'END'\n(.*?)^END\n", re.MULTILINE | re.DOTALL)
#: Little of everything, for a look at the page and for tests: its numbers say nothing.
_QUICK = {
    "--hours 5": "--hours 0.05",
    "seed in 1 2 3 4 5;": "seed in 1;",
    "--no-images": "--no-images --start 25 --duration 30",
    "--views 40 --seconds 30": "--views 8 --seconds 1.5",
}


def commands(block: str, names: Sequence[str]) -> dict[str, list[str]]:
    """Return the words of a shell block's commands by name, each in a loop once for each seed."""
    unused, seeds = iter(names), [""]
    commands: dict[str, list[str]] = {}
    for line in _FILE.sub("", block).replace("\\\n", " ").splitlines():
        if line.startswith("for seed in "):
            seeds = line.removeprefix("for seed in ").removesuffix("; do").split()
        elif line == "done":
            seeds = [""]
        elif line.strip():
            name = next(unused)
            for seed in seeds:
                commands[name.replace("$seed", seed)] = shlex.split(line.replace("$seed", seed))
    return commands


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """Return the arguments of ``tirgeo ...`` or ``python -m MODULE ...``, by its own parser.

    ``verb_module`` is the module that runs them. Raise SystemExit for wrong ones.
    """
    if words[0] == "tirgeo":
        return parser_of(verbs()).parse_args(words[1:])
    module = importlib.import_module(words[2])
    args: argparse.Namespace = module.parser().parse_args(words[3:])
    args.verb_module = module
    return args


def carried_out(template: str, work: Path) -> Results:
    """Run every command of a template in a folder; return the results by name.

    Raise TirgeoError if a command fails or its result is incomplete.
    """
    work.mkdir(parents=True, exist_ok=True)

    def below(word: str) -> str:
        return str(work / word.removeprefix(_WORK)) if word.startswith(_WORK) else word

    results: dict[str, Mapping[str, Any]] = {}
    for names, block in _FENCE.findall(template):
        for path, text in _FILE.findall(block):
            Path(below(path)).write_text(text, encoding="utf-8")
        for name, words in commands(block, names.split(", ")).items():
            if sys.stderr.isatty():
                sys.stderr.write(f"{shlex.join(words)}\n")
            args = parsed([below(word) for word in words])
            result = args.verb_module.run(args)
            if result.get("error") is not None:
                raise CalibrationError(str(result["error"]))
            results[name] = plain(result)  # type: ignore[assignment]
    return results


def page(template: str, results: Results) -> str:
    """Return the page: the commands as they stand, the words in braces filled in."""
    values = ground_factors(results) | imu_noise(results["allan"]) | located(results)
    values |= askew(results) | {"p_values": p_values(results)} | boards(results)
    parts = re.split(r"^(```sh.*?^```\n)", template, flags=re.MULTILINE | re.DOTALL)
    parts[::2] = [part.format_map(values) for part in parts[::2]]
    parts[1::2] = [re.sub(r"\A```sh[^\n]*", "```sh", part) for part in parts[1::2]]
    return "".join(parts)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page that the arguments ask for."""
    parser = argparse.ArgumentParser(prog="python -m dev.reproduction", description=__doc__)
    parser.add_argument("--work", type=Path, metavar="DIR", help="keep what the commands write")
    parser.add_argument(
        "-o", "--output", type=Path, default=Path("docs/reproduction.md"), metavar="MD"
    )
    parser.add_argument("--quick", action="store_true", help="little of everything: no result")
    args = parser.parse_args(argv)
    if not Path("config/scenarios").is_dir():
        parser.error("config/scenarios is not here: run it in the project's folder")
    template = TEMPLATE.read_text(encoding="utf-8")
    for usual, quick in _QUICK.items() if args.quick else ():
        template = template.replace(usual, quick)
    return exit_code("reproduction", lambda: _write(template, args.work, args.output))


def _write(template: str, work: Path | None, output: Path) -> int:
    with tempfile.TemporaryDirectory() as folder:
        results = carried_out(template, work or Path(folder))
    write_files({output: page(template, results)}, CalibrationError)
    sys.stdout.write(f"wrote {output}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

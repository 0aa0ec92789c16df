"""Commands as a reader types them: shown on the page, and carried out in this process.

One text serves both, so that the page cannot tell of other commands than those that were run.
Paths below ``WORK`` are shown as they stand and looked for in the folder that is worked in.
"""

from __future__ import annotations

import argparse
import importlib
import re
import shlex
import sys
import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.tools.cli.main import parser_of, plain, verbs

WORK = "reproduction"
_WIDTH = 96
_OPTION, _JOIN = re.compile(r"( --?[a-z-]+) (?!-)"), "\0"

#: What the commands gave, by their names.
Results: TypeAlias = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Run:
    """A command and the name of its result."""

    name: str
    line: str


@dataclass(frozen=True)
class Put:
    """A small file."""

    path: str
    text: str


@dataclass(frozen=True)
class ForSeeds:
    """Commands for several seeds; ``$seed`` stands for each in their lines and names."""

    seeds: Sequence[int]
    runs: Sequence[Run]


Step: TypeAlias = Run | Put | ForSeeds


def shell(steps: Sequence[Step]) -> str:
    """The steps for a shell."""
    return "\n".join(_shown(step) for step in steps)


def _shown(step: Step) -> str:
    if isinstance(step, Put):
        return f"cat > {step.path} <<'END'\n{step.text}END"
    if isinstance(step, Run):
        return _folded(step.line, "")
    lines = [_folded(run.line, "  ") for run in step.runs]
    seeds = " ".join(map(str, step.seeds))
    return "\n".join([f"for seed in {seeds}; do", *lines, "done"])


def _folded(line: str, indent: str) -> str:
    """Broken as a shell takes it, but not between an option and its value."""
    parts = textwrap.wrap(
        _OPTION.sub(rf"\1{_JOIN}", line),
        _WIDTH,
        initial_indent=indent,
        subsequent_indent=f"{indent}    ",
        break_long_words=False,
        break_on_hyphens=False,
    )
    return " \\\n".join(parts).replace(_JOIN, " ")


def parsed(words: Sequence[str]) -> argparse.Namespace:
    """The arguments of ``tirgeo ...`` or ``python -m MODULE ...``, by the command's own parser.

    ``verb_module`` is the module that runs them. Leaves by SystemExit where they are wrong.
    """
    if words[0] == "tirgeo":
        return parser_of(verbs()).parse_args(words[1:])
    module = importlib.import_module(words[2])
    args: argparse.Namespace = module.parser().parse_args(words[3:])
    args.verb_module = module
    return args


def carry_out(steps: Sequence[Step], work: Path) -> dict[str, Mapping[str, Any]]:
    """Do the steps with ``work`` for WORK; the results by name.

    Raises TirgeoError where a command fails, also where its result is incomplete.
    """
    found = {}
    for step in steps:
        if isinstance(step, Put):
            Path(_below(step.path, work)).write_text(step.text, encoding="utf-8")
        for run in _runs(step):
            found[run.name] = _result(run.line, work)
    return found


def _runs(step: Step) -> list[Run]:
    if isinstance(step, ForSeeds):
        return [
            Run(run.name.replace("$seed", str(seed)), run.line.replace("$seed", str(seed)))
            for seed in step.seeds
            for run in step.runs
        ]
    return [step] if isinstance(step, Run) else []


def _result(line: str, work: Path) -> Mapping[str, Any]:
    if sys.stderr.isatty():
        sys.stderr.write(f"{line}\n")
    args = parsed([_below(word, work) for word in shlex.split(line)])
    result: Mapping[str, Any] = args.verb_module.run(args)
    if result.get("error") is not None:
        raise CalibrationError(str(result["error"]))
    shown = plain(result)
    assert isinstance(shown, dict)
    return shown


def _below(word: str, work: Path) -> str:
    """A path below WORK in the folder that is worked in; any other word as it is."""
    return str(work / word.removeprefix(f"{WORK}/")) if word.startswith(f"{WORK}/") else word

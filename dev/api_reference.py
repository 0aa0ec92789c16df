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
"""Build the reference of the public interface from its docstrings, by pdoc: ``make api``.

Exit code 1 where a public name has no docstring, where a docstring names an error that is not
public, or where pdoc warns. Each of these is a line.
"""

from __future__ import annotations

import argparse
import builtins
import importlib
import inspect
import re
import sys
import warnings
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, get_type_hints

import tirgeo_ros
from tirgeo_ros.core.types.missing_package import missing_line

_ERROR = re.compile(r"\b[A-Z]\w*Error\b")


def public_names() -> dict[str, Any]:
    """Return what the package lists as public, imported."""
    return {name: getattr(tirgeo_ros, name) for name in tirgeo_ros.__all__}


def faults(public: Mapping[str, Any]) -> list[str]:
    """Return a line for each public docstring that is missing, or names what is not public."""
    problems = []
    for name, item in _described(public):
        text = item if isinstance(item, str) else inspect.getdoc(item) or ""
        if not text or text.startswith(f"{name}("):  # of a dataclass: its signature
            problems.append(f"{name}: no docstring")
        # A program could not catch an error that is not public.
        errors = [x for x in _ERROR.findall(text) if x not in public and not hasattr(builtins, x)]
        problems += [f"{name}: its docstring names {x}, which is not public" for x in errors]
    return problems


def build(folder: Path, public: Mapping[str, Any]) -> list[str]:
    """Write the pages to a folder; return pdoc's warnings, a line each."""
    try:
        pdoc = importlib.import_module("pdoc")
    except ModuleNotFoundError:
        return [missing_line("pdoc")]
    assert all(vars(tirgeo_ros)[name] is item for name, item in public.items())  # pdoc looks there
    for item in public.values():
        if hasattr(item, "_fields"):  # the constructor of a named tuple does not know its module
            item.__new__.__annotations__ = get_type_hints(item)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", UserWarning)
        pdoc.render.configure(docformat="markdown", footer_text=f"tirgeo {tirgeo_ros.__version__}")
        pdoc.pdoc(tirgeo_ros.__name__, output_directory=folder)
    warned = [
        str(warning.message) for warning in caught if issubclass(warning.category, UserWarning)
    ]
    return [f"pdoc: {text.strip().splitlines()[0]}" for text in warned]


def main(arguments: Sequence[str] | None = None) -> int:
    """Check and build; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m dev.api_reference", description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=Path("build/api"))
    folder: Path = parser.parse_args(arguments).folder
    public = public_names()
    lines = [*faults(public), *build(folder, public)]
    sys.stderr.writelines(f"{line}\n" for line in lines)
    if lines:
        return 1
    sys.stdout.write(f"{len(public)} public names: {folder / 'index.html'}\n")
    return 0


def _described(public: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Yield what needs a docstring: its full name, and itself."""
    yield tirgeo_ros.__name__, tirgeo_ros.__doc__ or ""
    for name, item in public.items():
        yield name, item
        members = vars(item).items() if inspect.isclass(item) else ()
        for key, member in members:
            kinds = inspect.isroutine(member) or isinstance(member, property | classmethod)
            if kinds and not key.startswith("_"):
                yield f"{name}.{key}", member


if __name__ == "__main__":
    sys.exit(main())

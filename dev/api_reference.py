"""Build the reference of the public interface from its docstrings, by pdoc: ``make api``.

Exit code 1 where a public name has no docstring, where a docstring names a class that does not
exist or an error that is not public, or where pdoc warns. Each of these is a line.
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
from tirgeo_ros.io.files.missing_package import missing_line

_CODE = re.compile(r"``([^`]+)``")
#: A class's name, maybe with an attribute: FilteredFlight.columns, Located. Not CSV, not N.
_CLASS = re.compile(r"([A-Z][A-Za-z]*[a-z][A-Za-z]*)(?:\.(\w+))?(?:\(\))?")
_ERROR = re.compile(r"\b[A-Z]\w*Error\b")


def public_names() -> dict[str, Any]:
    """Return what the package lists as public, imported."""
    return {name: getattr(tirgeo_ros, name) for name in tirgeo_ros.__all__}


def faults(public: Mapping[str, Any]) -> list[str]:
    """Return a line for each public docstring that is missing, or names what is not public."""
    problems = []
    for name, owner, item in _described(public):
        text = item if isinstance(item, str) else inspect.getdoc(item) or ""
        if not text or text.startswith(f"{name}("):  # of a dataclass: its signature
            problems.append(f"{name}: no docstring")
        unknown = [*_unknown_classes(text, public, owner), *_unknown_errors(text, public)]
        lines = [f"{name}: its docstring names {one}, which is not public" for one in unknown]
        problems += dict.fromkeys(lines)
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
    warned = [str(one.message) for one in caught if issubclass(one.category, UserWarning)]
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


def _described(public: Mapping[str, Any]) -> Iterator[tuple[str, Any, Any]]:
    """Yield what needs a docstring: its full name, the class or module it is of, and itself."""
    yield tirgeo_ros.__name__, tirgeo_ros, tirgeo_ros.__doc__ or ""
    for name, item in public.items():
        yield name, item, item
        if inspect.isclass(item):
            members = {key: one for key, one in vars(item).items() if not key.startswith("_")}
            for key, one in members.items():
                if inspect.isroutine(one) or isinstance(one, property | classmethod):
                    yield f"{name}.{key}", item, one


def _unknown_classes(text: str, public: Mapping[str, Any], owner: Any) -> Iterator[str]:
    """Yield the classes in code of a text, and their attributes, that are not there."""
    near = vars(inspect.getmodule(owner) or owner)
    for code in _CODE.findall(text):
        named = _CLASS.fullmatch(code)
        if named is None:
            continue
        head, tail = named.groups()
        known = public.get(head, near.get(head, getattr(builtins, head, None)))
        if known is None or (tail and not _has(known, tail)):
            yield code


def _has(kind: Any, attribute: str) -> bool:
    return hasattr(kind, attribute) or attribute in inspect.get_annotations(kind)


def _unknown_errors(text: str, public: Mapping[str, Any]) -> Iterator[str]:
    """Yield the errors in a text that are not public: a program could not catch them."""
    for name in _ERROR.findall(text):
        if name not in public and not hasattr(builtins, name):
            yield name


if __name__ == "__main__":
    sys.exit(main())

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
"""Find which packages import which others, and write that as a table.

``python test/support/package_edges.py`` writes ``test/packages.md``.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

from project import PROJECT

ROOTS = ("tirgeo_ros", "dev")
PAGE = PROJECT / "test" / "packages.md"
_HEAD = """# The packages, and what each imports

Written by `python test/support/package_edges.py`; `test/test_layering.py` holds the order.

"""

Graph = dict[str, set[str]]


def modules() -> dict[str, Path]:
    """Return every module of the product and of the laboratory by its dotted name."""
    paths = (path for root in ROOTS for path in (PROJECT / root).rglob("*.py"))
    return {dotted(path.relative_to(PROJECT)): path for path in sorted(paths)}


def dotted(path: Path) -> str:
    """Return the dotted name of a module's path under the project."""
    return ".".join(path.with_suffix("").parts).removesuffix(".__init__")


def imported(name: str, path: Path) -> Iterator[str]:
    """Yield full names of all that a module imports, wherever in it the import stands."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text(), str(path))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1]
            base = ".".join([*above, node.module or ""]).strip(".") if node.level else node.module
            yield from (f"{base}.{alias.name}" for alias in node.names)


def module_graph(paths: dict[str, Path]) -> Graph:
    """Return which of these modules each one imports; a package counts as its __init__."""
    graph: Graph = {}
    for name, path in paths.items():
        names = set(imported(name, path))
        own = {other if other in paths else other.rpartition(".")[0] for other in names}
        graph[name] = {other for other in own if other in paths and other != name}
    return graph


def package_of(name: str, path: Path) -> str:
    """Return a module's package: ``core.frames``, ``core.navigation.ins``, ``nodes``, ``dev``."""
    parts = name.split(".")
    if path.name != "__init__.py":
        parts = parts[:-1]
    return "dev" if parts[0] == "dev" else ".".join(parts[1:])


def package_graph(paths: dict[str, Path]) -> Graph:
    """Return which packages each package imports."""
    packages = {name: package_of(name, path) for name, path in paths.items()}
    graph: Graph = {package: set() for package in packages.values()}
    for name, others in module_graph(paths).items():
        graph[packages[name]] |= {packages[other] for other in others} - {packages[name]}
    return graph


def rooms(graph: Graph, package: str) -> Graph:
    """Return which packages just below a package import which others of them.

    The package's own modules are the one named as the package.
    """
    depth = package.count(".") + 2 if package else 1

    def room(name: str) -> str:
        return ".".join(name.split(".")[:depth])

    inside = {name for name in graph if f"{name}.".startswith(f"{package}." if package else "")}
    graph_of_rooms: Graph = {}
    for name in inside:
        graph_of_rooms.setdefault(room(name), set()).update(map(room, graph[name] & inside))
    return {name: others - {name} for name, others in graph_of_rooms.items()}


def page(graph: Graph) -> str:
    """Return a Markdown table of all packages: what each does, and what it imports."""
    rows = ["| package | does | imports |", "| --- | --- | --- |"]
    layers = {"core", "dji", "io", "tools"}  # hold no modules of their own
    for package, others in sorted(graph.items()):
        if package and package not in layers:
            rows.append(f"| `{package}` | {_first_line(package)} | {_short(others)} |")
    return _HEAD + "\n".join(rows) + "\n"


def _first_line(package: str) -> str:
    folder = PROJECT if package == "dev" else PROJECT / "tirgeo_ros"
    text = (folder / package.replace(".", "/") / "__init__.py").read_text()
    return (ast.get_docstring(ast.parse(text)) or "").split("\n")[0].replace("``", "`")


def _short(others: set[str]) -> str:
    """Return packages by layer: ``core: frames, types; io: bags``."""
    layers: dict[str, list[str]] = {}
    for other in sorted(others):
        layer, _, rest = other.partition(".")
        layers.setdefault(layer, []).extend([rest] if rest else [])
    return "; ".join(
        f"{layer}: {', '.join(names)}" if names else layer
        for layer, names in layers.items()
        if layer
    )


if __name__ == "__main__":
    PAGE.write_text(page(package_graph(modules())))

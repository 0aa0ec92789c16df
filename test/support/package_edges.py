"""Find which packages import which others, and write that as the table of CONTRIBUTING.md.

``python test/support/package_edges.py`` prints the table; it stands in CONTRIBUTING.md.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

from project import PROJECT

ROOTS = ("tirgeo_ros", "dev")

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


def module_graph(known: dict[str, Path]) -> Graph:
    """Return which known modules each known module imports; a package counts as its __init__."""
    graph: Graph = {}
    for name, path in known.items():
        full = set(imported(name, path))
        own = {one if one in known else one.rpartition(".")[0] for one in full}
        graph[name] = {one for one in own if one in known and one != name}
    return graph


def package_of(name: str, path: Path) -> str:
    """Return the package that a module belongs to: ``core.frames``, ``nodes``, ``dev``."""
    parts = name.split(".")
    if path.name != "__init__.py":
        parts = parts[:-1]
    if parts[0] == "dev":
        return "dev"
    return ".".join(parts[1 : 2 if parts[1:2] == ["nodes"] else 3])


def package_graph(known: dict[str, Path]) -> Graph:
    """Return which packages each package imports."""
    packages = {name: package_of(name, path) for name, path in known.items()}
    graph: Graph = {package: set() for package in packages.values()}
    for name, others in module_graph(known).items():
        graph[packages[name]] |= {packages[other] for other in others} - {packages[name]}
    return graph


def table(graph: Graph) -> str:
    """Return a Markdown table of all packages: what each does, and what it imports."""
    rows = ["| package | does | imports |", "| --- | --- | --- |"]
    for package, others in sorted(graph.items()):
        if "." in package or package in {"library", "nodes", "dev"}:
            rows.append(f"| `{package}` | {_first_line(package)} | {_short(others)} |")
    return "\n".join(rows) + "\n"


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
    sys.stdout.write(table(package_graph(modules())))

"""Where the project's files are, its nodes and verbs, whose a DDS port is, its workers."""

from __future__ import annotations

import argparse
import socket
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]

#: The executables that a launch file starts.
NODES = frozenset(
    {"dji_node", "ekf_node", "gimbal_node", "overlay_node", "viewer_node", "bag_player"}
)


def verb_parsers(
    parser: argparse.ArgumentParser | None = None, words: str = ""
) -> dict[str, argparse.ArgumentParser]:
    """Return the parser of every verb by its words, those within a verb too."""
    from tirgeo_ros.tools.cli.main import parser_of, verbs  # noqa: PLC0415 for few tests

    parser = parser or parser_of(verbs())
    inner = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not inner:
        return {words: parser}
    found: dict[str, argparse.ArgumentParser] = {}
    for name, one in inner[0].choices.items():
        found |= verb_parsers(one, f"{words} {name}".strip())
    return found


def taken_port(domain: int) -> socket.socket:
    """Hold the port of a domain's first participant (RTPS 2.2, section 9.6.1.1) until closed.

    Raises OSError where somebody has it.
    """
    taken = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        taken.bind(("", 7410 + 250 * domain))
    except OSError:
        taken.close()
        raise
    return taken


def reader_of(pid: int) -> int:
    """The only child of a process that reads maps."""
    return worker_of(pid, "tirgeo_ros.io.maps.map_process")


def worker_of(pid: int, module: str) -> int:
    """The only child of a process that runs a module."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            words = (path / "cmdline").read_text()
        except OSError:
            continue
        if parent == pid and module in words:
            return int(path.name)
    raise AssertionError(f"process {pid} has none that runs {module}")


def child_of(pid: int, name: str) -> int:
    """The process of a node that a process has started."""
    for task in Path(f"/proc/{pid}/task").iterdir():
        for child in (task / "children").read_text().split():
            if f"'{name}'" in Path(f"/proc/{child}/cmdline").read_text():
                return int(child)
    raise AssertionError(f"process {pid} has no {name}")

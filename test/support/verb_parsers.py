"""Return the command's parsers by verb."""

from __future__ import annotations

import argparse

from tirgeo_ros.tools.cli.main import parser_of, verbs


def verb_parsers(
    parser: argparse.ArgumentParser | None = None, words: str = ""
) -> dict[str, argparse.ArgumentParser]:
    """Return the parser of every verb by its words, those within a verb too."""
    parser = parser or parser_of(verbs())
    inner = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
    if not inner:
        return {words: parser}
    found: dict[str, argparse.ArgumentParser] = {}
    for name, one in inner[0].choices.items():
        found |= verb_parsers(one, f"{words} {name}".strip())
    return found

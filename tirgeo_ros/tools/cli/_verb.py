"""What a verb's module imports: the type of ``subparsers`` and the error for wrong use."""

from __future__ import annotations

import argparse
from types import ModuleType
from typing import TypeAlias

Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"  # noqa: SLF001  its only name


class UsageError(Exception):
    """Arguments that argparse alone cannot tell to be wrong: usage and exit code 2."""


def complete(parser: argparse.ArgumentParser, module: ModuleType) -> None:
    """Give a parser what all have that do work, and note the module that does it."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "--json", action="store_true", help="print the result as one JSON object on stdout"
    )
    parser.set_defaults(verb_module=module, verb_parser=parser)

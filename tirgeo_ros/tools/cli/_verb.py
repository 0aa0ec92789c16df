"""Define what a verb's module imports: the type of ``subparsers`` and the error for wrong use."""

from __future__ import annotations

import argparse
from types import ModuleType
from typing import TypeAlias

Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"  # noqa: SLF001  its only name


class UsageError(Exception):
    """Report arguments whose error argparse alone cannot see: usage and exit code 2."""


def complete(parser: argparse.ArgumentParser, module: ModuleType) -> None:
    """Give a verb's parser what all verbs share, and record the module that does the work."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument(
        "--json", action="store_true", help="print the result as one JSON object on stdout"
    )
    parser.set_defaults(verb_module=module, verb_parser=parser)

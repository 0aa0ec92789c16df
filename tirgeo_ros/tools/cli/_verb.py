"""What a verb's module imports: the type of ``subparsers`` and the error for wrong use."""

from __future__ import annotations

import argparse
from typing import TypeAlias

Subparsers: TypeAlias = "argparse._SubParsersAction[argparse.ArgumentParser]"  # noqa: SLF001  its only name


class UsageError(Exception):
    """Arguments that argparse alone cannot tell to be wrong: usage and exit code 2."""

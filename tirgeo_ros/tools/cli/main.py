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
"""Run ``tirgeo``: find the verbs, run one, print its result, return the exit code."""

from __future__ import annotations

import argparse
import io
import json
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import suppress
from types import FrameType, ModuleType
from typing import NoReturn

import tirgeo_ros
from tirgeo_ros.core.types.errors import TirgeoError, shown
from tirgeo_ros.core.types.missing_package import missing_line
from tirgeo_ros.io.files.stop_signals import stop_signals
from tirgeo_ros.tools import cli
from tirgeo_ros.tools.cli._verb import Parser, UsageError, add_verb, verbs_of
from tirgeo_ros.tools.presentation.results import error_line, finding_lines, lines, plain

DONE, FAILED, HUNG_UP, INTERRUPTED, BROKEN_PIPE, TERMINATED = 0, 1, 129, 130, 141, 143


def verbs() -> list[ModuleType]:
    """Return the modules of the verbs, sorted by name."""
    return verbs_of(cli)


def parser_of(modules: Sequence[ModuleType]) -> Parser:
    """Return the command's parser, with a subparser for each verb's module."""
    parser = Parser(
        prog="tirgeo",
        description="Draw a map on a drone's thermal video, from its sensors alone.",
        epilog="tirgeo VERB --help describes a verb, with an example.",
    )
    parser.add_argument("--version", action="version", version=tirgeo_ros.__version__)
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for module in modules:
        add_verb(subparsers, module)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``tirgeo argv`` and return its exit code; argparse raises SystemExit(2)."""
    args, unknown = parser_of(verbs()).parse_known_args(argv)
    if unknown:
        args.verb_parser.refuse(unknown)
    try:
        code = _run(args)
        sys.stdout.flush()
    except UsageError as error:
        args.verb_parser.error(str(error))
    except BrokenPipeError:
        # The reader (head, less) has ended: print no more, not even when Python flushes at exit.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    except (TirgeoError, OSError) as error:
        return _say(args, error_line(error), FAILED)
    except ModuleNotFoundError as error:
        if (error.name or "tirgeo_ros").startswith("tirgeo_ros"):
            raise
        return _say(args, missing_line(str(error.name)), FAILED)
    except KeyboardInterrupt:
        return _say(args, "interrupted", INTERRUPTED)
    return code


def _run(args: argparse.Namespace) -> int:
    result = args.verb_module.run(args)
    if isinstance(result, int):
        return result
    if getattr(args.verb_module, "SAYS_FINDINGS", True):
        for line in finding_lines(result.get("findings") or []):
            _say(args, line, DONE)
    if args.json:
        print(json.dumps(plain(result), allow_nan=False, ensure_ascii=False))
    else:
        print(getattr(args.verb_module, "describe", lines)(result))
    if result.get("warning") is not None:
        _say(args, f"warning: {result['warning']}", DONE)
    error = result.get("error")
    return DONE if error is None else _say(args, str(error), FAILED)


def _say(args: argparse.Namespace, message: str, code: int) -> int:
    with suppress(OSError):  # the terminal may be gone
        print(f"{args.verb_parser.prog}: {shown(message)}", file=sys.stderr)
    return code


def console() -> NoReturn:
    """Run the installed command: ``main``, with all stop signals unwinding the stack as Ctrl-C."""
    unwind_on_signals()
    if isinstance(sys.stdout, io.TextIOWrapper):  # file names need not be valid UTF-8
        sys.stdout.reconfigure(errors="backslashreplace")
    # As in the nodes: small matrices gain nothing from threads, and idle threads spin.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # Tirgeo reports in one line what OpenCV would log.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    sys.exit(main())


def unwind_on_signals() -> None:
    """Let all stop signals unwind the stack, so that unfinished work is cleaned up."""
    for number in stop_signals():
        signal.signal(number, _terminate)
    # A shell ignores SIGINT for background jobs.
    signal.signal(signal.SIGINT, signal.default_int_handler)


def _terminate(number: int, _frame: FrameType | None) -> NoReturn:
    # A lost terminal sends two signals: the second must not interrupt the clean-up.
    for again in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(again, signal.SIG_IGN)
    raise SystemExit(128 + number)


if __name__ == "__main__":
    console()

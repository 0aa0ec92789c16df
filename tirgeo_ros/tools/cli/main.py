"""Entry point of ``tirgeo``: finds the verbs, runs one, prints its result, owns the exit code."""

from __future__ import annotations

import argparse
import importlib
import io
import json
import math
import os
import pkgutil
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from types import FrameType, ModuleType
from typing import Any, NoReturn

import tirgeo_ros
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.quoted_text import shown
from tirgeo_ros.io.files.stop_signals import stop_signals
from tirgeo_ros.tools import cli
from tirgeo_ros.tools.cli._lines import lines
from tirgeo_ros.tools.cli._verb import UsageError, complete

DONE, FAILED, HUNG_UP, INTERRUPTED, BROKEN_PIPE, TERMINATED = 0, 1, 129, 130, 141, 143


def verbs() -> list[ModuleType]:
    """The modules of the verbs, by name."""
    names = (found.name for found in pkgutil.iter_modules(cli.__path__))
    return [
        importlib.import_module(f"{cli.__name__}.{name}")
        for name in sorted(names)
        if name != "main" and not name.startswith("_")
    ]


def parser_of(modules: Sequence[ModuleType]) -> argparse.ArgumentParser:
    """The command's parser with a subparser for each verb's module."""
    parser = argparse.ArgumentParser(
        prog="tirgeo",
        description="A map on a drone's thermal video, placed by sensors alone.",
        epilog="tirgeo VERB --help tells of a verb, with an example.",
    )
    parser.add_argument("--version", action="version", version=tirgeo_ros.__version__)
    subparsers = parser.add_subparsers(dest="verb", metavar="VERB", required=True)
    for module in modules:
        verb = module.add_parser(subparsers)
        if hasattr(module, "run"):  # else it has verbs of its own
            complete(verb, module)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run ``tirgeo argv`` and return its exit code; argparse leaves by SystemExit(2)."""
    args = parser_of(verbs()).parse_args(argv)
    try:
        code = _run(args)
        sys.stdout.flush()
    except UsageError as error:
        args.verb_parser.error(str(error))
    except BrokenPipeError:
        return _closed_pipe()
    except (TirgeoError, OSError) as error:
        return _say(args, _message(error), FAILED)
    except KeyboardInterrupt:
        return _say(args, "interrupted", INTERRUPTED)
    return code


def _run(args: argparse.Namespace) -> int:
    result = args.verb_module.run(args)
    if isinstance(result, int):
        return result
    for line in getattr(args.verb_module, "finding_lines", _finding_lines)(result):
        _say(args, line, DONE)
    if args.json:
        print(json.dumps(plain(result), allow_nan=False, ensure_ascii=False))
    else:
        print(_describe(args)(result))
    if result.get("warning") is not None:
        _say(args, f"warning: {result['warning']}", DONE)
    error = result.get("error")
    return DONE if error is None else _say(args, str(error), FAILED)


def _describe(args: argparse.Namespace) -> Callable[[Any], str]:
    """Return what makes the result text: by the command line, else by the verb, else by key."""
    by_verb: Callable[[Any], str] = getattr(args.verb_module, "describe", lines)
    asked: Callable[[Any], str] | None = getattr(args, "describe", None)
    return asked or by_verb


def _finding_lines(result: Mapping[str, Any]) -> list[str]:
    """What the checks found that is worse than a note."""
    if not result.get("findings"):
        return []
    from tirgeo_ros.tools.replay.finding_lines import finding_lines  # noqa: PLC0415 heavy

    return finding_lines(result["findings"])


def _say(args: argparse.Namespace, message: str, code: int) -> int:
    with suppress(OSError):  # a terminal that is gone
        print(f"{args.verb_parser.prog}: {shown(message)}", file=sys.stderr)
    return code


def _message(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{os.fsdecode(error.filename)}: {error.strerror}"
    return str(error)


def _closed_pipe() -> int:
    # The reader (head, less) has gone: nothing more to say, not even when Python flushes at exit.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return BROKEN_PIPE


def plain(value: object) -> object:
    """The value in JSON's own types: NaN and infinities None, arrays lists, the rest as text."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if hasattr(value, "tolist"):  # NumPy's arrays and scalars, without importing NumPy
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, bool | int | str) else str(value)


def console() -> NoReturn:
    """The installed command: ``main``, all stop signals unwinding the stack as Ctrl-C does."""
    unwind_on_signals()
    if isinstance(sys.stdout, io.TextIOWrapper):  # names of files need not be in UTF-8
        sys.stdout.reconfigure(errors="backslashreplace")
    # As in the nodes: small matrices gain nothing from threads, and idle ones spin.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")  # what it warns of, errors say in one line
    sys.exit(main())


def unwind_on_signals() -> None:
    """Let all stop signals unwind the stack, so that what is begun is tidied up."""
    for number in stop_signals():
        signal.signal(number, _terminate)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background


def _terminate(number: int, _frame: FrameType | None) -> NoReturn:
    for again in (signal.SIGTERM, signal.SIGHUP):  # a lost terminal gives two: tidying is not cut
        signal.signal(again, signal.SIG_IGN)
    raise SystemExit(128 + number)


if __name__ == "__main__":
    console()

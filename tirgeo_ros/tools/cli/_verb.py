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
"""Declare the options that verbs share, build a verb's parser, and call the tool of a verb."""

from __future__ import annotations

import argparse
import importlib
import math
import pkgutil
import re
from collections.abc import Callable
from dataclasses import fields
from datetime import datetime, timezone
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Any, TypeAlias, TypeVar

from tirgeo_ros.core.types.errors import nearest
from tirgeo_ros.tools.presentation.progress import Progress

Subparsers: TypeAlias = "argparse._SubParsersAction[Parser]"  # noqa: SLF001  its only name
#: Names separated by spaces, metavar (None: a flag), help, and more keywords of ``add_argument``.
#: The type of a value is Path unless ``type`` or ``choices`` says otherwise.
Option: TypeAlias = tuple[Any, ...]

T = TypeVar("T")

METHODS = ("raw", "rtk", "ekf", "ekf_heading")
WORD, NEEDED = {"type": str}, {"required": True}

#: Options that several verbs have, and their help.
ANY_BAG = "a file (.mcap, .db3), or a folder as ros2 bag record leaves it"
BAG: tuple[Option, ...] = (("bag", "BAG", f"the recorded flight: {ANY_BAG}"),)
_NAMESPACE = "namespace of the aircraft's topics in the bag, as uav1; default: none"
NAMESPACE: tuple[Option, ...] = (("--namespace", "NS", _NAMESPACE, WORD | {"default": ""}),)
_PARAMS = "ROS 2 parameter file; may be repeated: later files override earlier ones"
PARAMS: tuple[Option, ...] = (("--params", "YAML", _PARAMS, {"action": "append"}),)
_CAMERA = "calibration of the camera, used in place of the bag's thermal/camera_info"
PARAMETERS = (*PARAMS, ("--camera", "YAML", _CAMERA), *NAMESPACE)
_METHOD = "%(choices)s; default: as in --params, else ekf_heading, or ekf without rtk/heading"
_SMOOTH = "use later measurements too: slower, but better poses, above all without RTK"
SMOOTH: tuple[Option, ...] = (("--smooth", None, _SMOOTH),)
_ADJUST = "correct the camera's poses by what pictures show twice: slower; most with --smooth"
ADJUST: tuple[Option, ...] = (("--adjust", None, _ADJUST),)
_OBSERVED = (
    "id,stamp_ns,u,v: the picture's header stamp, column, row; or id,picture,u,v: a still's name"
)
SURVEY: tuple[Option, ...] = (
    ("--survey", "GCPS", "GeoJSON, or CSV id,lat,lon,h", NEEDED),
    ("--observations", "CSV", _OBSERVED, NEEDED),
)
_FROM = "begin, in seconds after the first message"
_TO = "end, in seconds after the first message; default: the end of the bag"
_BEGIN_S = {"dest": "from_s", "type": float, "default": 0.0}
_END_S = {"dest": "to_s", "type": float, "default": math.inf}
WINDOW: tuple[Option, ...] = (("--from", "S", _FROM, _BEGIN_S), ("--to", "S", _TO, _END_S))
_PICTURES = "pictures of 8 or 16 bits, folders of them, or one bag with thermal video"
_BOARD = "inner corners of the board, as 9x6: one fewer than squares in each direction"
_PAGE = "serve the operator's page, at HOST:PORT; default: as in --params, else 127.0.0.1:8080"
_COT = "with --page: address for Cursor-on-Target, as tcp://HOST:8087; switch it on at the page"


def number(text: str) -> float:
    """Return a finite number. Raise ValueError for nan and infinity; a type of option."""
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text)
    return value


def page_address(text: str) -> str:
    """Return HOST:PORT, or the empty text of an option without one; a type of option."""
    from tirgeo_ros.core.config.viewer_parameters import address_of  # noqa: PLC0415 --help stays quick
    from tirgeo_ros.core.types.errors import ConfigError  # noqa: PLC0415  heavy

    try:
        if text:
            address_of(text)
    except ConfigError as error:
        raise argparse.ArgumentTypeError(str(error)) from None
    return text


#: Options whose types are the two functions above.
NUMBER = {"type": number}
GROUND: tuple[Option, ...] = (
    ("--dem", "TIF", "elevation model of the ground; several tiles separated by commas", WORD),
    ("--ground-height", "M", "ellipsoidal height of the ground, m", NUMBER),
)
#: Options of the registration of a flight, for verbs that use its poses.
REGISTRATION: tuple[Option, ...] = (
    *PARAMETERS,
    ("--method", "M", _METHOD, {"choices": METHODS}),
    *SMOOTH,
    *ADJUST,
    *GROUND,
)
BOARD: tuple[Option, ...] = (
    ("pictures", "PICTURES", _PICTURES, {"nargs": "+"}),
    *NAMESPACE,
    ("--board", "COLUMNSxROWS", _BOARD, WORD | NEEDED),
    ("--square", "M", "side of a square, m", NUMBER | NEEDED),
)
PAGE: tuple[Option, ...] = (
    ("--page", "ADDRESS", _PAGE, {"nargs": "?", "const": "", "type": page_address}),
    ("--cot", "ADDRESS", _COT, WORD),
)


def utc_time(text: str) -> datetime:
    """Return a time from ISO 8601 text; without a zone it is UTC. Raise ValueError."""
    # Python 3.10 reads only fractions of three or six digits.
    whole = re.sub(r"[.,](\d{1,6})\d*", lambda match: f".{match[1]:0<6}", text.removesuffix("Z"))
    time = datetime.fromisoformat(whole)
    return time if time.tzinfo else time.replace(tzinfo=timezone.utc)


def offset_s(text: str) -> int:
    """Return seconds of an offset from UTC, as +02:00; a type of option."""
    from tirgeo_ros.io.logs.log_contents import zone_offset_s  # noqa: PLC0415 --help stays quick

    try:
        return zone_offset_s(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text}: not an offset as +02:00 or -03:30") from None


_UNDULATION = "height of sea level above the ellipsoid; default: geoid_undulation_m of --params"
_TAKEOFF = "ellipsoidal height of the take-off, for heights above it; not for bags"
_DATUM = "datum of heights if it is not recorded: %(choices)s; not for bags"
_DATUMS = {"choices": ("ellipsoid", "sea", "takeoff"), "default": ""}
_OFFSET = "offset from UTC of local times without a zone, east positive; not for bags"
_OFFSET_S = {"type": offset_s, "dest": "utc_offset_s"}
_EVERY = "take at most one picture of a video in S seconds; default: all; not for bags"
#: What a log, a still or a video may not say itself; named as the fields of LogOptions.
IMPORT: tuple[Option, ...] = (
    ("--geoid-undulation", "M", _UNDULATION, NUMBER | {"dest": "geoid_undulation_m"}),
    ("--takeoff-height", "M", _TAKEOFF, NUMBER | {"dest": "takeoff_height_m"}),
    ("--height", "DATUM", _DATUM, _DATUMS),
    ("--utc-offset", "+HH:MM", _OFFSET, _OFFSET_S),
    ("--every", "S", _EVERY, NUMBER | {"dest": "every_s"}),
)
ANY_FLIGHT = f"{ANY_BAG}; or a folder of stills, an MP4 with its SRT, a MISB stream"
#: A flight that may be no bag: it is imported first.
FLIGHT: tuple[Option, ...] = (
    ("bag", "FLIGHT", f"the recorded flight: {ANY_FLIGHT}"),
    *IMPORT,
)


class Parser(argparse.ArgumentParser):
    """Parse as argparse does, and suggest the nearest name for an unknown one."""

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        if action.choices is not None and value not in action.choices:
            hint = nearest(str(value), action.choices)
            raise argparse.ArgumentError(action, f"invalid choice: {value!r}{hint}")

    def refuse(self, words: list[str]) -> None:
        """Exit with usage and exit code 2 because of unknown words."""
        options = [word.partition("=")[0] for word in words if word.startswith("-")]
        hint = nearest(options[0], self._option_string_actions) if options else ""
        self.error(f"unrecognized arguments: {' '.join(words)}{hint}")


class UsageError(Exception):
    """Report wrong arguments that argparse accepts: ends with usage and exit code 2."""


def check_page(args: argparse.Namespace) -> None:
    """Raise UsageError if ``--cot`` is given without ``--page``."""
    if args.cot and args.page is None:
        raise UsageError("--cot is for the operator's page: give --page too")


def verbs_of(package: ModuleType) -> list[ModuleType]:
    """Return the modules of a package's verbs, sorted by name."""
    names = sorted(module.name for module in pkgutil.iter_modules(package.__path__))
    return [
        importlib.import_module(f"{package.__name__}.{name}")
        for name in names
        if name != "main" and not name.startswith("_")
    ]


def add_verb(subparsers: Subparsers, module: ModuleType) -> Parser:
    """Add the parser of a verb's module, with the option ``--json``, and return it."""
    help_line, _, rest = (module.__doc__ or "").partition("\n\n")
    description, example, examples = rest.partition("example:\n")
    parser = subparsers.add_parser(
        module.__name__.rpartition(".")[2].strip("_"),
        help=help_line.rstrip("."),
        description=description.strip() or help_line,
        epilog=example + examples,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    if not hasattr(module, "run"):
        inner = parser.add_subparsers(dest="what", metavar="WHAT", required=True)
        for inner_module in verbs_of(module):
            add_verb(inner, inner_module)
        return parser
    own = {option[0]: option for option in module.OPTIONS}  # a later one replaces a shared one
    for option in own.values():
        add_option(parser, *option)
    add_option(parser, "--json", None, "print the result as one JSON object on stdout")
    parser.set_defaults(verb_module=module, verb_parser=parser)
    return parser


def add_option(
    parser: argparse._ActionsContainer,
    names: str,
    metavar: str | None,
    text: str,
    more: dict[str, Any] | None = None,
) -> None:
    """Add one Option to a parser."""
    own: dict[str, Any] = {"action": "store_true"} if metavar is None else {"metavar": metavar}
    if metavar is not None and "choices" not in (more or {}):
        own["type"] = Path
    parser.add_argument(*names.split(), help=text, **own | (more or {}))


def call(tool: Callable[..., T], args: argparse.Namespace, doing: str, **more: object) -> T:
    """Call a tool with a progress bar, the options that are its parameters, and ``more``.

    ``doing`` is the bar's text, then a comma and the unit if there is one. Raise UsageError if
    both a DEM and a ground height are given, or the window of time is empty.
    """
    values = vars(args)
    if values.get("dem") is not None and values.get("ground_height") is not None:
        raise UsageError("give either --dem or --ground-height, not both")
    if "from_s" in values and not 0 <= args.from_s < args.to_s:
        raise UsageError("--from must be 0 or more, and less than --to")
    named = {name: values[name] for name in signature(tool).parameters if name in values}
    if "logs" in signature(tool).parameters:
        named["logs"] = log_options(args)
    what, _, unit = doing.partition(", ")
    with Progress(what, unit=unit) as bar:
        return tool(**(named | more), progress=bar)


def log_options(args: argparse.Namespace) -> Any:
    """Return the LogOptions of a verb that imports."""
    from tirgeo_ros.io.logs.log_contents import LogOptions  # noqa: PLC0415 --help stays quick

    values = vars(args)
    names = [each.name for each in fields(LogOptions) if values.get(each.name) is not None]
    return LogOptions(**{name: values[name] for name in names})


def names_of(permitted: tuple[str, ...]) -> Callable[[str], list[str]]:
    """Return a type of option: a list of ``permitted`` names, separated by commas."""

    def names(text: str) -> list[str]:
        chosen = [name.strip() for name in text.split(",") if name.strip()]
        for name in chosen:
            if name not in permitted:
                raise argparse.ArgumentTypeError(f"unknown {name}: use {', '.join(permitted)}")
        return chosen

    return names

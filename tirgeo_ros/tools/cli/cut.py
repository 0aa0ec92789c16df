"""Cut a part out of a recorded flight, or the parts in which targets were clicked.

Copies the messages of all topics, as they are, into a new bag (MCAP). Latched topics (origin,
static transforms, robot description) and a calibration that was sent once are carried: their last
message before the part is written at its beginning. The filter aligns anew in a part: give it
--before 20 where the poses of the first seconds count.

With --targets, -o is a folder. Each pass over a target becomes a bag of its own, target_N.mcap,
with N its number, then target_N_2.mcap; clicks of a target within twice --around are one pass.

example:
  tirgeo cut bags/sample/flight.mcap -o part.mcap --from 10 --to 20
"""

from __future__ import annotations

import argparse
import math
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from tirgeo_ros.tools.cli._verb import FLIGHT, NEEDED, NUMBER, UsageError, call, utc_time
from tirgeo_ros.tools.presentation.results import table

if TYPE_CHECKING:
    from tirgeo_ros.tools.replay.cut import Instant


_MOST_S = 1e9  # 30 years: no flight is longer, and its nanoseconds are whole


def instant(text: str) -> Instant:
    """Return seconds, or a time; one without a zone is UTC. A type of option."""
    with suppress(ValueError):
        if 0 <= float(text) < _MOST_S:
            return float(text)
    with suppress(ValueError):
        return utc_time(text)
    raise argparse.ArgumentTypeError(f"{text}: neither seconds nor a time as 2024-06-11T07:44:39")


_FROM = "begin, in seconds after the first message, or UTC as 2024-06-11T07:44:39"
_TO = "end, likewise; default: that of the bag"
_TARGETS = "targets, as the operator's page keeps or exports them (.gpkg, .geojson)"
OPTIONS = (
    *FLIGHT,
    ("-o --output", "OUT", "the new bag (.mcap); with --targets a folder", NEEDED),
    ("--from", "T", _FROM, {"dest": "begin", "type": instant}),
    ("--to", "T", _TO, {"dest": "end", "type": instant}),
    ("--targets", "FILE", _TARGETS),
    ("--around", "S", "seconds before and after a click; default: 15", NUMBER),
    ("--before", "S", "seconds by which each part begins earlier", NUMBER | {"default": 0.0}),
)


def run(args: argparse.Namespace) -> dict[str, object]:
    """Cut the flight; return what was written."""
    from tirgeo_ros.tools.replay.cut import cut  # noqa: PLC0415 heavy

    _check(args)
    window = {"begin": args.begin or 0.0, "end": math.inf if args.end is None else args.end}
    around = {} if args.around is None else {"around": args.around}
    return call(cut, args, "cutting, s", "bag output", "targets before", **window, **around)


def _check(args: argparse.Namespace) -> None:
    windowed = args.begin is not None or args.end is not None
    if windowed and args.targets is not None:
        raise UsageError("give either --from and --to, or --targets")
    if not windowed and args.targets is None:
        raise UsageError("give --from, --to or --targets")
    if args.around is not None and args.targets is None:
        raise UsageError("--around needs --targets")
    for name in ("around", "before"):
        given = getattr(args, name)
        if given is not None and not 0 <= given < _MOST_S:
            raise UsageError(f"--{name} must be 0 or more, and less than {_MOST_S:.0e} s")


def describe(result: dict[str, Any]) -> str:
    """Return a table of the parts."""
    rows = [("part", "from, s", "to, s", "from (UTC)", "messages", "carried")]
    for part in result["parts"]:
        times = f"{part['from_s']:.2f}", f"{part['to_s']:.2f}", part["from_utc"]
        numbers = (str(sum(part[name].values())) for name in ("messages", "carried"))
        rows.append((part["output"], *times, *numbers))
    return table(rows)

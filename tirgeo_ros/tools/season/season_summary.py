"""Sum up a run over many flights, for programs and in lines for a person."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from tirgeo_ros.core.types.finding import NO_GO
from tirgeo_ros.tools.presentation.progress import three
from tirgeo_ros.tools.season.flight_record import Record
from tirgeo_ros.tools.season.flight_task import FlightTask

_NAMED = 3  # errors in the line of the whole; all are in the result and on the page
#: What becomes of a flight, and in words for a person.
_WORDS = {
    "processed": "processed",
    "kept": "already done",
    "in_part": "in part",
    "failed": "failed",
}
_OF_RECORD = ("output", "duration_s", "elapsed_s", "error")


def season_summary(
    tasks: Sequence[FlightTask], kept: Sequence[str], records: Mapping[str, Record]
) -> dict[str, object]:
    """Return what became of each flight; ``kept`` are the names of those done by earlier runs.

    ``error`` is None, or how many flights have an error, and the names of the first ones.
    """
    flights = [_flight(task, records[task.name], task.name in kept) for task in tasks]
    errors = [str(one["name"]) for one in flights if one["error"]]
    more = f" and {len(errors) - _NAMED} more" if len(errors) > _NAMED else ""
    told = f"{len(errors)} of {len(flights)} flights have an error: {', '.join(errors[:_NAMED])}"
    fates = Counter(map(_fate, flights))
    return {
        "flights": flights,
        **{fate: fates[fate] for fate in _WORDS},
        "error": told + more if errors else None,
    }


def season_lines(result: Mapping[str, Any]) -> str:
    """Return what was done, then a line for each flight with an error, then the page."""
    told = ", ".join(f"{result[fate]} {word}" for fate, word in _WORDS.items() if result[fate])
    times = f"{three(_flown_s(result))} s of flight in {three(result['elapsed_s'])} s"
    lines = [f"  flights  {len(result['flights'])}: {told}; {times}"]
    lines += [f"! {one['name']:<8} {one['error']}" for one in result["flights"] if one["error"]]
    return "\n".join([*lines, f"  page     {result['page']}"])


def _fate(flight: Mapping[str, object]) -> str:
    if flight["error"] and not str(flight["error"]).startswith(NO_GO):
        return "in_part" if flight["output"] else "failed"
    return "kept" if flight["kept"] else "processed"


def _flown_s(result: Mapping[str, Any]) -> float:
    """Return the length of the flights that were processed now."""
    return float(sum(one["duration_s"] or 0 for one in result["flights"] if not one["kept"]))


def _flight(task: FlightTask, record: Record, kept: bool) -> dict[str, object]:
    found = {name: record.get(name) for name in _OF_RECORD}
    attempts = record["season"].get("attempts", 1)
    return {"name": task.name, "input": task.bag, "kept": kept, "attempts": attempts, **found}

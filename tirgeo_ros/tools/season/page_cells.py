"""Make the cells of the season's table: of each flight, what a column shows and is sorted by."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import Any, NamedTuple
from urllib.parse import quote

from tirgeo_ros import __version__
from tirgeo_ros.core.types.finding import NO_GO, Severity
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.tools.presentation.plots import embedded
from tirgeo_ros.tools.presentation.progress import three
from tirgeo_ros.tools.replay.process import refused_line
from tirgeo_ros.tools.season.flight_record import Record

#: Worst first, as the page lists them; with what a class name or a person calls them.
SEVERITIES = {
    one.name.lower(): word
    for one, word in (
        (Severity.STOP, "fault"),
        (Severity.CAUTION, "caution"),
        (Severity.NOTE, "note"),
    )
}
_LINKS = {".mcap": "bag", ".json": "summary"}  # by the file's ending; all others: video


class Cell(NamedTuple):
    """Hold a cell: its contents as HTML, and the value by which the table is sorted."""

    html: str
    key: float | str


def row_cells(record: Record, picture: bytes) -> dict[str, Cell]:
    """Return a flight's cells by the titles of their columns; ``picture`` is its small JPEG."""
    made = {title: _cell(make, record) for title, make in _MAKERS.items()}
    return {"flight": _flight(record, picture), **made}


def _cell(make: Callable[[Record], Cell], record: Record) -> Cell:
    """Return a cell; a dash for what a record of another version of tirgeo tells differently."""
    try:
        return make(record)
    except (LookupError, TypeError, ValueError):
        if record["season"]["made_from"].get("version") == __version__:
            raise
        return Cell("-", -1.0)


def anchor(name: str) -> str:
    """Return the identifier of a flight's row."""
    return "flight-" + _in_url(name, safe="")


def _in_url(name: str, safe: str = "/") -> str:
    """Return a file's name for a URL; a byte that is no UTF-8 stays the one that it is."""
    return quote(name, safe, errors="surrogateescape")


def clock(seconds: float) -> str:
    """Return a time as minutes and seconds, from an hour on with hours in front: 1:04:09."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


def state_bar(times: Mapping[str, float]) -> str:
    """Return the seconds in each state as a bar and as words, in the order of the states."""
    known = [state.value for state in FilterState]
    parts = sorted(times.items(), key=lambda one: (*known, one[0]).index(one[0]))
    bar = "".join(f'<i class="{escape(s)}" style="flex:{t:g}"></i>' for s, t in parts)
    words = ", ".join(f"{escape(s.replace('_', ' '))} {clock(t)}" for s, t in parts)
    return f'<span class="bar">{bar}</span>{words}' if parts else "-"


def counted(findings: Counter[str]) -> str:
    """Return the numbers of findings by severity as badges."""
    return " ".join(
        f'<b class="{severity}">{findings[severity]} {word}{"s" * (findings[severity] > 1)}</b>'
        for severity, word in SEVERITIES.items()
        if findings[severity]
    )


def _lines(words: Sequence[str]) -> str:
    """Return plain words in lines that do not break; a dash for none."""
    return "<br>".join(f'<span class="line">{one}</span>' for one in words) or "-"


def severities(record: Record) -> Counter[str]:
    """Return a flight's number of findings by severity."""
    return Counter(one["severity"] for one in record.get("findings", []))


def _flight(record: Record, picture: bytes) -> Cell:
    name, outputs = record["season"]["name"], record["season"]["outputs"]
    files = [*outputs, f"{name}.json"]
    links = " ".join(_link(file, file[len(name) :]) for file in files)
    shown = embedded(picture, "image/jpeg", f"a picture of {name}") if picture else ""
    return Cell(f"{shown}<strong>{escape(name)}</strong><span>{links}</span>", name)


def _link(file: str, ending: str) -> str:
    return f'<a href="{escape(_in_url(file))}">{_LINKS.get(ending, "video")}</a>'


def _begin(record: Record) -> Cell:
    begin = str(record["season"]["facts"].get("begin_utc", ""))
    return Cell(escape(begin[:16].replace("T", " ")) or "-", begin)


def _place(record: Record) -> Cell:
    track = record["season"]["facts"].get("track_deg")
    if not track:
        return Cell("-", math.inf)
    latitude, longitude = track[0]
    north, east = degrees(latitude, longitude)
    return Cell(_lines([north, east]), latitude)


def degrees(latitude: float, longitude: float) -> tuple[str, str]:
    """Return latitude and longitude in words: four digits are some ten metres."""
    north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    return f"{abs(latitude):.4f}° {north}", f"{abs(longitude):.4f}° {east}"


def _flown(record: Record) -> Cell:
    if "duration_s" not in record:
        return Cell("-", -1.0)
    distance_m = record["season"]["facts"].get("distance_m")
    way = [] if distance_m is None else [f"{three(distance_m)} m"]
    return Cell(_lines([clock(record["duration_s"]), *way]), record["duration_s"])


def _states(record: Record) -> Cell:
    times = record.get("states_s", {})
    whole = sum(times.values())
    return Cell(state_bar(times), times.get("running", 0) / whole if whole else -1.0)


def _sigma(record: Record) -> Cell:
    facts = record["season"]["facts"]
    heading_deg, across_m, down_m = (
        facts.get(key) for key in ("heading_sigma_deg", "horizontal_sigma_m", "vertical_sigma_m")
    )
    words = [] if heading_deg is None else [f"heading {three(heading_deg)}°"]
    if across_m is not None and down_m is not None:
        words += [f"level {three(100 * across_m)} cm", f"height {three(100 * down_m)} cm"]
    return Cell(_lines(words), math.inf if heading_deg is None else heading_deg)


def _nis(record: Record) -> Cell:
    facts = record["season"]["facts"]
    means, ratios = facts.get("nis", {}), facts.get("test_ratios", {})
    lines = [
        f'<span class="line" title="largest test ratio {ratios.get(source, math.nan):.2g}">'
        f"{escape(source.replace('_', ' '))} {three(mean)}</span>"
        for source, mean in means.items()
    ]
    return Cell("<br>".join(lines) or "-", max(means.values(), default=-1.0))


def _checks(record: Record) -> Cell:
    found = severities(record)
    if not found:
        return Cell("none" if "findings" in record else "-", 0.0)
    lines = "".join(
        f'<li class="{escape(one["severity"])}">{escape(one["evidence"])}: '
        f"{escape(one['parameter'])}: {escape(one['mend'])}</li>"
        for one in record["findings"]
    )
    key = sum(found[name] * 1000.0**rank for rank, name in enumerate(reversed(SEVERITIES)))
    return Cell(f"<details><summary>{counted(found)}</summary><ul>{lines}</ul></details>", key)


def _refused(record: Record) -> Cell:
    if "verdicts" not in record:
        return Cell("-", -1.0)
    _, text, is_wrong = refused_line(record)
    html = f'<b class="caution">{escape(text)}</b>' if is_wrong else escape(text)
    return Cell(html, 0.0 if text == "nothing" else 1.0 + is_wrong)


def _result(record: Record) -> Cell:
    error: Any = record["error"]
    if not error:
        return Cell("done, smoothed" if record.get("smoothed") else "done", 0.0)
    word = "in part" if record["output"] else "failed"
    word = "done" if error.startswith(NO_GO) else word  # but wrong, by the checks
    return Cell(f'<b class="stop">{word}</b> {escape(error)}', 1.0 if record["output"] else 2.0)


_MAKERS: Mapping[str, Callable[[Record], Cell]] = {
    "begin, UTC": _begin,
    "place": _place,
    "flown": _flown,
    "states": _states,
    "sigma": _sigma,
    "NIS": _nis,
    "checks": _checks,
    "refused": _refused,
    "result": _result,
}
#: The columns' titles in their order.
COLUMNS = ("flight", *_MAKERS)

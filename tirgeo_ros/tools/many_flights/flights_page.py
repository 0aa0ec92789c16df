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
"""Write the page of all flights that have a record in a folder, as one file.

``flights_page.html`` has its frame, style and script; this module fills in the contents.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from html import escape
from pathlib import Path
from string import Template
from typing import Any
from urllib.parse import quote

from tirgeo_ros import __version__
from tirgeo_ros.core.types.errors import ManyFlightsError
from tirgeo_ros.core.types.finding import NO_GO
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.tools.many_flights.flight_record import Record, read_records
from tirgeo_ros.tools.presentation.plots import PAGE_STYLE, embedded
from tirgeo_ros.tools.presentation.progress import three
from tirgeo_ros.tools.replay.process import refused_line

PAGE = "index.html"
#: Severity -> its name for a person, in the order of the page: the worst first.
_SEVERITIES = {"stop": "fault", "caution": "caution", "note": "note"}
_LINKS = {".mcap": "bag", ".json": "summary"}  # ending of a file -> its link; all others: video

#: Contents of a cell as HTML, and the value by which the table is sorted.
Cell = tuple[str, float | str]


def write_page(folder: Path) -> None:
    """Write ``index.html`` from the records in a folder. Raise ManyFlightsError."""
    records = read_records(folder)
    pictures = {}
    for name in records:
        path = folder / f"{name}.jpg"
        with suppress(OSError):
            pictures[name] = path.read_bytes() if path.is_file() else b""
    text = flights_html(folder.resolve().name, records, pictures)
    write_files({folder / PAGE: text}, ManyFlightsError)


def flights_html(title: str, records: Mapping[str, Record], pictures: Mapping[str, bytes]) -> str:
    """Return the page; ``records`` and ``pictures`` (JPEG, or b"") are by name of the flight."""
    flights = sorted(
        records.values(), key=lambda record: (_begin(record)[1] or "9", _name(record))
    )
    columns = ["flight", *_COLUMNS]
    return Template(Path(__file__).with_suffix(".html").read_text(encoding="utf-8")).substitute(
        title=escape(title),
        style=PAGE_STYLE,
        totals="".join(_totals(flights)),
        heads="".join(f"<th><button>{escape(column)}</button></th>" for column in columns),
        rows="".join(_row(record, pictures.get(_name(record), b"")) for record in flights),
        version=__version__,
    )


def _name(record: Record) -> str:
    return str(record["season"]["name"])


def _totals(flights: Sequence[Record]) -> Iterator[str]:
    """Yield the totals over all flights."""
    times: Counter[str] = Counter()
    findings: Counter[str] = Counter()
    for record in flights:
        times.update(record.get("states_s", {}))
        findings.update(finding["severity"] for finding in record.get("findings", []))
    errors = sum(bool(record["error"]) for record in flights)
    way_m = sum(record["season"]["facts"].get("distance_m", 0.0) for record in flights)
    frames = sum(record.get("overlay", {}).get("drawn", 0) for record in flights)
    for title, html in (
        ("flights", f"{len(flights)}"),
        ("with an error", f'<b class="stop">{errors}</b>' if errors else ""),
        ("flown", _clock(sum(record.get("duration_s", 0.0) for record in flights))),
        ("distance", f"{three(way_m / 1000)} km"),
        ("pictures with the map", f"{frames}" if frames else ""),
        ("findings", _counted(findings) or "none"),
        ("states", _state_bar(times)),
    ):
        if html:
            yield f'<div class="{title}"><dt>{title}</dt><dd>{html}</dd></div>'


def _row(record: Record, picture: bytes) -> str:
    """Return a flight's row; ``picture`` is its small JPEG."""
    name = _name(record)
    links = " ".join(
        f'<a href="{escape(_in_url(file))}">{_LINKS.get(file[len(name) :], "video")}</a>'
        for file in [*record["season"]["outputs"], f"{name}.json"]
    )
    small = embedded(picture, "image/jpeg", f"a picture of {name}") if picture else ""
    own: Cell = f"{small}<strong>{escape(name)}</strong><span>{links}</span>", name
    cells = {"flight": own} | {title: _cell(make, record) for title, make in _COLUMNS.items()}
    columns = "".join(
        f'<td data-title="{escape(title)}" data-key="{escape(_key(key), quote=True)}">'
        f"<div>{html}</div></td>"
        for title, (html, key) in cells.items()
    )
    return f'<tr id="flight-{_in_url(name, safe="")}">{columns}</tr>\n'


def _cell(make: Callable[[Record], Cell], record: Record) -> Cell:
    """Return a cell, or a dash if a record of another version of tirgeo lacks its values."""
    try:
        return make(record)
    except (LookupError, TypeError, ValueError):
        if record["season"]["made_from"].get("version") == __version__:
            raise
        return "-", -1.0


def _key(value: float | str) -> str:
    """Return the value by which the page's script sorts; JavaScript must read numbers."""
    return value if isinstance(value, str) else f"{value:.9g}".replace("inf", "Infinity")


def _in_url(name: str, safe: str = "/") -> str:
    """Return a file's name for a URL; bytes that are not UTF-8 are preserved."""
    return quote(name, safe, errors="surrogateescape")


def _clock(seconds: float) -> str:
    """Return a time as minutes and seconds; from one hour on, as 1:04:09."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


def _state_bar(times: Mapping[str, float]) -> str:
    """Return the seconds in each state as a bar and as words, in the order of the states."""
    order = [state.value for state in FilterState]
    parts = sorted(times.items(), key=lambda part: (*order, part[0]).index(part[0]))
    bar = "".join(f'<i class="{escape(s)}" style="flex:{t:g}"></i>' for s, t in parts)
    words = ", ".join(f"{escape(s.replace('_', ' '))} {_clock(t)}" for s, t in parts)
    return f'<span class="bar">{bar}</span>{words}' if parts else "-"


def _counted(findings: Counter[str]) -> str:
    """Return the numbers of findings by severity as badges."""
    return " ".join(
        f'<b class="{severity}">{findings[severity]} {word}{"s" * (findings[severity] > 1)}</b>'
        for severity, word in _SEVERITIES.items()
        if findings[severity]
    )


def _begin(record: Record) -> Cell:
    begin = str(record["season"]["facts"].get("begin_utc", ""))
    return escape(begin[:16].replace("T", " ")) or "-", begin


def _place(record: Record) -> Cell:
    place = record["season"]["facts"].get("place_deg")
    if not place:
        return "-", math.inf
    latitude, longitude = place  # four digits are some ten metres
    north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    return f"{abs(latitude):.4f}° {north}<br>{abs(longitude):.4f}° {east}", latitude


def _flown(record: Record) -> Cell:
    if "duration_s" not in record:
        return "-", -1.0
    distance_m = record["season"]["facts"].get("distance_m")
    way = "" if distance_m is None else f"<br>{three(distance_m)} m"
    return _clock(record["duration_s"]) + way, record["duration_s"]


def _states(record: Record) -> Cell:
    times = record.get("states_s", {})
    whole = sum(times.values())
    return _state_bar(times), times.get("running", 0) / whole if whole else -1.0


def _checks(record: Record) -> Cell:
    counts = Counter(finding["severity"] for finding in record.get("findings", []))
    if not counts:
        return "none" if "findings" in record else "-", 0.0
    lines = "".join(
        f'<li class="{escape(finding["severity"])}">{escape(finding["evidence"])}: '
        f"{escape(finding['parameter'])}: {escape(finding['mend'])}</li>"
        for finding in record["findings"]
    )
    key = sum(counts[name] * 1000.0**rank for rank, name in enumerate(reversed(_SEVERITIES)))
    return f"<details><summary>{_counted(counts)}</summary><ul>{lines}</ul></details>", key


def _refused(record: Record) -> Cell:
    if "verdicts" not in record:
        return "-", -1.0
    _, text, is_wrong = refused_line(record)
    html = f'<b class="caution">{escape(text)}</b>' if is_wrong else escape(text)
    return html, 0.0 if text == "nothing" else 1.0 + is_wrong


def _result(record: Record) -> Cell:
    error: Any = record["error"]
    if not error:
        return "done, smoothed" if record.get("smoothed") else "done", 0.0
    word = "in part" if record["output"] else "failed"
    word = "done" if error.startswith(NO_GO) else word  # but wrong, by the checks
    return f'<b class="stop">{word}</b> {escape(error)}', 1.0 if record["output"] else 2.0


#: Columns after that of the flight's name: title -> function that makes a cell.
_COLUMNS: Mapping[str, Callable[[Record], Cell]] = {
    "begin, UTC": _begin,
    "place": _place,
    "flown": _flown,
    "states": _states,
    "checks": _checks,
    "refused": _refused,
    "result": _result,
}

"""Write the page of many flights: all that have a record in a folder, in one file.

``flights_page.html`` is its frame, style and script; this module makes what it holds.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any, NamedTuple
from urllib.parse import quote

import numpy as np

from tirgeo_ros import __version__
from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import ManyFlightsError
from tirgeo_ros.core.types.finding import NO_GO, Severity
from tirgeo_ros.core.types.verdicts import FilterState
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.tools.many_flights.flight_facts import positions_ned
from tirgeo_ros.tools.many_flights.flight_record import Record, read_records
from tirgeo_ros.tools.presentation.plots import PAGE_STYLE, embedded
from tirgeo_ros.tools.presentation.progress import three
from tirgeo_ros.tools.replay.process import refused_line

PAGE = "index.html"
_FRAME = Path(__file__).with_suffix(".html")
#: Worst first, as the page lists them: severity -> what a person calls it.
_SEVERITIES = {
    severity.name.lower(): word
    for severity, word in (
        (Severity.STOP, "fault"),
        (Severity.CAUTION, "caution"),
        (Severity.NOTE, "note"),
    )
}
_LINKS = {".mcap": "bag", ".json": "summary"}  # by the file's ending; all others: video
#: Flights that begin this near to one of a site belong to it.
_SITE_M = 500.0
_MOST_SITES = 24
_WIDTH, _HEIGHT, _EDGE = 320.0, 220.0, 16.0  # of a map, in its own units
_FOOT = 14.0  # height of the scale bar, below the tracks
_LEAST_M = 20.0  # across: a flight that hovers is a point, not a scribble

Track = list[list[float]]  # (n, 2): latitude, longitude, degrees


class Cell(NamedTuple):
    """Hold a cell: its contents as HTML, and the value by which the table is sorted."""

    html: str
    key: float | str


def write_page(folder: Path) -> None:
    """Write ``index.html`` from the records in a folder. Raises ManyFlightsError."""
    records = read_records(folder)
    pictures = {name: _picture(folder / f"{name}.jpg") for name in records}
    text = flights_html(folder.resolve().name, records, pictures)
    write_files({folder / PAGE: text}, ManyFlightsError)


def _picture(path: Path) -> bytes:
    try:
        return path.read_bytes() if path.is_file() else b""
    except OSError:
        return b""


def flights_html(title: str, records: Mapping[str, Record], pictures: Mapping[str, bytes]) -> str:
    """Return the page of flights by name, each with its small JPEG or b""."""
    flights = sorted(
        records.values(), key=lambda record: (_begin(record).key or "9", _name(record))
    )
    tracks = {_name(record): _facts(record).get("track_deg") for record in flights}
    rows = (_row(record, pictures.get(_name(record), b"")) for record in flights)
    return Template(_FRAME.read_text(encoding="utf-8")).substitute(
        title=escape(title),
        style=PAGE_STYLE,
        totals="".join(_totals(flights)),
        maps=track_maps({name: track for name, track in tracks.items() if track}),
        rows="".join(rows),
        version=__version__,
    )


def _name(record: Record) -> str:
    return str(record["season"]["name"])


def _facts(record: Record) -> dict[str, Any]:
    facts: dict[str, Any] = record["season"]["facts"]
    return facts


def _totals(flights: Sequence[Record]) -> Iterator[str]:
    """Yield the totals over all flights."""
    times: Counter[str] = Counter()
    findings: Counter[str] = Counter()
    for record in flights:
        times.update(record.get("states_s", {}))
        findings.update(_severities(record))
    errors = sum(bool(record["error"]) for record in flights)
    way_m = sum(_facts(record).get("distance_m", 0.0) for record in flights)
    frames = sum(record.get("overlay", {}).get("drawn", 0) for record in flights)
    flown = _clock(sum(record.get("duration_s", 0.0) for record in flights))
    for title, html, kind in (
        ("flights", f"{len(flights)}", ""),
        ("with an error", f'<b class="stop">{errors}</b>' if errors else "", ""),
        ("flown", flown, ""),
        ("distance", f"{three(way_m / 1000)} km", ""),
        ("pictures with the map", f"{frames}" if frames else "", ""),
        ("findings", _counted(findings) or "none", ""),
        ("states", _state_bar(times), "wide"),
    ):
        if html:
            yield f'<div class="{kind}"><dt>{title}</dt><dd>{html}</dd></div>'


def _row(record: Record, picture: bytes) -> str:
    """Return a flight's row; ``picture`` is its small JPEG."""
    cells = {"flight": _flight(record, picture)}
    cells |= {title: _cell(make, record) for title, make in _COLUMNS.items()}
    columns = "".join(
        f'<td data-title="{escape(title)}" data-key="{escape(_key(cell.key), quote=True)}">'
        f"<div>{cell.html}</div></td>"
        for title, cell in cells.items()
    )
    return f'<tr id="{_anchor(_name(record))}">{columns}</tr>\n'


def _cell(make: Callable[[Record], Cell], record: Record) -> Cell:
    """Return a cell; a dash where a record of another version of tirgeo has another form."""
    try:
        return make(record)
    except (LookupError, TypeError, ValueError):
        if record["season"]["made_from"].get("version") == __version__:
            raise
        return Cell("-", -1.0)


def _key(value: float | str) -> str:
    """Return what the page's script compares: numbers as JavaScript reads them."""
    return value if isinstance(value, str) else f"{value:.9g}".replace("inf", "Infinity")


def _anchor(name: str) -> str:
    """Return the identifier of a flight's row."""
    return "flight-" + _in_url(name, safe="")


def _in_url(name: str, safe: str = "/") -> str:
    """Return a file's name for a URL; bytes that are not UTF-8 are kept."""
    return quote(name, safe, errors="surrogateescape")


def _clock(seconds: float) -> str:
    """Return a time as minutes and seconds, from an hour on with hours in front: 1:04:09."""
    minutes, second = divmod(round(seconds), 60)
    hours, minute = divmod(minutes, 60)
    return f"{hours}:{minute:02d}:{second:02d}" if hours else f"{minute}:{second:02d}"


def _lines(words: Sequence[str]) -> str:
    """Return plain words in lines that do not break; a dash for none."""
    return "<br>".join(f'<span class="line">{line}</span>' for line in words) or "-"


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


def _severities(record: Record) -> Counter[str]:
    """Return a flight's number of findings by severity."""
    return Counter(finding["severity"] for finding in record.get("findings", []))


def _degrees(latitude: float, longitude: float) -> tuple[str, str]:
    """Return latitude and longitude in words: four digits are some ten metres."""
    north, east = "N" if latitude >= 0 else "S", "E" if longitude >= 0 else "W"
    return f"{abs(latitude):.4f}° {north}", f"{abs(longitude):.4f}° {east}"


def _flight(record: Record, picture: bytes) -> Cell:
    name = _name(record)
    links = " ".join(
        f'<a href="{escape(_in_url(file))}">{_LINKS.get(file[len(name) :], "video")}</a>'
        for file in [*record["season"]["outputs"], f"{name}.json"]
    )
    shown = embedded(picture, "image/jpeg", f"a picture of {name}") if picture else ""
    return Cell(f"{shown}<strong>{escape(name)}</strong><span>{links}</span>", name)


def _begin(record: Record) -> Cell:
    begin = str(_facts(record).get("begin_utc", ""))
    return Cell(escape(begin[:16].replace("T", " ")) or "-", begin)


def _place(record: Record) -> Cell:
    track = _facts(record).get("track_deg")
    return Cell(_lines(_degrees(*track[0])), track[0][0]) if track else Cell("-", math.inf)


def _flown(record: Record) -> Cell:
    if "duration_s" not in record:
        return Cell("-", -1.0)
    distance_m = _facts(record).get("distance_m")
    way = [] if distance_m is None else [f"{three(distance_m)} m"]
    return Cell(_lines([_clock(record["duration_s"]), *way]), record["duration_s"])


def _states(record: Record) -> Cell:
    times = record.get("states_s", {})
    whole = sum(times.values())
    return Cell(_state_bar(times), times.get("running", 0) / whole if whole else -1.0)


def _sigma(record: Record) -> Cell:
    heading_deg, across_m, down_m = (
        _facts(record).get(key)
        for key in ("heading_sigma_deg", "horizontal_sigma_m", "vertical_sigma_m")
    )
    words = [] if heading_deg is None else [f"heading {three(heading_deg)}°"]
    if across_m is not None and down_m is not None:
        words += [f"level {three(100 * across_m)} cm", f"height {three(100 * down_m)} cm"]
    return Cell(_lines(words), math.inf if heading_deg is None else heading_deg)


def _nis(record: Record) -> Cell:
    means, ratios = (_facts(record).get(key, {}) for key in ("nis", "test_ratios"))
    lines = [
        f'<span class="line" title="largest test ratio {ratios.get(source, math.nan):.2g}">'
        f"{escape(source.replace('_', ' '))} {three(mean)}</span>"
        for source, mean in means.items()
    ]
    return Cell("<br>".join(lines) or "-", max(means.values(), default=-1.0))


def _checks(record: Record) -> Cell:
    counts = _severities(record)
    if not counts:
        return Cell("none" if "findings" in record else "-", 0.0)
    lines = "".join(
        f'<li class="{escape(finding["severity"])}">{escape(finding["evidence"])}: '
        f"{escape(finding['parameter'])}: {escape(finding['mend'])}</li>"
        for finding in record["findings"]
    )
    key = sum(counts[name] * 1000.0**rank for rank, name in enumerate(reversed(_SEVERITIES)))
    return Cell(f"<details><summary>{_counted(counts)}</summary><ul>{lines}</ul></details>", key)


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


#: Titles of the columns after the flight's own, in the order of the page's head.
_COLUMNS: Mapping[str, Callable[[Record], Cell]] = {
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


def track_maps(tracks: Mapping[str, Track]) -> str:
    """Return a map of each site, the one with most flights first; "" without a track."""
    sites = sorted(_sites(tracks), key=len, reverse=True)
    figures = "".join(_figure(site) for site in sites[:_MOST_SITES])
    rest = len(sites) - _MOST_SITES
    more = f'<p class="lead">and {rest} sites more</p>' if rest > 0 else ""
    return f'<div class="maps">{figures}</div>{more}' if figures else ""


def _sites(tracks: Mapping[str, Track]) -> list[dict[str, Track]]:
    """Return the tracks by site: each track begins near another of its site."""
    begins = np.radians([track[0] for track in tracks.values()]).reshape(-1, 2)
    places_e = ecef_from_geodetic(begins[:, 0], begins[:, 1], np.zeros(len(begins)))
    numbers = np.arange(len(begins))  # of each track's site: that of its last track
    for last, place_e in enumerate(places_e):
        near = np.linalg.norm(places_e[:last] - place_e, axis=1) < _SITE_M
        numbers[np.isin(numbers, numbers[:last][near])] = last
    sites: dict[int, dict[str, Track]] = {}
    for number, (name, track) in zip(numbers.tolist(), tracks.items(), strict=True):
        sites.setdefault(number, {})[name] = track
    return list(sites.values())


def _figure(site: Mapping[str, Track]) -> str:
    """Return the map of a site, north up, with a scale bar, and its place in words."""
    every = [point for track in site.values() for point in track]
    north_m, east_m, _ = positions_ned(every).T
    size_m = np.maximum([np.ptp(east_m), np.ptp(north_m)], _LEAST_M)
    room = np.array([_WIDTH, _HEIGHT]) - 2 * _EDGE - [0.0, _FOOT]
    scale = float(np.min(room / size_m))
    x = _WIDTH / 2 + scale * (east_m - (east_m.max() + east_m.min()) / 2)
    y = (_HEIGHT - _FOOT) / 2 - scale * (north_m - (north_m.max() + north_m.min()) / 2)
    ends = np.cumsum([len(track) for track in site.values()])[:-1]
    lines = zip(site, np.split(np.column_stack([x, y]), ends), strict=True)
    drawn = "".join(_line(name, points) for name, points in lines)
    count = f"{len(site)} flight{'s' if len(site) > 1 else ''}"
    place = " ".join(_degrees(*every[0]))
    return (
        f'<figure><svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'aria-label="tracks of {count} at {place}">{drawn}{_scale_bar(scale)}</svg>'
        f"<figcaption>{place}: {count}</figcaption></figure>"
    )


def _line(name: str, points: Array) -> str:
    pairs = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    x, y = points[0]
    return (
        f'<a href="#{_anchor(name)}"><title>{escape(name)}</title>'
        f'<polyline points="{pairs}"/><circle cx="{x:.1f}" cy="{y:.1f}" r="2.5"/></a>'
    )


def _scale_bar(scale: float) -> str:
    """Return a bar of 1, 2 or 5 times a power of ten metres, at most a third of the width."""
    most_m = _WIDTH / 3 / scale
    power = 10.0 ** math.floor(math.log10(most_m))
    length_m = power * max(step for step in (1, 2, 5) if step * power <= most_m)
    words = f"{length_m / 1000:g} km" if length_m >= 1000 else f"{length_m:g} m"
    y, end = _HEIGHT - 6, _EDGE + length_m * scale
    return (
        f'<path class="scale" d="M{_EDGE:g} {y - 4:g}V{y:g}H{end:.1f}V{y - 4:g}"/>'
        f'<text x="{end + 6:.1f}" y="{y:g}">{words}</text>'
    )

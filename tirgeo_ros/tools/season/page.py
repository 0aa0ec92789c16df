"""Write the season's page: all flights that have a record in a folder, in one file."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import SeasonError
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.tools.presentation.plots import html_page
from tirgeo_ros.tools.presentation.progress import three
from tirgeo_ros.tools.season.flight_facts import positions_ned
from tirgeo_ros.tools.season.flight_record import Record, read_records
from tirgeo_ros.tools.season.page_cells import (
    COLUMNS,
    anchor,
    clock,
    counted,
    degrees,
    row_cells,
    severities,
    state_bar,
)

#: Flights that begin this near to one of a site belong to it.
_SITE_M = 500.0
_MOST_SITES = 24
_WIDTH, _HEIGHT, _EDGE = 320.0, 220.0, 16.0  # of a map, in its own units
_LEAST_M = 20.0  # across: a flight that hovers is a point, not a scribble

Track = list[list[float]]  # (n, 2): latitude, longitude, degrees


def track_maps(tracks: Mapping[str, Track]) -> str:
    """Return a map of each site, the one with most flights first; "" without a track."""
    sites = sorted(_sites(tracks), key=len, reverse=True)
    figures = "".join(_figure(site) for site in sites[:_MOST_SITES])
    rest = len(sites) - _MOST_SITES
    more = f'<p class="lead">and {rest} sites more</p>' if rest > 0 else ""
    return f'<div class="maps">{figures}</div>{more}' if figures else ""


def _sites(tracks: Mapping[str, Track]) -> list[dict[str, Track]]:
    """Return the tracks by site: each begins near to another one of its site."""
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
    scale = float(np.min((np.array([_WIDTH, _HEIGHT]) - 2 * _EDGE - [0.0, 14.0]) / size_m))
    x = _WIDTH / 2 + scale * (east_m - (east_m.max() + east_m.min()) / 2)
    y = (_HEIGHT - 14.0) / 2 - scale * (north_m - (north_m.max() + north_m.min()) / 2)
    ends = np.cumsum([len(track) for track in site.values()])[:-1]
    lines = zip(site, np.split(np.column_stack([x, y]), ends), strict=True)
    drawn = "".join(_line(name, points) for name, points in lines)
    count = f"{len(site)} flight{'s' if len(site) > 1 else ''}"
    place = " ".join(degrees(*every[0]))
    return (
        f'<figure><svg viewBox="0 0 {_WIDTH:g} {_HEIGHT:g}" role="img" '
        f'aria-label="tracks of {count} at {place}">{drawn}{_scale_bar(scale)}</svg>'
        f"<figcaption>{place}: {count}</figcaption></figure>"
    )


def _line(name: str, points: Array) -> str:
    told = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    x, y = points[0]
    return (
        f'<a href="#{anchor(name)}"><title>{escape(name)}</title>'
        f'<polyline points="{told}"/><circle cx="{x:.1f}" cy="{y:.1f}" r="2.5"/></a>'
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


STYLE = """
:root { color-scheme: light dark; --run: #2e8b57; --warn: #d08a00; --bad: #c0392b;
  --idle: #9aa0a6; --link: #0b63b0; }
body { max-width: 110rem; }
a { color: var(--link); }
.totals { display: flex; flex-wrap: wrap; gap: .6rem 2rem; margin: 1rem 0; padding: 0; }
.totals div { min-width: 7rem; }
.totals dt { color: var(--soft); font-size: .85rem; }
.totals dd { margin: 0; font-size: 1.15rem; font-weight: 600; }
.totals .wide { flex: 1 1 18rem; font-size: .9rem; }
.totals .wide dd { font-size: .9rem; font-weight: 400; }
.bar { display: flex; height: .5rem; border-radius: .25rem; overflow: hidden; margin: .3rem 0;
  min-width: 6rem; }
.bar i { background: var(--idle); }
.bar .running { background: var(--run); }
.bar .degraded, .bar .dead_reckoning { background: var(--warn); }
.bar .lost { background: var(--bad); }
b.stop { color: var(--bad); }
b.caution { color: var(--warn); }
b.note { color: var(--soft); font-weight: 400; }
.maps { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 18rem), 1fr)); }
.maps svg { width: 100%; border: 1px solid var(--line); border-radius: .4rem; }
.maps polyline { fill: none; stroke: var(--link); stroke-width: 1.3; stroke-opacity: .75; }
.maps circle { fill: var(--run); }
.maps a:hover polyline, .maps a:focus polyline { stroke: var(--bad); stroke-opacity: 1; }
.scale { fill: none; stroke: currentColor; }
.maps text { fill: currentColor; font-size: 11px; }
table { width: 100%; font-size: .88rem; }
th, td { text-align: left; vertical-align: top; padding: .4rem .6rem; overflow-wrap: normal; }
td:last-child { overflow-wrap: anywhere; }
.line { white-space: nowrap; }
th { position: sticky; top: 0; background: var(--paper); z-index: 1; white-space: nowrap; }
th button { font: inherit; font-weight: 600; color: inherit; background: none; border: 0;
  padding: 0; cursor: pointer; }
th[aria-sort=ascending] button::after { content: " \\25b2"; }
th[aria-sort=descending] button::after { content: " \\25bc"; }
td:first-child { min-width: 9rem; overflow-wrap: anywhere; }
td:first-child img { display: block; width: 8rem; max-width: 100%; border-radius: .3rem; }
td:first-child strong, td:first-child span { display: block; }
td:nth-child(5) { min-width: 9rem; }
td:nth-child(9) { max-width: 16rem; }
tr:target { outline: 2px solid var(--link); }
details ul { padding-left: 1rem; margin: .3rem 0; }
summary { cursor: pointer; white-space: nowrap; }
.sort { display: none; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e6e6; --paper: #16181b; --soft: #a3a8ae; --line: #3a3f45; --fine: #2a2e33;
    --fault: #3a1f1d; --run: #4fbf85; --warn: #e5a93b; --bad: #ff7b6b; --link: #7fb8f0; }
}
@media (max-width: 60rem) {
  .sort { display: block; margin: .5rem 0; }
  .sort select { font: inherit; padding: .4rem; }
  thead { display: none; }
  table, tbody { display: block; }
  tr { display: grid; grid-template-columns: 1fr; border: 1px solid var(--line);
    border-radius: .5rem; padding: .5rem .7rem; margin: .8rem 0; }
  td { display: grid; grid-template-columns: 5.5rem 1fr; border: 0; padding: .15rem 0; }
  td::before { content: attr(data-title); color: var(--soft); }
  td > div { min-width: 0; }
  td:first-child { display: block; }
  td:first-child::before { content: none; }
  td:first-child img { width: 100%; max-width: 24rem; }
  td:first-child strong { font-size: 1.1rem; margin-top: .3rem; }
  td:first-child a { display: inline-block; padding: .4rem .8rem .4rem 0; }
  summary { white-space: normal; }
}
"""

#: Sorts the rows by the values that the cells carry; the page is whole without it.
SCRIPT = """
const body = document.querySelector("tbody");
const heads = [...document.querySelectorAll("th")];
const choice = document.querySelector(".sort select");
function sorted(column, down) {
  const value = (row) => {
    const text = row.cells[column].dataset.key;
    return column > 1 ? Number(text) : text; // the first two are names and times
  };
  const order = (a, b) => (value(a) < value(b) ? -1 : value(a) > value(b) ? 1 : 0);
  const rows = [...body.rows].sort((a, b) => (down ? order(b, a) : order(a, b)));
  body.append(...rows);
  heads.forEach((head) => head.removeAttribute("aria-sort"));
  heads[column].setAttribute("aria-sort", down ? "descending" : "ascending");
  choice.value = `${column} ${down ? 1 : 0}`;
}
heads.forEach((head, column) => head.firstElementChild.addEventListener("click", () =>
  sorted(column, head.getAttribute("aria-sort") === "ascending")));
choice.addEventListener("change", () => {
  const [column, down] = choice.value.split(" ").map(Number);
  sorted(column, down === 1);
});
"""


PAGE = "index.html"


def write_page(folder: Path) -> None:
    """Write ``index.html`` from the records in a folder. Raises SeasonError."""
    records = read_records(folder)
    pictures = {name: _picture(folder / f"{name}.jpg") for name in records}
    text = season_html(folder.resolve().name, records, pictures)
    write_files({folder / PAGE: text}, SeasonError)


def season_html(title: str, records: Mapping[str, Record], pictures: Mapping[str, bytes]) -> str:
    """Return the page of flights by name, each with its small JPEG or b""."""
    flights = sorted(records.values(), key=_begin)
    tracks = {
        str(one["season"]["name"]): one["season"]["facts"]["track_deg"]
        for one in flights
        if one["season"]["facts"].get("track_deg")
    }
    body = [
        f"<h1>{escape(title)}</h1>",
        f'<dl class="totals">{"".join(_totals(flights))}</dl>',
        track_maps(tracks),
        "<h2>Flights</h2>",
        *_table(flights, pictures),
        f"<script>{SCRIPT}</script>",
    ]
    return html_page(title, STYLE, "\n".join(body))


def _table(flights: Sequence[Record], pictures: Mapping[str, bytes]) -> Iterator[str]:
    """Yield the table by the flights' begin, and the choice of another order for narrow pages."""
    choices = "".join(
        f'<option value="{place} {int(down)}"{" selected" * (place == 1 and not down)}>'
        f"{escape(title)} {arrow}</option>"
        for place, title in enumerate(COLUMNS)
        for down, arrow in ((False, "\u25b2"), (True, "\u25bc"))
    )
    heads = "".join(
        f"<th{' aria-sort=ascending' * (place == 1)}><button>{escape(title)}</button></th>"
        for place, title in enumerate(COLUMNS)
    )
    yield f'<label class="sort">sort by <select>{choices}</select></label>'
    yield f"<table><thead><tr>{heads}</tr></thead><tbody>"
    for record in flights:
        name = record["season"]["name"]
        cells = "".join(
            f'<td data-title="{escape(title)}" data-key="{escape(_key(cell.key), quote=True)}">'
            f"<div>{cell.html}</div></td>"
            for title, cell in row_cells(record, pictures.get(name, b"")).items()
        )
        yield f'<tr id="{anchor(name)}">{cells}</tr>'
    yield "</tbody></table>"


def _key(value: float | str) -> str:
    """Return what the page's script compares: numbers as JavaScript reads them."""
    return value if isinstance(value, str) else f"{value:.9g}".replace("inf", "Infinity")


def _begin(record: Record) -> tuple[str, str]:
    return record["season"]["facts"].get("begin_utc", "9"), record["season"]["name"]


def _picture(path: Path) -> bytes:
    try:
        return path.read_bytes() if path.is_file() else b""
    except OSError:
        return b""


def _totals(flights: Sequence[Record]) -> Iterator[str]:
    """Yield what the flights come to, all together."""
    times: Counter[str] = Counter()
    found: Counter[str] = Counter()
    for one in flights:
        times.update(one.get("states_s", {}))
        found.update(severities(one))
    errors = sum(bool(one["error"]) for one in flights)
    way_m = sum(one["season"]["facts"].get("distance_m", 0.0) for one in flights)
    frames = sum(one.get("overlay", {}).get("drawn", 0) for one in flights)
    yield _total("flights", f"{len(flights)}")
    if errors:
        yield _total("with an error", f'<b class="stop">{errors}</b>')
    yield _total("flown", clock(sum(one.get("duration_s", 0.0) for one in flights)))
    yield _total("distance", f"{three(way_m / 1000)} km")
    if frames:
        yield _total("pictures with the map", f"{frames}")
    yield _total("findings", counted(found) or "none")
    yield _total("states", state_bar(times), "wide")


def _total(title: str, html: str, kind: str = "") -> str:
    return f'<div class="{kind}"><dt>{title}</dt><dd>{html}</dd></div>'

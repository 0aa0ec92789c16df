"""Write the season's page: all flights that have a record in a folder, in one file."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from html import escape
from pathlib import Path

from tirgeo_ros.core.types.errors import SeasonError
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.tools.presentation.html_page import html_page
from tirgeo_ros.tools.presentation.progress import three
from tirgeo_ros.tools.season.flight_record import Record, read_records
from tirgeo_ros.tools.season.page_cells import (
    COLUMNS,
    anchor,
    clock,
    counted,
    row_cells,
    severities,
    state_bar,
)
from tirgeo_ros.tools.season.page_look import SCRIPT, STYLE
from tirgeo_ros.tools.season.track_maps import track_maps

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

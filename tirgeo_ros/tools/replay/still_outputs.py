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
"""Write stills with the map drawn on them, each with its own metadata, and their contact page."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import cv2
import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.overlay.picture_painter import Unpainted
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.files.whole_files import PathLike, made_folder, write_files
from tirgeo_ros.io.pictures.jpeg_segments import metadata_of, with_metadata
from tirgeo_ros.tools.presentation.plots import embedded, html_page

PAGE = "index.html"
#: Quality of the drawn stills, unless the parameters have one: for looking at, not for a link.
STILL_QUALITY = 92
_THUMBNAIL_PX, _THUMBNAIL_QUALITY = 320, 60
_JPEG = (".jpg", ".jpeg")
_STYLE = """
body { max-width: 84rem; }
.stills { display: grid; gap: 1rem; padding: 0; list-style: none;
  grid-template-columns: repeat(auto-fill, minmax(min(100%, 15rem), 1fr)); }
.stills li { border: 1px solid var(--line); border-radius: .5rem; overflow: hidden; }
.stills img { display: block; width: 100%; }
.stills div { padding: .5rem .7rem; }
.stills strong, .stills span { display: block; }
.stills strong { font-size: .9rem; }
.stills span { color: var(--soft); font-size: .85rem; }
.stills .notice { color: var(--fault-edge); }
a { color: inherit; }
"""


class StillState(NamedTuple):
    """Hold what is known of a still before it is drawn."""

    stamp_ns: int
    notice: str  # why no map is drawn on it; empty if it is drawn
    place: tuple[float, float, float] | None  # of the camera: latitude, longitude (deg), height m


@dataclass(frozen=True)
class _Row:
    name: str  # of the still
    state: StillState | None = None  # None: it was never drawn
    file: str = ""  # relative to the folder
    thumbnail: bytes = b""
    why: str = ""  # it was never drawn


class StillOutputs:
    """Write the drawn stills of a flight into a folder, then the page of all.

    ``names`` are the stamps (ns) of the stills by their names. Raise BagError for a folder in
    which a drawn still would be among the stills themselves.
    """

    def __init__(self, folder: PathLike, flight: PathLike, names: Mapping[str, int]) -> None:
        self.folder = made_folder(folder, BagError)
        inside, source = self.folder.resolve(), Path(flight).resolve()
        if source == inside or source in inside.parents:
            raise BagError(f"{folder}: the stills themselves are there: give another folder")
        self._source = source
        self._names = {stamp_ns: name for name, stamp_ns in names.items()}
        self._metadata: dict[int, bytes] = {}
        self._rows: dict[str, _Row] = {}

    def take(self, stamp_ns: int, original: bytes) -> None:
        """Keep the metadata of a still until it is drawn."""
        self._metadata[stamp_ns] = metadata_of(original)

    def state_of(self, picture: Unpainted, plane: TangentPlane | None) -> StillState:
        """Return the state of a picture that will be drawn; ``plane`` is that of its pose."""
        if picture.pose is None or plane is None:
            return StillState(picture.stamp_ns, picture.notice, None)
        latitude, longitude, height_m = plane.geodetic_from_ned(picture.pose.position_n)
        place = math.degrees(latitude), math.degrees(longitude), float(height_m)
        return StillState(picture.stamp_ns, picture.notice, place)

    def write(self, state: StillState, jpeg: bytes) -> None:
        """Write a drawn still under its own name."""
        name = self._names.get(state.stamp_ns, f"{state.stamp_ns}.jpg")
        file = name if name.lower().endswith(_JPEG) else f"{name}.jpg"
        path = self.folder / file
        if self._source in (path.resolve(), *path.resolve().parents):
            raise BagError(f"{path}: would overwrite an input; give another folder")
        made_folder(path.parent, BagError)
        whole = with_metadata(jpeg, self._metadata.pop(state.stamp_ns, b""))
        write_files({path: whole}, BagError)
        self._rows[name] = _Row(name, state, file, _thumbnail(jpeg))

    def finish(self, refused: Sequence[tuple[str, str]], why: str) -> dict[str, object]:
        """Write the page; ``refused`` are files that were not read, ``why`` others are missing."""
        others = [name for name in self._names.values() if name not in self._rows]
        rows = [*self._rows.values(), *(_Row(name, why=why) for name in others)]
        rows += [_Row(name, why=reason) for name, reason in refused]
        drawn = sum(row.state is not None and not row.state.notice for row in rows)
        page = self.folder / PAGE
        write_files({page: _page(self._source.name, rows, drawn)}, BagError)
        return {"folder": str(self.folder), "page": str(page), "stills": len(rows), "drawn": drawn}


def _thumbnail(jpeg: bytes) -> bytes:
    pixels = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None  # it was encoded here
    scale = min(_THUMBNAIL_PX / pixels.shape[1], 1.0)
    small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _THUMBNAIL_QUALITY])[1].tobytes()


def _page(title: str, rows: Sequence[_Row], drawn: int) -> str:
    items = "\n".join(map(_item, rows))
    lead = f'<p class="lead">{drawn} of {len(rows)} stills with a trusted pose</p>'
    body = f'<h1>{escape(title)}</h1>\n{lead}\n<ul class="stills">\n{items}\n</ul>'
    return html_page(title, _STYLE, body)


def _item(row: _Row) -> str:
    name, url = escape(row.name), escape(quote(row.file, errors="surrogateescape"))
    if row.state is None:
        notice = f'<span class="notice">not drawn: {escape(row.why)}</span>'
        return f"<li><div><strong>{name}</strong>{notice}</div></li>"
    stamp_ns, notice, place = row.state
    state = f'<span class="notice">{escape(notice)}</span>' if notice else "<span>drawn</span>"
    lines = [state, f"<span>{utc(stamp_ns)[:19].replace('T', ' ')} UTC</span>"]
    if place is not None:
        latitude, longitude, height_m = place
        lines.append(f"<span>{latitude:.6f}, {longitude:.6f}, {height_m:.1f} m</span>")
    picture = f'<a href="{url}">{embedded(row.thumbnail, "image/jpeg", row.name)}</a>'
    words = f'<strong><a href="{url}">{name}</a></strong>{"".join(lines)}'
    return f"<li>{picture}<div>{words}</div></li>"

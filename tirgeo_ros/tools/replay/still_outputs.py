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
from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

import cv2
import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.overlay.frame_shapes import Unpainted
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, made_folder, write_files
from tirgeo_ros.io.pictures.jpeg_segments import metadata_of, with_metadata
from tirgeo_ros.tools.presentation.plots import embedded, html_page

PAGE = "index.html"
#: Quality of the drawn stills, unless the parameters have one: for looking at, not for a link.
STILL_QUALITY = 92
_THUMBNAIL_PX, _THUMBNAIL_QUALITY = 320, 60
_JPEG, _LOST = (".jpg", ".jpeg"), "its picture cannot be read"
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


class StillOutputs:
    """Write the drawn stills of a flight into a folder, then the page of all.

    ``flight`` is a folder of stills, or one, that is imported. Raise BagError for a folder in
    which a drawn still would be among the stills themselves.
    """

    def __init__(self, folder: PathLike, flight: BagReader) -> None:
        self.folder, self._source = Path(folder), Path(flight.path)
        inside, source = self.folder.resolve(), self._source.resolve()
        if source == inside or source in inside.parents:
            raise BagError(f"{folder}: the stills themselves are there: give another folder")
        self._names = {stamp_ns: name for name, stamp_ns in flight.stills().items()}
        self._known: dict[int, tuple[str, str]] = {}  # notice, and place, of what is being drawn
        self._items: dict[str, str] = {}  # of the page, by name
        self._drawn = 0  # with a map

    def note(self, picture: Unpainted, plane: TangentPlane | None) -> None:
        """Note why a picture will have no map, and its place; ``plane`` is that of its pose."""
        place = ""
        if picture.pose is not None and plane is not None:
            *angles_rad, height_m = plane.geodetic_from_ned(picture.pose.position_n)
            degrees = ", ".join(f"{math.degrees(angle_rad):.6f}" for angle_rad in angles_rad)
            place = f"{degrees}, {height_m:.1f} m"
        self._known[picture.stamp_ns] = picture.notice, place

    def write(self, stamp_ns: int, jpeg: bytes) -> None:
        """Write a drawn still under its own name, with its own metadata."""
        name, (notice, place) = self._names[stamp_ns], self._known.pop(stamp_ns)
        file = name if name.lower().endswith(_JPEG) else f"{name}.jpg"
        original = self._source / name if self._source.is_dir() else self._source
        path = made_folder((self.folder / file).parent, BagError) / Path(file).name
        check_outputs([original], [path], BagError)
        write_files({path: with_metadata(jpeg, metadata_of(original.read_bytes()))}, BagError)
        lines = f"{utc(stamp_ns)[:19].replace('T', ' ')} UTC", place
        self._items[name] = _item(name, file, notice, lines, thumbnail_of(jpeg))
        self._drawn += not notice

    def finish(self, refused: Sequence[tuple[str, str]]) -> dict[str, object]:
        """Write the page; ``refused`` are files that were not read, and why."""
        others = [(name, _LOST) for name in self._names.values() if name not in self._items]
        items = [*self._items.values(), *(_undrawn(*each) for each in [*others, *refused])]
        title, page = self._source.name, self.folder / PAGE
        lead = f'<p class="lead">{self._drawn} of {len(items)} stills with a trusted pose</p>'
        body = [f"<h1>{escape(title)}</h1>", lead, '<ul class="stills">', *items, "</ul>"]
        write_files({page: html_page(title, _STYLE, "\n".join(body))}, BagError)
        counts = {"stills": len(items), "drawn": self._drawn}
        return {"folder": str(self.folder), "page": str(page), **counts}


def thumbnail_of(picture: bytes) -> bytes:
    """Return a small JPEG of a picture that was encoded here."""
    pixels = cv2.imdecode(np.frombuffer(picture, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None
    scale = min(_THUMBNAIL_PX / pixels.shape[1], 1.0)
    small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _THUMBNAIL_QUALITY])[1].tobytes()


def _item(name: str, file: str, notice: str, lines: Iterable[str], jpeg: bytes) -> str:
    """Return the page's item of a still that is written, as ``file`` in the folder."""
    link = f'<a href="{escape(quote(file, errors="surrogateescape"))}">'
    words = f'<span class="notice">{escape(notice)}</span>' if notice else "<span>drawn</span>"
    words += "".join(f"<span>{line}</span>" for line in lines if line)
    picture = f"{link}{embedded(jpeg, 'image/jpeg', name)}</a>"
    return f"<li>{picture}<div><strong>{link}{escape(name)}</a></strong>{words}</div></li>"


def _undrawn(name: str, why: str) -> str:
    notice = f'<span class="notice">not drawn: {escape(why)}</span>'
    return f"<li><div><strong>{escape(name)}</strong>{notice}</div></li>"

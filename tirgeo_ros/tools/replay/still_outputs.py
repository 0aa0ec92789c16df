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
from html import escape
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import cv2
import numpy as np

from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.overlay.picture_painter import Unpainted
from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.files.whole_files import PathLike, made_folder, write_files
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


class StillState(NamedTuple):
    """Hold what is known of a still before it is drawn."""

    stamp_ns: int
    notice: str  # why no map is drawn on it; empty if it is drawn
    place: str  # of the camera: latitude, longitude (deg), height (m)


class StillOutputs:
    """Write the drawn stills of a flight into a folder, then the page of all.

    ``names`` are the stamps (ns) of the stills by their names. Raise BagError for a folder in
    which a drawn still would be among the stills themselves.
    """

    def __init__(self, folder: PathLike, flight: PathLike, names: Mapping[str, int]) -> None:
        self.folder = Path(folder)
        inside, source = self.folder.resolve(), Path(flight).resolve()
        if source == inside or source in inside.parents:
            raise BagError(f"{folder}: the stills themselves are there: give another folder")
        self._source = source
        self._names = {stamp_ns: name for name, stamp_ns in names.items()}
        self._metadata: dict[int, bytes] = {}
        self._items: dict[str, str] = {}  # of the page, by name
        self._drawn = 0  # with a map

    def take(self, stamp_ns: int, original: bytes) -> None:
        """Keep the metadata of a still until it is drawn."""
        self._metadata[stamp_ns] = metadata_of(original)

    def state_of(self, picture: Unpainted, plane: TangentPlane | None) -> StillState:
        """Return the state of a picture that will be drawn; ``plane`` is that of its pose."""
        place = ""
        if picture.pose is not None and plane is not None:
            *angles_rad, height_m = plane.geodetic_from_ned(picture.pose.position_n)
            degrees = ", ".join(f"{math.degrees(angle_rad):.6f}" for angle_rad in angles_rad)
            place = f"{degrees}, {height_m:.1f} m"
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
        self._items[name] = _item(name, file, state, jpeg)
        self._drawn += not state.notice

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


def thumbnail(pixels: RawPixels) -> bytes:
    """Return a small picture of a picture (h, w) or (h, w, 3), as JPEG."""
    scale = min(_THUMBNAIL_PX / pixels.shape[1], 1.0)
    small = cv2.resize(pixels, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return cv2.imencode(".jpg", small, [cv2.IMWRITE_JPEG_QUALITY, _THUMBNAIL_QUALITY])[1].tobytes()


def _undrawn(name: str, why: str) -> str:
    notice = f'<span class="notice">not drawn: {escape(why)}</span>'
    return f"<li><div><strong>{escape(name)}</strong>{notice}</div></li>"


def _item(name: str, file: str, state: StillState, jpeg: bytes) -> str:
    """Return the page's item of a still that is written, as ``file`` in the folder."""
    link = f'<a href="{escape(quote(file, errors="surrogateescape"))}">'
    notice = f'<span class="notice">{escape(state.notice)}</span>'
    lines = [notice if state.notice else "<span>drawn</span>"]
    lines.append(f"<span>{utc(state.stamp_ns)[:19].replace('T', ' ')} UTC</span>")
    lines.append(state.place and f"<span>{state.place}</span>")
    pixels = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_COLOR)
    assert pixels is not None  # it was encoded here
    picture = f"{link}{embedded(thumbnail(pixels), 'image/jpeg', name)}</a>"
    words = f"<strong>{link}{escape(name)}</a></strong>{''.join(lines)}"
    return f"<li>{picture}<div>{words}</div></li>"

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
"""Load the layers of a map's files, drawn by a style sheet or in the default style."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Collection, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from tirgeo_ros.core.map.vector_map import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.types.arrays import BoolArray, IntArray
from tirgeo_ros.core.types.errors import ConfigError, MapError, shown
from tirgeo_ros.io.coordinates.crs import ASSUMED, in_range, once_around, range_fault, to_wgs84
from tirgeo_ros.io.files.bounded_reading import read_map
from tirgeo_ros.io.files.whole_files import named_files
from tirgeo_ros.io.maps.gdal_tables import read_tables
from tirgeo_ros.io.maps.style_sheet import (
    LabelRule,
    SheetLayer,
    Wanted,
    load_style_sheet,
    shown_value,
)
from tirgeo_ros.io.maps.tables import NAMES, Shapes, Table

_LONGEST_NAME = 40  # characters of a bad feature's name in a message
_MOST_NAMED = 3
#: Files that belong to a shapefile.
_SIDECARS = (".shx", ".dbf", ".prj", ".cpg")
#: A file of the map, and the entry of the style sheet that draws it; None: the default style.
_Source = tuple[Path, SheetLayer | None]


def read_layers(
    map: str,  # noqa: A002  the parameter's name
    style: str = "",
    label_field: str = "name",
    *,
    network: bool = False,
) -> list[MapLayer]:
    """Read the layers of a map in this process, in the order in which they are drawn.

    ``map`` is a file, or several with commas; ``style`` is a style sheet, or "": then every table
    of every file is a layer of the default style. Files that the sheet does not draw come first,
    also in the default style. ``label_field`` is the property that labels features where the sheet
    does not name one. ``network``: places on the network that a file names may be fetched.

    Raises MapError, naming the file (and layer and feature), for an invalid map; ConfigError,
    naming sheet, layer and key, for an invalid style sheet.
    """

    def load() -> list[MapLayer]:
        sources = _sources(map, style)
        layers = [layer for source in sources for layer in _layers(*source, label_field)]
        return _noted_once(layers, style)

    return read_map(load, network=network)


def map_files(map: str, style: str = "") -> list[Path]:  # noqa: A002  the parameter's name
    """Return each file on which the layers depend, once; some of them may not exist.

    Never raises: with an unreadable style sheet, these are the sheet and the map alone.
    """
    paths = [Path(name) for name in named_files(map)]
    if style:
        paths = [*paths, Path(style)]
        try:
            entries = load_style_sheet(style)
        except ConfigError:
            entries = []
        paths += [file for each in entries for file in (each.file, each.crs_file) if file]
    files = []
    for path in paths:
        files.append(path)
        if path.suffix.lower() == ".shp":
            files += [path.with_suffix(each) for each in _SIDECARS]
        elif path.suffix.lower() == ".gpkg":  # SQLite's log, while a program writes
            files.append(path.with_name(path.name + "-wal"))
    return list(dict.fromkeys(files))


def _noted_once(layers: list[MapLayer], style: str) -> list[MapLayer]:
    """Return the layers with each note of ``left_out`` only in the first layer that has it.

    Raises ConfigError if no feature meets the style sheet's conditions.
    """
    notes = list(dict.fromkeys(note for layer in layers for note in layer.left_out))
    if layers and not any(layer.features for layer in layers):
        raise ConfigError(
            f"{style}: its conditions match no feature of the map: {'; '.join(notes)}"
        )
    pending = set(notes)
    results = []
    for layer in layers:
        first = tuple(note for note in dict.fromkeys(layer.left_out) if note in pending)
        pending.difference_update(first)
        results.append(replace(layer, left_out=first))
    return results


def _sources(map_text: str, style: str) -> list[_Source]:
    paths = [Path(name) for name in named_files(map_text)]
    if not style:
        return [(path, None) for path in paths]
    sources: list[_Source] = []
    entries = load_style_sheet(style)
    if all(entry.file for entry in entries):
        drawn = {os.path.realpath(entry.file) for entry in entries if entry.file}
        sources = [(path, None) for path in paths if os.path.realpath(path) not in drawn]
    for entry in entries:
        if entry.file is None and not paths:
            raise ConfigError(f"{entry.where}: no key file, and parameter map is empty: set one")
        sources += [(path, entry) for path in ([entry.file] if entry.file else paths)]
    return sources


def _layers(path: Path, entry: SheetLayer | None, label_field: str) -> list[MapLayer]:
    label = entry.label if entry and entry.label else LabelRule.of_field(label_field)
    wanted = Wanted(label, entry.condition if entry else None)
    tables = read_tables(path, entry.layer if entry else "", wanted)
    layers, refusals = zip(*(_layer_of(table, wanted, entry) for table in tables), strict=True)
    if None not in refusals:
        hint = ""
        if path.suffix.lower() == ".kml" and b"<NetworkLink" in path.read_bytes():
            hint = ": it links to other files; open it in Google Earth or QGIS and save the places"
        empty = f"{path}: the map has no feature with a geometry{hint}"
        raise MapError(next(filter(None, refusals), empty))
    return [layer for layer in layers if layer is not None]


def _layer_of(
    table: Table, wanted: Wanted, entry: SheetLayer | None
) -> tuple[MapLayer | None, str | None]:
    """Return a table's layer in WGS84 (None without features and notes), and a refusal.

    The refusal says why no feature of the table can be drawn ("": it is empty); None if one can.
    The entry's coordinate system takes precedence over the table's own. A feature with a vertex
    that is not finite or not on the Earth is left out. Raises MapError for an unknown system.
    """
    with_shape = set(table.shapes.feature.tolist()) | table.faults.keys()
    shapes, remarks = _on_earth(table, entry.crs if entry else "")
    shapes = _without_repeats(shapes, table.faults)
    drawn = dict.fromkeys(shapes.feature.tolist())
    texts = {number: wanted.label.text(table.rows[number]) for number in drawn}
    features = [
        GeoFeature(texts[owner], closed, shapes.points[a:b], owner)
        for owner, closed, (a, b) in zip(
            shapes.feature.tolist(),
            shapes.closed.tolist(),
            itertools.pairwise(shapes.starts.tolist()),
            strict=True,
        )
    ]
    chosen, unmet = _chosen(features, table, wanted)
    bare = len(table.rows) - len(with_shape)
    notes = [
        *table.notes,
        *_fault_notes(table, texts),
        *([f"{table.where}: {bare} features without a geometry left out"] if bare else []),
        *remarks,
        *unmet,
    ]
    refusal = None
    if not texts:
        count = len(table.faults)
        rest = f" (none of {count} features can be drawn)" if count > 1 else ""
        refusal = f"{table.where}: {_fault(table, min(table.faults))}{rest}" if count else ""
    if not chosen and not notes:
        return None, refusal
    style, sigma_m = (entry.style, entry.sigma_m) if entry else (LayerStyle(), None)
    return MapLayer(table.name, chosen, style, sigma_m, tuple(map(shown, notes))), refusal


def _on_earth(table: Table, crs: str) -> tuple[Shapes, tuple[str, ...]]:
    """Return the shapes as latitude, longitude (rad), height (m), and remarks.

    Features off the Earth are left out. If most are off it, all are left out: the coordinate
    system is probably wrong.
    """
    shapes, faults = table.shapes, table.faults
    bad = ~np.isfinite(shapes.points[:, :2]).all(axis=1) | np.isinf(shapes.points[:, 2])
    x_y_z = "({:.6g}, {:.6g}, {:.6g}) is not finite"
    shapes = _without(shapes, bad, faults, lambda i: x_y_z.format(*table.shapes.points[i]))
    points = shapes.points
    remarks: tuple[str, ...] = ()
    system = crs or table.crs
    if system is not None:
        points, remarks = to_wgs84(points, system, table.where)
    elif len(points):
        remarks = (f"{table.where}: names no known coordinate system: {ASSUMED}",)
    bad = ~in_range(points)
    most = 2 * len(np.unique(_owner(shapes)[bad])) > len(np.unique(shapes.feature))

    def why(i: int) -> str:
        place = points[i] if np.isfinite(points[i, :2]).all() else shapes.points[i]
        return range_fault(place[0], place[1], all_are=most)

    kept = _without(replace(shapes, points=points), bad, faults, why)
    if most:
        doubt = "its place is uncertain, since most others are not on the Earth"
        kept = _without(kept, np.ones(len(kept.points), bool), faults, lambda _: doubt)
    x, y, z = kept.points.T
    around = once_around(x)
    if (np.abs(around - x) > 1).any():
        remarks += (f"{table.where}: 360 is subtracted from longitudes beyond 180",)
    return replace(kept, points=np.column_stack([np.radians(y), np.radians(around), z])), remarks


def _owner(shapes: Shapes) -> IntArray:
    """Return the feature of each point."""
    return np.repeat(shapes.feature, np.diff(shapes.starts))


def _without(
    shapes: Shapes, bad: BoolArray, faults: dict[int, str], why: Callable[[int], str]
) -> Shapes:
    """Return the shapes without features that have a bad point; add these to ``faults``."""
    if not bad.any():
        return shapes
    numbers, first = np.unique(_owner(shapes)[bad], return_index=True)
    for number, point in zip(numbers.tolist(), np.flatnonzero(bad)[first].tolist(), strict=True):
        faults.setdefault(number, why(point))
    return _selected(shapes, ~np.isin(shapes.feature, numbers))


def _selected(shapes: Shapes, keep: BoolArray) -> Shapes:
    """Return the parts selected by ``keep``."""
    sizes = np.diff(shapes.starts)
    starts = np.concatenate([[0], np.cumsum(sizes[keep])])
    points = shapes.points[np.repeat(keep, sizes)]
    return Shapes(points, starts, shapes.feature[keep], shapes.closed[keep])


def _without_repeats(shapes: Shapes, faults: dict[int, str]) -> Shapes:
    """Remove vertices equal to the one before; add lines without length to ``faults``."""
    points = shapes.points
    part = np.repeat(np.arange(len(shapes.feature)), np.diff(shapes.starts))
    same = (points[1:] == points[:-1]) | (np.isnan(points[1:]) & np.isnan(points[:-1]))
    keep = np.ones(len(points), bool)
    keep[1:] = ~same.all(axis=1) | (part[1:] != part[:-1])
    before, after = np.diff(shapes.starts), np.bincount(part[keep], minlength=len(shapes.feature))
    flat = (after == 1) & (before > 1)
    for number in shapes.feature[flat].tolist():
        faults.setdefault(number, "a line without length")
    starts = np.concatenate([[0], np.cumsum(after)])
    return _selected(replace(shapes, points=points[keep], starts=starts), ~flat)


def _fault_notes(table: Table, drawn: Collection[int]) -> Iterator[str]:
    """Yield a line for each of the first faulty features, and one line for the others."""
    first = sorted(table.faults)[:_MOST_NAMED]
    for number in first:
        part = "part of " if number in drawn else ""
        yield f"{table.where}: {part}{_fault(table, number)}; left out"
    more = len(table.faults) - len(first)
    if more:
        yield f"{table.where}: {more} more features left out, wholly or in part"


def _fault(table: Table, number: int) -> str:
    """Return a line with a feature's number, name or id, and fault."""
    texts = (shown_value(table.rows[number].get(name)) for name in NAMES)
    name = next(filter(None, texts), "")[:_LONGEST_NAME]
    return f"feature {number + 1}{f' ({name})' if name else ''}: {table.faults[number]}"


def _chosen(
    features: list[GeoFeature], table: Table, wanted: Wanted
) -> tuple[list[GeoFeature], tuple[str, ...]]:
    """Return the features that meet the condition, and notes.

    The notes say if no feature meets it, or if it names an unknown property.
    """
    condition = wanted.condition
    if condition is None or not features:
        return features, ()
    chosen = [f for f in features if condition.holds(table.rows[f.group])]
    remarks = tuple(condition.unknown(table.fields, table.where))
    if not chosen and not remarks:
        remarks = (condition.unmet(table.rows, table.where),)
    return chosen, remarks

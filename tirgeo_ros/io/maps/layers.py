"""Load the layers of a map's files, by the style sheet or each in the default style."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from tirgeo_ros.core.map.layers import LayerStyle, MapLayer
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.files.offline_reading import read_map
from tirgeo_ros.io.files.text_file import named_files
from tirgeo_ros.io.maps.features import laid
from tirgeo_ros.io.maps.gdal_tables import read_tables
from tirgeo_ros.io.maps.property_rules import LabelRule, Wanted
from tirgeo_ros.io.maps.style_sheet import SheetLayer, load_style_sheet

#: Files that belong to a shapefile.
_SIDECARS = (".shx", ".dbf", ".prj", ".cpg")
#: A file of the map, and the entry of the style sheet that draws it.
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
        return _told_once(layers, style)

    return read_map(load, network=network)


def _told_once(layers: list[MapLayer], style: str) -> list[MapLayer]:
    """Return the layers with each note on what is left out only in the first layer that has it.

    Raises ConfigError if a style sheet's conditions leave nothing.
    """
    notes = list(dict.fromkeys(note for layer in layers for note in layer.left_out))
    if layers and not any(layer.features for layer in layers):
        raise ConfigError(f"{style}: it matches no feature of the map: {'; '.join(notes)}")
    untold = set(notes)
    told = []
    for layer in layers:
        mine = tuple(note for note in dict.fromkeys(layer.left_out) if note in untold)
        untold.difference_update(mine)
        told.append(replace(layer, left_out=mine))
    return told


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
            raise ConfigError(f"{entry.where}: has no file, and the parameter map is empty")
        sources += [(path, entry) for path in ([entry.file] if entry.file else paths)]
    return sources


def _layers(path: Path, entry: SheetLayer | None, label_field: str) -> list[MapLayer]:
    label = entry.label if entry and entry.label else LabelRule.of_field(label_field)
    wanted = Wanted(label, entry.condition if entry else None)
    tables = read_tables(path, entry.layer if entry else "", wanted)
    found = [laid(table, wanted, entry.crs if entry else "") for table in tables]
    refusals = [one.refusal for one in found if one.refusal is not None]
    if len(refusals) == len(found):
        raise MapError(next(filter(None, refusals), _empty(path)))
    style, sigma_m = (entry.style, entry.sigma_m) if entry else (LayerStyle(), None)
    return [
        MapLayer(table.name, one.features, style, sigma_m, one.notes)
        for table, one in zip(tables, found, strict=True)
        if one.features or one.notes
    ]


def _empty(path: Path) -> str:
    """Return the message for a map without a geometry."""
    linked = path.suffix.lower() == ".kml" and b"<NetworkLink" in path.read_bytes()
    what = ": it links to other files; open it in Google Earth or QGIS and save the places"
    return f"{path}: the map has no feature with a geometry{what if linked else ''}"


def map_files(map: str, style: str = "") -> list[Path]:  # noqa: A002  the parameter's name
    """Return every file whose change changes the layers, each once; some need not exist.

    Never raises: for an unreadable style sheet it returns only the sheet, beside the map.
    """
    paths = [Path(name) for name in named_files(map)]
    if style:
        paths = [*paths, Path(style)]
        try:
            entries = load_style_sheet(style)
        except ConfigError:
            entries = []
        paths += [file for each in entries for file in (each.file, each.crs_file) if file]
    return list(dict.fromkeys(each for path in paths for each in (path, *_companions(path))))


def _companions(path: Path) -> list[Path]:
    """Return the files that are read together with a map file."""
    if path.suffix.lower() == ".shp":
        return [path.with_suffix(each) for each in _SIDECARS]
    # The write-ahead log, which exists while a program writes the package.
    return [path.with_name(path.name + "-wal")] if path.suffix.lower() == ".gpkg" else []

"""Load the layers of a map's files, by the style sheet or each in the default style."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.files.memory_bound import MOST_BYTES, bounded_memory
from tirgeo_ros.io.files.offline_reading import read_map
from tirgeo_ros.io.files.text_file import named_files
from tirgeo_ros.io.maps.features import MapFeatures, laid
from tirgeo_ros.io.maps.formats import companions, read_tables
from tirgeo_ros.io.maps.label_rule import LabelRule
from tirgeo_ros.io.maps.style_condition import Wanted
from tirgeo_ros.io.maps.style_sheet import SheetLayer, load_style_sheet
from tirgeo_ros.io.maps.table import empty_map


@dataclass(frozen=True, slots=True)
class _Source:
    """Hold a file of the map, and the entry of the sheet that draws it."""

    path: Path
    entry: SheetLayer | None = None


def load_layers(
    map: str,  # noqa: A002  the parameter's name
    style: str = "",
    label_field: str = "name",
    *,
    network: bool = False,
) -> list[MapLayer]:
    """Load the layers of a map, in the order in which they are drawn.

    ``map`` is a file, or several with commas; ``style`` is a style sheet, or "": then every table
    of every file is a layer of the default style. Files that the sheet does not draw come first,
    also in the default style. ``label_field`` is the property that labels features where the sheet
    does not name one. ``network``: places on the network that a file names may be fetched.

    Raises MapError, naming the file (and layer and feature), for an invalid map; ConfigError,
    naming sheet, layer and key, for an invalid style sheet.
    """

    def load() -> list[MapLayer]:
        sources = _sources(map, style)
        layers = [layer for source in sources for layer in _layers(source, label_field)]
        return _told_once(layers, style)

    with bounded_memory():
        return read_map(load, network=network)


def _told_once(layers: list[MapLayer], style: str) -> list[MapLayer]:
    """Return the layers with each note on what is left out only in the first layer that has it.

    Raises ConfigError if a style sheet's conditions leave nothing.
    """
    notes = list(dict.fromkeys(note for layer in layers for note in layer.left_out))
    if layers and not any(layer.features for layer in layers):
        raise ConfigError(f"{style}: it draws no feature of the map: {'; '.join(notes)}")
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
        return [_Source(path) for path in paths]
    entries = load_style_sheet(style)
    drawn = {entry.file.resolve() for entry in entries if entry.file}
    if all(entry.file for entry in entries):
        first = [_Source(path) for path in paths if path.resolve() not in drawn]
    else:
        first = []
    return first + [source for entry in entries for source in _of_entry(entry, paths)]


def _of_entry(entry: SheetLayer, paths: Sequence[Path]) -> Iterator[_Source]:
    if entry.file is None and not paths:
        raise ConfigError(f"{entry.where}: has no file, and the parameter map names none")
    yield from (_Source(path, entry) for path in ([entry.file] if entry.file else paths))


def _layers(source: _Source, label_field: str) -> list[MapLayer]:
    try:
        return _read(source, label_field)
    except MemoryError:
        raise MapError(
            f"{source.path}: the map does not fit into memory ({MOST_BYTES >> 20} MB); cut out "
            "the flight's surroundings"
        ) from None


def _read(source: _Source, label_field: str) -> list[MapLayer]:
    entry = source.entry
    label = entry.label if entry and entry.label else LabelRule.of_field(label_field)
    wanted = Wanted(label, entry.condition if entry else None)
    tables = read_tables(source.path, entry.layer if entry else "", wanted)
    found = [laid(table, wanted, entry.crs if entry else "") for table in tables]
    refusals = [one.refusal for one in found if one.refusal is not None]
    if len(refusals) == len(found):
        raise MapError(next(filter(None, refusals), empty_map(source.path)))
    return [
        _layer(table.name, one, entry)
        for table, one in zip(tables, found, strict=True)
        if one.features or one.notes
    ]


def _layer(name: str, found: MapFeatures, entry: SheetLayer | None) -> MapLayer:
    if entry is None:
        return MapLayer(name, found.features, left_out=found.notes)
    return MapLayer(name, found.features, entry.style, entry.sigma_m, found.notes)


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
    return list(dict.fromkeys(each for path in paths for each in companions(path)))

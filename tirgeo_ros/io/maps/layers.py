"""The layers of a map: its files, as the style sheet has them or each in the default style."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from tirgeo_ros.core.errors import ConfigError, MapError
from tirgeo_ros.core.map_layers import GeoFeature, MapLayer
from tirgeo_ros.io.file_list import named_files
from tirgeo_ros.io.label_rule import LabelRule
from tirgeo_ros.io.maps.formats import companions, read_tables
from tirgeo_ros.io.maps.laying import laid
from tirgeo_ros.io.memory import MOST_BYTES, bounded_memory
from tirgeo_ros.io.offline import read_map
from tirgeo_ros.io.style_sheet import SheetLayer, load_style_sheet


@dataclass(frozen=True, slots=True)
class _Source:
    """A file of the map, and the entry of the sheet that asks for it."""

    path: Path
    entry: SheetLayer | None = None


def load_layers(
    map: str,  # noqa: A002  the parameter's name
    style: str = "",
    label_field: str = "name",
    *,
    network: bool = False,
) -> list[MapLayer]:
    """The layers of a map, in the order in which they are drawn.

    ``map`` is a file, or several with commas; ``style`` a style sheet, or "": then every table
    of every file is a layer of the default style. Files that the sheet does not draw come
    first, in that style too. ``label_field`` is the property that labels features where the
    sheet does not say. ``network``: what a file names elsewhere may be fetched.

    Raises MapError, naming the file (and layer and feature), for what is no map; ConfigError,
    naming sheet, layer and key, for what is no style sheet.
    """

    def load() -> list[MapLayer]:
        sources = _sources(map, style)
        return [layer for source in sources for layer in _layers(source, label_field)]

    with bounded_memory():
        return read_map(load, network=network)


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
    rule = entry.label if entry and entry.label else LabelRule.of_field(label_field)
    tables = read_tables(source.path, entry.layer if entry else "", rule)
    made = []
    for table in tables:
        features, left_out = laid(table, rule, entry.crs if entry else "")
        if features:
            made.append(_layer(table.name, features, left_out, entry))
    if not made:
        raise MapError(f"{source.path}: the map has no feature with a geometry")
    return made


def _layer(
    name: str, features: list[GeoFeature], left_out: tuple[str, ...], entry: SheetLayer | None
) -> MapLayer:
    if entry is None:
        return MapLayer(name, features, left_out=left_out)
    return MapLayer(name, features, entry.style, entry.sigma_m, left_out)


def map_files(map: str, style: str = "") -> list[Path]:  # noqa: A002  the parameter's name
    """Every file whose change changes the layers, each once; some need not exist.

    Never raises: of a style sheet that cannot be read it is the sheet alone, beside the map.
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

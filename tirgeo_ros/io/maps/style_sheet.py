"""Load style sheets: YAML files that list a map's layers and how each is drawn."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import ImageColor

from tirgeo_ros.core.config.schema import Parameter
from tirgeo_ros.core.map.layers import Colour, LayerStyle
from tirgeo_ros.core.types.errors import ConfigError, MapError
from tirgeo_ros.io.coordinates.crs import checked_system
from tirgeo_ros.io.files.text_file import read_text
from tirgeo_ros.io.maps.label_rule import LabelRule
from tirgeo_ros.io.maps.style_condition import Condition
from tirgeo_ros.io.parameters.parameter_file import load_yaml, nearest

_DEFAULT = LayerStyle()
_PLAIN = (
    Parameter("file", "", "map of the layer"),
    Parameter("layer", "", "table or folder of the map"),
    Parameter("width", _DEFAULT.width_px, "width of lines", "px", 1, 5),
    Parameter("fill_opacity", _DEFAULT.fill_opacity, "how much the fill hides", "", 0, 1),
    Parameter("sigma", 0.0, "standard deviation of the positions", "m", 0, 1000),
)
_MOST_LAYERS = 200  # each reads its file
_KEYS = (*(each.name for each in _PLAIN), "colour", "fill", "label", "scale", "crs", "where")


@dataclass(frozen=True, slots=True)
class SheetLayer:
    """Hold one entry of a style sheet."""

    where: str  # begins every message about it
    file: Path | None  # None: the map that is given beside the sheet
    layer: str  # table or folder; "" is all
    style: LayerStyle
    label: LabelRule | None  # None: as without a sheet
    crs: str  # "" is what the file says
    crs_file: Path | None  # where ``crs`` comes from, if from a file
    sigma_m: float | None
    condition: Condition | None = None  # which features are drawn; None: all


def load_style_sheet(path: str | Path) -> list[SheetLayer]:
    """Return the layers of a sheet, in the order in which they are drawn.

    Raises ConfigError, naming the sheet, the layer's number and the key, for anything unknown, of
    a wrong type or out of its range.
    """
    _check_file(Path(path), str(path))
    root = load_yaml(path)
    if not isinstance(root, Mapping) or not isinstance(root.get("layers"), list):
        raise ConfigError(f"{path}: no style sheet: it needs a list under layers:")
    _check_keys(root, ("layers",), str(path))
    if not root["layers"]:
        raise ConfigError(f"{path}: the list of layers is empty")
    if len(root["layers"]) > _MOST_LAYERS:
        raise ConfigError(
            f"{path}: {len(root['layers'])} layers, and at most {_MOST_LAYERS} are drawn"
        )
    return [
        _layer(entry, f"{path}: layer {number}", Path(path).parent)
        for number, entry in enumerate(root["layers"], 1)
    ]


def _layer(entry: Any, where: str, folder: Path) -> SheetLayer:
    if not isinstance(entry, Mapping):
        raise ConfigError(f"{where}: is no list of keys, as file: and colour: are")
    _check_keys(entry, _KEYS, where)
    values = {
        each.name: _plain(entry[each.name], each, where) for each in _PLAIN if each.name in entry
    }
    crs, crs_file = _crs(entry, where, folder)
    return SheetLayer(
        where,
        folder / values["file"] if "file" in values else None,
        values.get("layer", ""),
        _style(entry, values, where),
        _label(entry, where),
        crs,
        crs_file,
        values.get("sigma"),
        _condition(entry, where),
    )


def _check_keys(given: Mapping[Any, Any], known: tuple[str, ...], where: str) -> None:
    for key in given:
        if key not in known:
            raise ConfigError(f"{where}: unknown key {key}{nearest(str(key), known)}")


def _plain(value: Any, known: Parameter, where: str) -> Any:
    if value is None or value == "":
        raise ConfigError(f"{where}: {known.name} has no value")
    if isinstance(known.default, str) and isinstance(value, int) and not isinstance(value, bool):
        value = str(value)  # a table's name may look like a number
    try:
        checked = known.checked(value)
    except ConfigError as error:
        raise ConfigError(f"{where}: {str(error).removeprefix('parameter ')}") from None
    if isinstance(checked, float) and math.isnan(checked):
        raise ConfigError(f"{where}: {known.name}: {value} is no number")
    return checked


def _style(entry: Mapping[str, Any], values: Mapping[str, Any], where: str) -> LayerStyle:
    if "fill_opacity" in entry and "fill" not in entry:
        raise ConfigError(f"{where}: fill_opacity without fill: give fill a colour")
    return LayerStyle(
        line_bgr=_colour(entry, "colour", where) if "colour" in entry else _DEFAULT.line_bgr,
        width_px=values.get("width", _DEFAULT.width_px),
        fill_bgr=_colour(entry, "fill", where) if "fill" in entry else None,
        fill_opacity=values.get("fill_opacity", _DEFAULT.fill_opacity),
        labels=entry.get("label") is not False,
        scale_m_px=_scale(entry["scale"], where) if "scale" in entry else _DEFAULT.scale_m_px,
    )


def _colour(entry: Mapping[str, Any], key: str, where: str) -> Colour:
    value = entry[key]
    if value is None:
        raise ConfigError(f'{where}: {key} has no value; a colour with # needs quotes: "#ffd000"')
    try:
        rgb: tuple[int, ...] | None = ImageColor.getrgb(value)
    except (ValueError, TypeError, AttributeError):
        rgb = None
    if rgb is None or len(rgb) != 3 or not all(0 <= part <= 255 for part in rgb):
        raise ConfigError(
            f'{where}: {key}: {value!r} is no colour; give a name (red) or "#rrggbb"'
        )
    return rgb[2], rgb[1], rgb[0]


def _scale(value: Any, where: str) -> tuple[float, float]:
    plain = isinstance(value, list) and [
        type(item) for item in value if type(item) in {int, float}
    ]
    if not plain or len(plain) != 2 or len(value) != 2 or not 0 <= value[0] < value[1]:
        raise ConfigError(
            f"{where}: scale: {value!r} is not two numbers, the lesser first, in metres a pixel"
        )
    return float(value[0]), float(value[1])


def _words(entry: Mapping[str, Any], key: str, where: str, wanted: str) -> str:
    """Return the text of a key; raise ConfigError for anything else, or a blank one."""
    value = entry[key]
    if not isinstance(value, str) or not value.strip():
        raise ConfigError(f"{where}: {key}: {value!r} is {wanted}")
    return value


def _label(entry: Mapping[str, Any], where: str) -> LabelRule | None:
    if "label" not in entry:
        return None
    if entry["label"] is False:
        return LabelRule()
    text = _words(entry, "label", where, "neither a field nor false")
    return LabelRule.parsed(text, f"{where}: label")


def _condition(entry: Mapping[str, Any], where: str) -> Condition | None:
    if "where" not in entry:
        return None
    text = _words(entry, "where", where, "no condition, as kind == hydrant is")
    return Condition.parsed(text, f"{where}: where")


def _crs(entry: Mapping[str, Any], where: str, folder: Path) -> tuple[str, Path | None]:
    if "crs" not in entry:
        return "", None
    if isinstance(entry["crs"], int) and not isinstance(entry["crs"], bool):
        entry = {"crs": f"EPSG:{entry['crs']}"}
    text, file = _words(entry, "crs", where, "no code, WKT, PROJ text or .prj file"), None
    try:
        if text.lower().endswith((".prj", ".wkt")):
            file = folder / text
            _check_file(file, str(file))
            text = read_text(file, ConfigError, damaged="replace")
        checked_system(text, f"{where}: crs")
    except ConfigError as error:
        raise ConfigError(f"{where}: crs: {error}") from None
    except MapError as error:
        raise ConfigError(str(error).partition(";")[0]) from None
    return text, file


def _check_file(path: Path, where: str) -> None:
    """Refuse what exists but is no file: a node that checks it repeatedly would block on it."""
    if path.exists() and not path.is_file():
        raise ConfigError(f"{where}: is no file")

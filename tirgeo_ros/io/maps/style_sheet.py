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
"""Load style sheets: YAML files that list a map's layers and how each is drawn.

A label is the value of a property, or a template of several: ``{name} {ref}``. A condition looks
like ``kind == hydrant and flow >= 60``; its grammar:

    condition = comparison {"and" comparison}
    comparison = property ("==" | "!=" | "<" | "<=" | ">" | ">=") value
               | property "in" "[" value {"," value} "]"

A property and a value are a word, a number, or a text in quotes. Nothing else is evaluated.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from PIL import ImageColor

from tirgeo_ros.core.config.schema import Parameter
from tirgeo_ros.core.map.vector_map import Colour, LayerStyle
from tirgeo_ros.core.types.errors import ConfigError, MapError, nearest
from tirgeo_ros.io.coordinates.crs import checked_system
from tirgeo_ros.io.files.whole_files import read_text
from tirgeo_ros.io.parameters.parameter_file import load_yaml

_RUBBISH = re.compile(r"[\x00-\x20\x7f-\xa0\u2028\u2029]+")
_FIELD = re.compile(r"\{([^{}]+)\}")
_LONGEST = 1000  # characters of a condition, and of the message that no feature meets it
_VALUE = r"(?:\"[^\"]*\"|'[^']*'|[^\s\"'\[\],=!<>]+)"
_COMPARISON = re.compile(
    rf"\s*(?P<field>{_VALUE})(?:\s*(?P<sign>==|!=|<=|>=|<|>)\s*(?P<value>{_VALUE})"
    rf"|\s+in\s*\[(?P<values>\s*{_VALUE}\s*(?:,\s*{_VALUE}\s*)*)\])(?:\s+(?P<more>and)\s|\s*$)"
)
_ORDER: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}
_DEFAULT = LayerStyle()
#: The keys of a layer, first those whose values need no conversion.
_PLAIN = (
    Parameter("file", "", "map of the layer"),
    Parameter("layer", "", "table or folder of the map"),
    Parameter("width", _DEFAULT.width_px, "width of lines", "px", 1, 5),
    Parameter("fill_opacity", _DEFAULT.fill_opacity, "opacity of the fill", "", 0, 1),
    Parameter("sigma", 0.0, "standard deviation of the positions", "m", 0, 1000),
)
_KEYS = (*(each.name for each in _PLAIN), "colour", "fill", "label", "scale", "crs", "where")
_MOST_LAYERS = 200  # each reads its file


@dataclass(frozen=True, slots=True)
class LabelRule:
    """Make a label of properties' values: ``template`` names each between braces.

    If a table lacks a field, its name is looked for in another case. Without that too, the field
    is empty, or an error if ``source`` (a style sheet) names it.
    """

    template: str = ""
    source: str = ""

    @classmethod
    def of_field(cls, name: str, source: str = "") -> LabelRule:
        """Return the rule that shows one property unchanged; without a name, no label."""
        return cls(f"{{{name}}}", source) if name else cls()

    @classmethod
    def parsed(cls, text: str, source: str) -> LabelRule:
        """Return the rule of a field's name or of a template like ``{name} {ref}``.

        Raises ConfigError, beginning with ``source``, for an invalid template.
        """
        if not {"{", "}"} & set(text):
            return cls.of_field(text, source)
        if {"{", "}"} & set(_FIELD.sub("", text)):
            raise ConfigError(f"{source}: {text!r} is not a label; write it as {{name}} {{ref}}")
        return cls(text, source)

    @property
    def fields(self) -> tuple[str, ...]:
        """Return the properties to read."""
        return tuple(_FIELD.findall(self.template))

    def check(self, own: Collection[str], where: str) -> None:
        """Raise ConfigError for a field that a style sheet names and a table does not have."""
        for name in _absent(self.fields, own) if self.source else ():
            hint = nearest(name, own) or ": it has none"
            raise ConfigError(f"{self.source}: {where} has no field {name!r}{hint}")

    def text(self, properties: Mapping[str, Any]) -> str:
        """Return one feature's label; "" if all of its values are empty."""
        values = {name: shown_value(properties.get(name)) for name in self.fields}
        if not any(values.values()):
            return ""
        text = _FIELD.sub(lambda field: values[field[1]], self.template)
        # On one line, without characters that no font has: control codes, single surrogates.
        return _RUBBISH.sub(" ", text).strip().encode("utf-8", "ignore").decode()


@dataclass(frozen=True, slots=True)
class _Comparison:
    field: str
    sign: str
    values: tuple[str, ...]  # as written: a number in quotes is a text

    def holds(self, value: Any) -> bool:
        if self.sign in _ORDER:
            number, bound = _number(value), _number(self.values[0])
            return number is not None and bound is not None and _ORDER[self.sign](number, bound)
        number, text = _number(value), shown_value(value)
        # Numbers are compared as numbers, all else as texts.
        matches = any(
            text == _unquoted(each) if None in (number, _number(each)) else number == _number(each)
            for each in self.values
        )
        return matches != (self.sign == "!=")


@dataclass(frozen=True, slots=True)
class Condition:
    """Hold comparisons that must all be true.

    A property that a feature does not have counts as an empty text: ``!=`` is true for it, the
    others are false. ``<`` and the like are true only for numbers, and for texts that are numbers.
    """

    comparisons: tuple[_Comparison, ...]
    source: str  # sheet, layer and key, which begin every message

    @classmethod
    def parsed(cls, text: str, source: str) -> Condition:
        """Return the condition of a text.

        Raises ConfigError, beginning with ``source``, if invalid.
        """
        if len(text) > _LONGEST:
            raise ConfigError(f"{source}: longer than {_LONGEST} characters; shorten it")
        comparisons, at, more = [], 0, "and"
        while more:
            match = _COMPARISON.match(text, at)
            if match is None or (match["sign"] in _ORDER and _number(match["value"]) is None):
                raise ConfigError(
                    f"{source}: {text!r} is not a condition; write it as: kind == hydrant, "
                    "flow >= 60 and kind in [pump, well]"
                )
            written = tuple(re.findall(_VALUE, match["value"] or match["values"]))
            field = _unquoted(match["field"])
            comparisons.append(_Comparison(field, match["sign"] or "in", written))
            at, more = match.end(), match["more"]
        return cls(tuple(comparisons), source)

    @property
    def fields(self) -> tuple[str, ...]:
        """Return the property of each comparison."""
        return tuple(each.field for each in self.comparisons)

    def holds(self, properties: Mapping[str, Any]) -> bool:
        """Return whether a feature with these properties meets the condition."""
        return all(each.holds(properties.get(each.field)) for each in self.comparisons)

    def unknown(self, own: Collection[str], where: str) -> Iterator[str]:
        """Yield a message for each field that a table does not have."""
        for name in _absent(self.fields, own):
            hint = nearest(name, own) or ": it has none"
            yield f"{self.source}: {where} has no property {name!r}{hint}"

    def unmet(self, rows: Sequence[Mapping[str, Any]], where: str) -> str:
        """Return the message that no row matches, with the values that the rows have."""
        values = [
            f"{name} is {', '.join(sorted({shown_value(row.get(name)) for row in rows} - {''}))}"
            for name in dict.fromkeys(self.fields)
        ]
        return f"{self.source}: no feature of {where} matches: {'; '.join(values)}"[:_LONGEST]


@dataclass(frozen=True, slots=True)
class Wanted:
    """Hold the label rule of a layer's features, and the condition for drawing them."""

    label: LabelRule = LabelRule()
    condition: Condition | None = None  # None: all are drawn

    @property
    def fields(self) -> tuple[str, ...]:
        """Return the properties to read."""
        return self.label.fields + (self.condition.fields if self.condition else ())


def _unquoted(text: str) -> str:
    return text[1:-1] if text[0] in "\"'" else text


def _number(value: Any) -> float | None:
    """Return a value or text as a number, true and false as 1 and 0; None if it is not one."""
    if isinstance(value, str) and value.lower() in {"true", "false"}:
        return float(value.lower() == "true")
    if not isinstance(value, int | float | str) or "_" in str(value):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return None if math.isnan(number) else number


def own_names(fields: Iterable[str], own: Collection[str]) -> dict[str, str]:
    """Return field -> the table's own name, perhaps in another case, of those that it has."""
    lower = {name.lower(): name for name in reversed(list(own))}
    names = {name: name if name in own else lower.get(name.lower()) for name in fields}
    return {field: name for field, name in names.items() if name is not None}


def _absent(fields: Sequence[str], own: Collection[str]) -> list[str]:
    present = own_names(fields, own)
    return [name for name in fields if name not in present]


def shown_value(value: Any) -> str:
    """Return a property's value as text; "" for None, nan and bytes."""
    if value is None or isinstance(value, bytes | bytearray):
        return ""
    if isinstance(value, float):
        # Tables keep whole numbers as floats, and an absent number as nan.
        return "" if value != value else f"{value:.15g}"  # noqa: PLR0124  nan alone
    return str(value).strip()


@dataclass(frozen=True, slots=True)
class SheetLayer:
    """Hold one entry of a style sheet."""

    where: str  # sheet and layer, which begin every message
    file: Path | None  # None: the files of the parameter map
    layer: str  # table or folder; "" is all
    style: LayerStyle
    label: LabelRule | None  # None: the property of the parameter label_field
    crs: str  # "": that of the file
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
    layers = root.get("layers") if isinstance(root, Mapping) else None
    if not isinstance(layers, list):
        raise ConfigError(f"{path}: not a style sheet: it needs a list under layers:")
    _check_keys(root, ("layers",), str(path))
    if not layers:
        raise ConfigError(f"{path}: the list of layers is empty")
    if len(layers) > _MOST_LAYERS:
        raise ConfigError(f"{path}: {len(layers)} layers, more than the {_MOST_LAYERS} allowed")
    return [
        _layer(entry, f"{path}: layer {number}", Path(path).parent)
        for number, entry in enumerate(layers, 1)
    ]


def _layer(entry: Any, where: str, folder: Path) -> SheetLayer:
    if not isinstance(entry, Mapping):
        raise ConfigError(f"{where}: is not a mapping of keys such as file: and colour:")
    _check_keys(entry, _KEYS, where)
    values = {
        each.name: _plain(entry[each.name], each, where) for each in _PLAIN if each.name in entry
    }
    if "fill_opacity" in entry and "fill" not in entry:
        raise ConfigError(f"{where}: fill_opacity without fill: give fill a colour")
    style = LayerStyle(
        line_bgr=_colour(entry, "colour", where) if "colour" in entry else _DEFAULT.line_bgr,
        width_px=values.get("width", _DEFAULT.width_px),
        fill_bgr=_colour(entry, "fill", where) if "fill" in entry else None,
        fill_opacity=values.get("fill_opacity", _DEFAULT.fill_opacity),
        labels=entry.get("label") is not False,
        scale_m_px=_scale(entry["scale"], where) if "scale" in entry else _DEFAULT.scale_m_px,
    )
    label = condition = None
    if entry.get("label") is False:
        label = LabelRule()
    elif "label" in entry:
        text = _words(entry["label"], f"{where}: label", "neither a field nor false")
        label = LabelRule.parsed(text, f"{where}: label")
    if "where" in entry:
        text = _words(entry["where"], f"{where}: where", "not a condition such as kind == hydrant")
        condition = Condition.parsed(text, f"{where}: where")
    file = folder / values["file"] if "file" in values else None
    crs, crs_file = _crs(entry["crs"], where, folder) if "crs" in entry else ("", None)
    layer, sigma_m = values.get("layer", ""), values.get("sigma")
    return SheetLayer(where, file, layer, style, label, crs, crs_file, sigma_m, condition)


def _check_keys(entry: Mapping[Any, Any], keys: tuple[str, ...], where: str) -> None:
    for key in entry:
        if key not in keys:
            raise ConfigError(f"{where}: unknown key {key}{nearest(str(key), sorted(keys))}")


def _plain(value: Any, parameter: Parameter, where: str) -> Any:
    if value is None or value == "":
        raise ConfigError(f"{where}: {parameter.name} has no value")
    if (
        isinstance(parameter.default, str)
        and isinstance(value, int)
        and not isinstance(value, bool)
    ):
        value = str(value)  # a table's name may look like a number
    try:
        checked = parameter.checked(value)
    except ConfigError as error:
        raise ConfigError(f"{where}: {str(error).removeprefix('parameter ')}") from None
    if isinstance(checked, float) and math.isnan(checked):
        raise ConfigError(f"{where}: {parameter.name}: {value} is not a number")
    return checked


def _colour(entry: Mapping[str, Any], key: str, where: str) -> Colour:
    value = entry[key]
    if value is None:
        raise ConfigError(f'{where}: {key} has no value; a colour with # needs quotes: "#ffd000"')
    try:
        rgb: tuple[int, ...] = ImageColor.getrgb(value)
        red, green, blue = rgb
        bytes((red, green, blue))  # ValueError beyond 255
    except (ValueError, TypeError, AttributeError):
        raise ConfigError(
            f'{where}: {key}: {value!r} is not a colour; give a name (red) or "#rrggbb"'
        ) from None
    return blue, green, red


def _scale(value: Any, where: str) -> tuple[float, float]:
    try:
        low, high = map(float, value)
        if isinstance(value, list) and 0 <= low < high:
            return low, high
    except (TypeError, ValueError):
        pass
    raise ConfigError(
        f"{where}: scale: {value!r} must be two numbers, the smaller first, in metres per pixel"
    )


def _words(value: Any, where: str, wanted: str) -> str:
    """Return a text; raise ConfigError for anything else, or a blank one."""
    if not isinstance(value, str) or not value.strip():
        raise ConfigError(f"{where}: {value!r} is {wanted}")
    return value


def _crs(value: Any, where: str, folder: Path) -> tuple[str, Path | None]:
    """Return the text of a coordinate system, and the file that it comes from."""
    if isinstance(value, int) and not isinstance(value, bool):
        value = f"EPSG:{value}"
    text = _words(value, f"{where}: crs", "not an EPSG code, WKT, PROJ string or .prj file")
    file = folder / text if text.lower().endswith((".prj", ".wkt")) else None
    try:
        if file:
            _check_file(file, str(file))
            text = read_text(file, ConfigError, damaged=True)
        checked_system(text, f"{where}: crs")
    except ConfigError as error:
        raise ConfigError(f"{where}: crs: {error}") from None
    except MapError as error:
        raise ConfigError(str(error).partition(";")[0]) from None
    return text, file


def _check_file(path: Path, where: str) -> None:
    """Raise ConfigError for a folder, pipe or device: a node that reads one may block."""
    if path.exists() and not path.is_file():
        raise ConfigError(f"{where}: is not a file")

"""Label features by their properties, and choose them by conditions on these.

A label is the value of a property, or a text with several: ``{name} {ref}``. A condition is such
as ``kind == hydrant and flow >= 60``:

    condition = comparison {"and" comparison}
    comparison = property ("==" | "!=" | "<" | "<=" | ">" | ">=") value
               | property "in" "[" value {"," value} "]"

A property and a value are a word, a number, or a text in quotes. Nothing else is evaluated.
"""

from __future__ import annotations

import math
import operator
import re
import string
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tirgeo_ros.core.types.errors import ConfigError, nearest

_RUBBISH = re.compile(r"[\x00-\x20\x7f-\xa0\u2028\u2029]+")
_LONGEST = 1000  # characters of a condition, and of the message that nothing meets it
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


@dataclass(frozen=True, slots=True)
class LabelRule:
    """Make a label of properties' values between texts; ``texts`` has one more than ``fields``.

    A field that a table lacks is looked for with another case. If it is not found either, it is
    empty; if ``source`` (a style sheet) requires it, that is an error.
    """

    fields: tuple[str, ...] = ()
    texts: tuple[str, ...] = ("",)
    source: str = ""

    @classmethod
    def of_field(cls, name: str) -> LabelRule:
        """Return the rule that takes one property unchanged; without a name, no label."""
        return cls((name,), ("", "")) if name else cls()

    @classmethod
    def parsed(cls, text: str, source: str) -> LabelRule:
        """Return the rule of a field's name or of a template like ``{name} {ref}``.

        Raises ConfigError, beginning with ``source``, for an invalid template.
        """
        if "{" not in text and "}" not in text:
            return cls((text,), ("", ""), source)
        fields: list[str] = []
        texts = [""]
        try:
            for literal, name, form, conversion in string.Formatter().parse(text):
                texts[-1] += literal
                if name is None:
                    continue
                if not name or form or conversion:
                    raise ValueError("put the name of a field between the braces")  # noqa: TRY301
                fields.append(name)
                texts.append("")
        except ValueError as error:
            raise ConfigError(f"{source}: {text!r} is not a label: {error}") from None
        return cls(tuple(fields), tuple(texts), source)

    def columns(self, known: Collection[str], where: str) -> tuple[str | None, ...]:
        """Return the table's own name of each field, None where it has none.

        Raises ConfigError for an unknown field that a style sheet names.
        """
        found = table_names(self.fields, known)
        for name, column in zip(self.fields, found, strict=True):
            if column is None and self.source:
                hint = nearest(name, known) or ": it has none"
                raise ConfigError(f"{self.source}: {where} has no field {name!r}{hint}")
        return found

    def text(self, columns: Sequence[str | None], properties: Mapping[str, Any]) -> str:
        """Return one feature's label; "" if all of its values are empty."""
        values = [shown_value(properties.get(name)) if name else "" for name in columns]
        if not any(values):
            return ""
        ends = zip(values, self.texts[1:], strict=True)
        text = self.texts[0] + "".join(value + text for value, text in ends)
        # On one line, without what no font shows: control codes, halves of surrogate pairs.
        return _RUBBISH.sub(" ", text).strip().encode("utf-8", "ignore").decode()


@dataclass(frozen=True, slots=True)
class _Comparison:
    field: str
    sign: str
    values: tuple[str, ...]  # as written: quotes make a text of a number

    def holds(self, value: Any) -> bool:
        if self.sign in _ORDER:
            number, bound = _number(value), _number(self.values[0])
            return number is not None and bound is not None and _ORDER[self.sign](number, bound)
        return any(_equal(value, each) for each in self.values) != (self.sign == "!=")


@dataclass(frozen=True, slots=True)
class Condition:
    """Hold comparisons that must all be true.

    A property that a feature does not have counts as an empty text: ``!=`` is true for it, the
    others are false. ``<`` and the like are true only for numbers, and for texts that are numbers.
    """

    comparisons: tuple[_Comparison, ...]
    source: str  # begins every message about it

    @classmethod
    def parsed(cls, text: str, source: str) -> Condition:
        """Return the condition of a text.

        Raises ConfigError, beginning with ``source``, if invalid.
        """
        if len(text) > _LONGEST:
            raise ConfigError(f"{source}: longer than {_LONGEST} characters")
        found = list(_comparisons(text))
        if not all(found):
            raise ConfigError(
                f"{source}: {text!r} is no condition; write it as: kind == hydrant, "
                "flow >= 60 and kind in [pump, well]"
            )
        return cls(tuple(filter(None, found)), source)

    @property
    def fields(self) -> tuple[str, ...]:
        """Return the property of each comparison."""
        return tuple(each.field for each in self.comparisons)

    def columns(self, known: Collection[str]) -> tuple[str | None, ...]:
        """Return the table's own name of each field, None where it has none."""
        return table_names(self.fields, known)

    def holds(self, columns: Sequence[str | None], properties: Mapping[str, Any]) -> bool:
        """Return whether a feature with these properties meets the condition."""
        return all(
            each.holds(properties.get(name) if name else None)
            for each, name in zip(self.comparisons, columns, strict=True)
        )

    def unknown(self, known: Collection[str], where: str) -> Iterator[str]:
        """Yield a message for each field that a table does not have."""
        for name, column in zip(self.fields, self.columns(known), strict=True):
            if column is None:
                hint = nearest(name, known) or ": it has none"
                yield f"{self.source}: {where} has no property {name!r}{hint}"

    def unmet(self, known: Collection[str], rows: Sequence[Mapping[str, Any]], where: str) -> str:
        """Return a message for the case that no row matches: the values that there are."""
        found = [
            f"{name} is {', '.join(sorted({shown_value(row.get(name)) for row in rows} - {''}))}"
            for name in dict.fromkeys(filter(None, self.columns(known)))
        ]
        return f"{self.source}: no feature of {where} matches: {'; '.join(found)}"[:_LONGEST]


@dataclass(frozen=True, slots=True)
class Wanted:
    """Hold the label rule of a layer's features, and the condition for drawing them."""

    label: LabelRule = LabelRule()
    condition: Condition | None = None  # None: all are drawn

    def columns(self, known: Collection[str], where: str) -> list[str]:
        """Return the table's own names of the properties to read, each once.

        Raises ConfigError for an unknown one that a style sheet wants as a label.
        """
        names = self.label.columns(known, where)
        if self.condition:
            names += self.condition.columns(known)
        return [name for name in dict.fromkeys(names) if name is not None]


def _comparisons(text: str) -> Iterator[_Comparison | None]:
    """Yield the comparisons of a text; None where it is none."""
    at, more = 0, "and"
    while more:
        found = _COMPARISON.match(text, at)
        if found is None:
            yield None
            return
        field, sign, value, values, more = found.group("field", "sign", "value", "values", "more")
        ordered = sign in _ORDER and _number(value) is None
        written = tuple(re.findall(_VALUE, value or values))
        yield None if ordered else _Comparison(_unquoted(field), sign or "in", written)
        at = found.end()


def _unquoted(text: str) -> str:
    return text[1:-1] if text[0] in "\"'" else text


def _equal(value: Any, written: str) -> bool:
    """Return whether a property has a value, as numbers if both are."""
    number, other = _number(written), _number(value)
    if number is not None and other is not None:
        return number == other
    return shown_value(value) == _unquoted(written)


def _number(value: Any) -> float | None:
    """Return a number, or that of a text; 1 and 0 of true and false. None if it is none."""
    if isinstance(value, str) and value.lower() in {"true", "false"}:
        return float(value.lower() == "true")
    if not isinstance(value, int | float | str) or "_" in str(value):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return None if math.isnan(number) else number


def table_names(fields: Sequence[str], known: Collection[str]) -> tuple[str | None, ...]:
    """Return a table's own name of each field, in another case if necessary, else None."""
    lower = {name.lower(): name for name in reversed(list(known))}
    return tuple(name if name in known else lower.get(name.lower()) for name in fields)


def shown_value(value: Any) -> str:
    """Return the text of a property's value; "" for one that has none."""
    if value is None or isinstance(value, bytes | bytearray):
        return ""
    if isinstance(value, float):
        # Tables keep whole numbers as floats, and nan for an absent one.
        return "" if value != value else f"{value:.15g}"  # noqa: PLR0124  nan alone
    return str(value).strip()

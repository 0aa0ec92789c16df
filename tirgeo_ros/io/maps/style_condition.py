"""Parse and evaluate conditions on a feature's properties: ``kind == hydrant and flow >= 60``.

    condition = comparison {"and" comparison}
    comparison = property ("==" | "!=" | "<" | "<=" | ">" | ">=") value
               | property "in" "[" value {"," value} "]"

A property and a value are a word, a number, or a text in quotes. Nothing else is evaluated.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.maps.label_rule import LabelRule, shown_value, table_names
from tirgeo_ros.io.parameters.parameter_file import nearest

_LONGEST = 1000  # characters of a condition
_MOST_VALUES = 6  # of a property, shown where no feature matches
_TOKEN = re.compile(
    r"\s*(?:(?P<text>\"[^\"]*\"|'[^']*')|(?P<sign>[=!<>]=|[<>\[\],])"
    r"|(?P<word>[^\s\"'\[\],=!<>]+)|(?P<odd>\S))"
)
_ORDER: dict[str, Callable[[float, float], bool]] = {
    "<": operator.lt,
    "<=": operator.le,
    ">": operator.gt,
    ">=": operator.ge,
}


@dataclass(frozen=True, slots=True)
class _Value:
    """Hold a value as it is written, and its number if it is one without quotes."""

    text: str
    number: float | None

    def equals(self, value: Any) -> bool:
        number = None if self.number is None else _number(value)
        return _text(value) == self.text if number is None else number == self.number


@dataclass(frozen=True, slots=True)
class _Comparison:
    field: str
    sign: str
    values: tuple[_Value, ...]

    def holds(self, value: Any) -> bool:
        if self.sign in _ORDER:
            number, bound = _number(value), self.values[0].number
            return number is not None and bound is not None and _ORDER[self.sign](number, bound)
        return any(each.equals(value) for each in self.values) != (self.sign == "!=")


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
        try:
            return cls(tuple(_Tokens(text).comparisons()), source)
        except ValueError as error:
            raise ConfigError(
                f"{source}: {text!r} is no condition: {error}; write it as: kind == hydrant, "
                "flow >= 60 and kind in [pump, well]"
            ) from None

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
        found = []
        for name in dict.fromkeys(filter(None, self.columns(known))):
            values = sorted({_text(row.get(name))[:40] for row in rows} - {""})
            more = ", ..." if len(values) > _MOST_VALUES else ""
            found.append(f"{name} is {', '.join(values[:_MOST_VALUES])}{more}")
        told = f": {'; '.join(found)}" if found else ""
        return f"{self.source}: no feature of {where} is so{told}"


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


class _Tokens:
    """Parse the words and signs of a condition, one after the other."""

    def __init__(self, text: str) -> None:
        self._left = [(m.lastgroup or "", m[m.lastgroup or 0]) for m in _TOKEN.finditer(text)]

    def comparisons(self) -> Iterator[_Comparison]:
        yield self._comparison()
        while self._left:
            self._sign("and", "and")
            yield self._comparison()

    def _comparison(self) -> _Comparison:
        field = self._value("a property").text
        sign = self._sign("==, !=, <, <=, >, >= or in", "==", "!=", *_ORDER, "in")
        if sign == "in":
            self._sign("[", "[")
            values = [self._value("a value")]
            while self._sign(", or ]", ",", "]") == ",":
                values.append(self._value("a value"))
            return _Comparison(field, sign, tuple(values))
        value = self._value("a value")
        if sign in _ORDER and value.number is None:
            raise ValueError(f"{sign} needs a number, and {value.text} is none")
        return _Comparison(field, sign, (value,))

    def _sign(self, what: str, *signs: str) -> str:
        """Return the next token, which must be one of these signs or words."""
        kind, text = self._next(what)
        if kind == "text" or text not in signs:
            raise ValueError(f"{text} stands where {what} should")
        return text

    def _value(self, what: str) -> _Value:
        kind, text = self._next(what)
        if kind == "text":
            return _Value(text[1:-1], None)
        if kind != "word":
            raise ValueError(f"{text} stands where {what} should")
        return _Value(text, _number(text))

    def _next(self, what: str) -> tuple[str, str]:
        if not self._left:
            raise ValueError(f"it ends where {what} should stand")
        return self._left.pop(0)


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float | str) or "_" in str(value):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return None if number != number else number  # noqa: PLR0124  nan alone


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else shown_value(value)

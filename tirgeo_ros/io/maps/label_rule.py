"""Labels of features: the value of a property, or a text with several of them."""

from __future__ import annotations

import re
import string
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.parameters.suggestions import nearest

_RUBBISH = re.compile(r"[\x00-\x20\x7f-\xa0\u2028\u2029]+")


@dataclass(frozen=True, slots=True)
class LabelRule:
    """Texts between the values of properties: ``texts`` has one more than ``fields``.

    A field that a table lacks is looked for in other capitals; is it not there either, it is
    empty, or where ``source`` (a style sheet) has asked for it, an error.
    """

    fields: tuple[str, ...] = ()
    texts: tuple[str, ...] = ("",)
    source: str = ""

    @classmethod
    def of_field(cls, name: str) -> LabelRule:
        """The rule that takes one property as it is; of "", no label."""
        return cls((name,), ("", "")) if name else cls()

    @classmethod
    def parsed(cls, text: str, source: str) -> LabelRule:
        """The rule of a field's name or of a template like ``{name} {ref}``.

        Raises ConfigError, led by ``source``, for a template that is none.
        """
        if "{" not in text and "}" not in text:
            return cls((text,), ("", ""), source)
        try:
            pieces = list(string.Formatter().parse(text))
        except ValueError as error:
            raise ConfigError(f"{source}: {text!r} is no label: {error}") from None
        return cls._of_pieces(pieces, text, source)

    @classmethod
    def _of_pieces(
        cls, pieces: Sequence[tuple[str, str | None, str | None, str | None]], text: str, at: str
    ) -> LabelRule:
        fields: list[str] = []
        texts = [""]
        for literal, name, form, conversion in pieces:
            texts[-1] += literal
            if name is None:
                continue
            if not name or form or conversion:
                raise ConfigError(f"{at}: {text!r} is no label: between braces stands a field")
            fields.append(name)
            texts.append("")
        return cls(tuple(fields), tuple(texts), at)

    def columns(self, known: Collection[str], where: str) -> tuple[str | None, ...]:
        """The table's own name of each field, None where it has none.

        Raises ConfigError for an unknown one where a style sheet has named it.
        """
        found = table_names(self.fields, known)
        for name, column in zip(self.fields, found, strict=True):
            if column is None and self.source:
                hint = nearest(name, known) or ": it has none"
                raise ConfigError(f"{self.source}: {where} has no field {name!r}{hint}")
        return found

    def text(self, columns: Sequence[str | None], properties: Mapping[str, Any]) -> str:
        """One feature's label; "" where all of its values are empty."""
        values = [shown_value(properties.get(name)) if name else "" for name in columns]
        if not any(values):
            return ""
        ends = zip(values, self.texts[1:], strict=True)
        return _clean(self.texts[0] + "".join(value + text for value, text in ends))


def table_names(fields: Sequence[str], known: Collection[str]) -> tuple[str | None, ...]:
    """A table's own name of each field, in other capitals if need be; None where it has none."""
    lower = {name.lower(): name for name in reversed(list(known))}
    return tuple(name if name in known else lower.get(name.lower()) for name in fields)


def shown_value(value: Any) -> str:
    """The text of a property's value; "" of one that has none."""
    if value is None or isinstance(value, bytes | bytearray):
        return ""
    if isinstance(value, float):
        # Tables keep whole numbers as floats, and nan where there is none.
        return "" if value != value else f"{value:.15g}"  # noqa: PLR0124  nan alone
    return str(value).strip()


def _clean(text: str) -> str:
    """On one line, without what no font shows: line ends, control codes, halves of pairs."""
    return _RUBBISH.sub(" ", text).strip().encode("utf-8", "ignore").decode()

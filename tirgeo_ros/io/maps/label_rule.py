"""Make labels of features: the value of a property, or a text with several of them."""

from __future__ import annotations

import re
import string
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from tirgeo_ros.core.types.errors import ConfigError, nearest

_RUBBISH = re.compile(r"[\x00-\x20\x7f-\xa0\u2028\u2029]+")


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

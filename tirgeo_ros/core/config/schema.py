"""Parameters as frozen dataclasses: each default, unit and range stands once, in the field.

A tree of dataclasses is the parameter tree of a node: field ``imu`` of one that holds the field
``accel_bias_time_s`` of another is the parameter ``imu.accel_bias_time_s``.
"""

from __future__ import annotations

import dataclasses
import difflib
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar, cast, get_type_hints

from tirgeo_ros.core.types.errors import ConfigError

T = TypeVar("T")
Scalar = bool | int | float | str
Value = Scalar | tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter: its full dotted name and what a value must be."""

    name: str
    default: Value
    description: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    sizes: tuple[int, ...] = ()  # lengths that a list may have

    def checked(self, value: object) -> Value:
        """The value in this parameter's type; raises ConfigError naming the parameter."""
        if not isinstance(self.default, tuple):
            return self._checked_scalar(value, type(self.default))
        if isinstance(value, str | bytes) or not hasattr(value, "__iter__"):
            raise ConfigError(f"parameter {self.name}: {value!r} is not a list of numbers")
        numbers = tuple(float(self._checked_scalar(item, float)) for item in value)
        if len(numbers) not in self.sizes:
            few = self.sizes if len(self.sizes) < 5 else (*self.sizes[:3], "...", self.sizes[-1])
            wanted = " or ".join(map(str, few)).replace(" or ", ", ", max(len(few) - 2, 0))
            raise ConfigError(f"parameter {self.name}: needs {wanted} numbers, has {len(numbers)}")
        return numbers

    def _checked_scalar(self, value: object, kind: type) -> Scalar:
        right = type(value) is kind or (kind is float and type(value) is int)
        if not right or not isinstance(value, bool | int | float | str):
            raise ConfigError(
                f"parameter {self.name}: {value!r} is not of type {_KIND_NAMES[kind]}"
            )
        if self.choices and value not in self.choices:
            raise ConfigError(
                f"parameter {self.name}: {value!r} is not one of {', '.join(self.choices)}"
            )
        if kind in (int, float):
            self._check_range(float(value))
        return kind(value)  # type: ignore[no-any-return]

    def _check_range(self, value: float) -> None:
        if math.isinf(value):
            raise ConfigError(f"parameter {self.name}: {value:g} is not finite")
        unset = math.isnan(value) and isinstance(self.default, float) and math.isnan(self.default)
        if not unset and not self.low <= value <= self.high:
            raise ConfigError(
                f"parameter {self.name}: {value:g} {self.unit}".rstrip()
                + f" is outside {self.low:g} to {self.high:g}"
            )


_KIND_NAMES = {bool: "bool", int: "int", float: "double", str: "string"}


def param(
    default: Value,
    description: str,
    within: tuple[str, float, float] | None = None,
    *,
    unit: str = "",
    low: float = -math.inf,
    high: float = math.inf,
    choices: tuple[str, ...] = (),
    sizes: tuple[int, ...] = (),
) -> Any:
    """A dataclass field that is a parameter.

    ``within`` is its unit, least and largest value in one; ``sizes`` are the lengths a list may
    have.
    """
    unit, low, high = within or (unit, low, high)
    if isinstance(default, tuple) and not sizes:
        sizes = (len(default),)
    made = Parameter("", default, description, unit, low, high, choices, sizes)
    return dataclasses.field(default=default, metadata={"parameter": made})


def group(kind: type[T]) -> T:
    """A dataclass field that is a group of parameters."""
    return dataclasses.field(default_factory=kind)


@cache
def _hints(kind: type) -> dict[str, Any]:
    """Annotations are texts until they are looked up, which takes long and is asked for often."""
    return get_type_hints(kind)


@cache
def parameters_of(kind: type) -> tuple[Parameter, ...]:
    """Every parameter of a tree of dataclasses, with its full name."""
    return tuple(_parameters(kind, ""))


def _parameters(kind: type, prefix: str) -> Iterator[Parameter]:
    hints = _hints(kind)
    for item in dataclasses.fields(kind):
        name = prefix + item.name
        if "parameter" in item.metadata:
            yield dataclasses.replace(item.metadata["parameter"], name=name)
        else:
            yield from _parameters(hints[item.name], name + ".")


def config_from(kind: type[T], values: Mapping[str, object], where: str = "") -> T:
    """The dataclass tree ``kind`` with the dotted ``values`` in it, the rest at their defaults.

    Raises ConfigError for an unknown name, a wrong type or a value out of range; ``where`` (a
    file, a node) begins the message. An attribute ``renamed`` of ``kind`` says of old names what
    to write instead.
    """
    known = {parameter.name: parameter for parameter in parameters_of(cast("type", kind))}
    lead = f"{where}: " if where else ""
    checked: dict[str, Value] = {}
    for name, value in values.items():
        if name not in known:
            raise ConfigError(lead + _unknown(name, known, getattr(kind, "renamed", {})))
        try:
            checked[name] = known[name].checked(value)
        except ConfigError as error:
            raise ConfigError(f"{lead}{error}") from None
    return _build(kind, checked, "")


def _unknown(name: str, known: Mapping[str, Parameter], renamed: Mapping[str, str]) -> str:
    if name in renamed:
        return f"parameter {name} {renamed[name]}"
    near = difflib.get_close_matches(name, known, n=1)
    hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"
    return f"unknown parameter {name} ({hint})"


def _build(kind: type[T], values: Mapping[str, Value], prefix: str) -> T:
    hints = _hints(cast("type", kind))
    arguments: dict[str, object] = {}
    for item in dataclasses.fields(kind):  # type: ignore[arg-type]
        name = prefix + item.name
        if "parameter" not in item.metadata:
            arguments[item.name] = _build(hints[item.name], values, name + ".")
        elif name in values:
            arguments[item.name] = values[name]
    return kind(**arguments)


def values_of(config: object, prefix: str = "") -> dict[str, Value]:
    """The dotted values of a tree of dataclasses: what ``config_from`` takes."""
    found: dict[str, Value] = {}
    for item in dataclasses.fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        if "parameter" in item.metadata:
            found[prefix + item.name] = value
        else:
            found.update(values_of(value, prefix + item.name + "."))
    return found

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
"""Define parameters as frozen dataclasses; each default, unit and range is written in its field.

A tree of dataclasses is the parameter tree of a node: if its field ``imu`` is a dataclass with
the field ``accel_bias_time_s``, the parameter is named ``imu.accel_bias_time_s``.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar, cast, get_type_hints

from tirgeo_ros.core.types.errors import ConfigError, nearest

T = TypeVar("T")
Value = bool | int | float | str | tuple[float, ...]

HIDDEN = "***"  # shown in place of a secret
_KIND_NAMES = {bool: "bool", int: "int", float: "double", str: "string"}
_ONCE = ", set once for all nodes under /**"
_DIRECTION = (
    f"is now the direction from aircraft.rtk_antenna_m to aircraft.second_antenna_m{_ONCE}"
)
_PLAYED = ("geoid_undulation_m", "gimbal", "clock_start_ms", "clock_drift_ppm", "pushes")
#: Old name of a parameter -> what the error message says after it.
RENAMED: Mapping[str, str] = {
    "rtk.lever_arm_m": f"is now aircraft.rtk_antenna_m{_ONCE}",
    "gps.lever_arm_m": f"is now aircraft.gps_antenna_m{_ONCE}",
    "lever_arm_m": f"is now aircraft.gimbal_pivot_m{_ONCE}",
    "camera_offset_m": f"is now aircraft.camera_from_pivot_m{_ONCE}",
    "heading.offset_deg": _DIRECTION,
    "heading.baseline_m": _DIRECTION,
    "heading.baseline_offset_deg": _DIRECTION,
    "aircraft.baseline_offset_deg": _DIRECTION,
    **{f"aircraft.{name}": f"is now simulated_aircraft.{name}" for name in _PLAYED},
}
#: Why a parameter cannot be set in flight; True: for the parameters ``aircraft.*``.
_WHY_NOT = {
    False: "is read only at start: set it in the parameter file and restart the node",
    True: "is measured before flight, and must be the same in all nodes: set it in the parameter "
    "file and restart all nodes",
}


@dataclass(frozen=True, slots=True)
class Parameter:
    """Hold one parameter: its full dotted name, its default and the values that it may have."""

    name: str
    default: Value
    description: str
    unit: str = ""
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()
    sizes: tuple[int, ...] = ()  # lengths that a list may have
    fault: Callable[[str], str] | None = None  # returns what is wrong with a text, or ""
    live: bool | None = None  # whether it can be set in flight; None: as its group
    secret: bool = False  # shown as HIDDEN, unless it is the default

    def checked(self, value: object) -> Value:
        """Return the value in this parameter's type; raise ConfigError naming the parameter."""
        if not isinstance(self.default, tuple):
            return self._checked_scalar(value, type(self.default))
        if isinstance(value, str | bytes) or not hasattr(value, "__iter__"):
            raise self._error(f"{value!r} is not a list of numbers")
        numbers = tuple(cast("float", self._checked_scalar(item, float)) for item in value)
        if len(numbers) not in self.sizes:
            few = self.sizes if len(self.sizes) < 5 else (*self.sizes[:3], "...", self.sizes[-1])
            wanted = " or ".join(map(str, few)).replace(" or ", ", ", max(len(few) - 2, 0))
            raise self._error(f"needs {wanted} numbers, has {len(numbers)}")
        return numbers

    def _checked_scalar(self, value: object, kind: Any) -> bool | int | float | str:
        if type(value) is not kind and not (kind is float and type(value) is int):
            raise self._error(f"{value!r} is not of type {_KIND_NAMES[kind]}")
        if self.choices and value not in self.choices:
            raise self._error(f"{value!r} is not one of {', '.join(self.choices)}")
        if kind is str and "\0" in cast("str", value):
            raise self._error(f"{value!r} has a NUL character: remove it")
        if self.secret and value == HIDDEN:
            raise self._error(
                f"{HIDDEN} only hides a secret: write the secret itself, or set {self.name}_file"
            )
        fault = self.fault(cast("str", value)) if self.fault else ""
        if fault:
            raise self._error(f"{HIDDEN if self.secret else repr(value)} {fault}")
        if kind in (int, float):
            number = float(cast("float", value))
            if math.isinf(number):
                raise self._error(f"{number:g} is not finite")
            unset = math.isnan(number) and self.default != self.default  # nan stands for unset
            if not unset and not self.low <= number <= self.high:
                unit = f" {self.unit}" if self.unit else ""
                raise self._error(f"{number:g}{unit} is outside {self.low:g} to {self.high:g}")
        return cast("bool | int | float | str", kind(value))

    def _error(self, text: str) -> ConfigError:
        return ConfigError(f"parameter {self.name}: {text}")


def param(
    default: Value,
    description: str,
    within: tuple[str, float, float] = ("", -math.inf, math.inf),
    *,
    choices: tuple[str, ...] = (),
    sizes: tuple[int, ...] = (),
    fault: Callable[[str], str] | None = None,
    live: bool | None = None,
    secret: bool = False,
) -> Any:
    """Return a dataclass field that is a parameter.

    ``within`` is its unit, least and largest value. ``sizes`` are the lengths that a list may
    have, by default that of ``default``. ``fault`` returns what is wrong with a text, or "".
    ``live`` is whether it can be set in flight, by default as its group. A ``secret`` is hidden.
    """
    if isinstance(default, tuple) and not sizes:
        sizes = (len(default),)
    parameter = Parameter("", default, description, *within, choices, sizes, fault, live, secret)
    return dataclasses.field(default=default, metadata={"parameter": parameter})


def group(kind: type[T], *, live: bool = False) -> T:
    """Return a dataclass field that is a group of parameters; ``live``: settable in flight."""
    return dataclasses.field(default_factory=kind, metadata={"live": live})


@cache
def _hints(kind: Any) -> dict[str, Any]:
    return get_type_hints(kind)  # slow: it evaluates the annotations, which are texts


@cache
def parameters_of(kind: type) -> tuple[Parameter, ...]:
    """Return every parameter of a tree of dataclasses, with its full name."""
    return tuple(_parameters(kind, "", live=False))


def _parameters(kind: type, prefix: str, *, live: bool) -> Iterator[Parameter]:
    for item in dataclasses.fields(kind):
        name = prefix + item.name
        if "parameter" in item.metadata:
            own = item.metadata["parameter"].live
            named = {"name": name, "live": live if own is None else own}
            yield dataclasses.replace(item.metadata["parameter"], **named)
        else:
            inner = _hints(kind)[item.name]
            yield from _parameters(inner, name + ".", live=item.metadata["live"])


def config_from(kind: type[T], values: Mapping[str, object], where: str = "") -> T:
    """Return the dataclass tree ``kind`` with the dotted ``values``, the rest at their defaults.

    Raise ConfigError for an unknown name, a wrong type or a value out of range; ``where`` (a file,
    a node) begins the message. For an old name the message gives the new one, from
    ``kind.renamed`` or else RENAMED.
    """
    by_name = {parameter.name: parameter for parameter in parameters_of(cast("type", kind))}
    renamed: Mapping[str, str] = getattr(kind, "renamed", RENAMED)
    checked: dict[str, Value] = {}
    try:
        for name, value in values.items():
            checked[name] = _named(name, by_name, renamed).checked(value)
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}" if where else str(error)) from None
    return _build(kind, checked, "")


def _named(name: str, by_name: Mapping[str, Parameter], renamed: Mapping[str, str]) -> Parameter:
    if name in by_name:
        return by_name[name]
    if name in renamed:
        raise ConfigError(f"parameter {name} {renamed[name]}")
    raise ConfigError(f"unknown parameter {name}{nearest(name, by_name)}")


def _build(kind: type[T], values: Mapping[str, Value], prefix: str) -> T:
    arguments: dict[str, object] = {}
    fields: Any = kind
    for item in dataclasses.fields(fields):
        name = prefix + item.name
        if "parameter" not in item.metadata:
            arguments[item.name] = _build(_hints(fields)[item.name], values, name + ".")
        elif name in values:
            arguments[item.name] = values[name]
    return kind(**arguments)


def values_of(config: object, prefix: str = "") -> dict[str, Value]:
    """Return the dotted values of a tree of dataclasses, as ``config_from`` takes them."""
    values: dict[str, Value] = {}
    for item in dataclasses.fields(config):  # type: ignore[arg-type]
        value = getattr(config, item.name)
        if "parameter" in item.metadata:
            values[prefix + item.name] = value
        else:
            values |= values_of(value, f"{prefix}{item.name}.")
    return values


def changed_in_flight(config: T, values: Mapping[str, object]) -> T:
    """Return ``config`` with the dotted ``values`` changed, checked as at start.

    Raise ConfigError as ``config_from`` does, and if the value of a parameter changes that is read
    only at start.
    """
    kind = type(config)
    new = config_from(kind, values_of(config) | dict(values))
    live = {parameter.name for parameter in parameters_of(cast("type", kind)) if parameter.live}
    for name in changes(config, new).keys() - live:
        raise ConfigError(f"parameter {name} {_WHY_NOT[name.startswith('aircraft.')]}")
    return new


def changes(config: object, new: object) -> dict[str, tuple[Value, Value]]:
    """Return the parameters that differ between two trees of one kind: name -> old, new value."""
    both = zip(values_of(config).items(), values_of(new).values(), strict=True)
    return {name: (old, now) for (name, old), now in both if repr(old) != repr(now)}  # nan is nan

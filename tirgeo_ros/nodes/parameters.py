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
"""Check a node's command line and files; declare the dataclasses as ROS parameters; set them.

rcl's errors are rewritten, because they name neither the key nor a remedy.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import Any, Generic, TypeVar

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import (
    HIDDEN,
    Parameter,
    changed_in_flight,
    changes,
    config_from,
    parameters_of,
    values_of,
)
from tirgeo_ros.core.types.errors import ConfigError, TirgeoError
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.io.parameters.parameter_file import ParameterFile, overridden_topic

T = TypeVar("T")
_Set = Callable[[list[RosParameter]], SetParametersResult]
#: Errors of wrong arguments. rcl's own cannot be imported from the public API.
_RCL_ERRORS = {"RCLError", "UnknownROSArgsError", "RCLInvalidROSArgsError"}
_ROS_OWN = {"use_sim_time", "start_type_description_service"}  # rclpy checks these itself


def parameter_files(arguments: Sequence[str]) -> list[str]:
    """Return the parameter files of a command line, in order, without those in memory."""
    files = [path for option, path in pairwise(arguments) if option == "--params-file"]
    return [path for path in files if not path.startswith("/proc/")]


def check_arguments(name: str, arguments: Sequence[str]) -> None:
    """Check each parameter file before rcl does; raise ConfigError that names file and key."""
    # Of several rules for one name the first applies.
    rules = [a for a in reversed(arguments) if a.startswith(("__node:=", "__ns:="))]
    named = dict(rule.split(":=", 1) for rule in rules)
    name, namespace = named.get("__node", name), named.get("__ns", "")
    for path in parameter_files(arguments) if name in NODE_CONFIGS else ():
        for key, value in ParameterFile(path).values(name, namespace).items():
            if isinstance(value, list) and len({type(item) for item in value}) > 1:
                raise ConfigError(
                    f"{path}: parameter {key}: ROS takes lists of one type only: "
                    f"write all of {value} with a decimal point"
                )


@contextmanager
def explained(arguments: Sequence[str]) -> Iterator[None]:
    """Convert what rclpy raises for wrong arguments and parameters into a ConfigError."""
    try:
        yield
    except Exception as error:
        is_ros = isinstance(error, ParameterException | NameValidationException)
        if not is_ros and type(error).__name__ not in _RCL_ERRORS:
            raise
        files = ", ".join(parameter_files(arguments))
        # The position in rcl's C source does not help the user.
        text = re.sub(r", at \S+:\d+", "", " ".join(str(error).split()))
        if "Sequence should be of same type" in text:
            text += ": write every number of a list with a decimal point"
        raise ConfigError(f"{files}: {text}" if files else text) from None


def declare(node: Node, kind: type[T]) -> T:
    """Declare every parameter of ``kind`` on the node, and return their values.

    Parameters that are not live are read-only. Raise ConfigError, which names key and parameter
    file, for an unknown name, a wrong type or a value out of range. A whole number for a double is
    converted.
    """
    config = config_from(kind, _overrides_of(node, kind), ", ".join(parameter_files(sys.argv)))
    values = values_of(config)
    for parameter in parameters_of(kind):
        value = values[parameter.name]
        if value == ():
            _declare_empty(node, parameter)
        else:
            if parameter.secret and value != parameter.default:
                value = HIDDEN
            default = list(value) if isinstance(value, tuple) else value
            node.declare_parameter(
                parameter.name, default, _descriptor(parameter), ignore_override=True
            )
    return config


def _declare_empty(node: Node, parameter: Parameter) -> None:
    """Declare an empty list of numbers, of which rclpy cannot infer the type.

    Declare it by its type, set it, then set its descriptor: if one parameter has no value, rclpy
    answers a request for many parameters with an empty list.
    """
    kind = RosParameter.Type.DOUBLE_ARRAY
    node.declare_parameter(parameter.name, kind, ignore_override=True)
    node.set_parameters([RosParameter(parameter.name, kind, [])])
    descriptor = _descriptor(parameter)
    descriptor.type = kind.value
    node.set_descriptor(parameter.name, descriptor)


def given_names(node: Node, kind: type) -> frozenset[str]:
    """Return the names of those parameters of ``kind`` that a file or the command line sets."""
    own = {parameter.name for parameter in parameters_of(kind)}
    return frozenset(own.intersection(_overrides_of(node, kind)))


def _overrides_of(node: Node, kind: type) -> dict[str, object]:
    """Return the values from files and command line, without those that belong to other nodes."""
    # rclpy has no public access to overrides that are not declared yet.
    overrides: Mapping[str, RosParameter] = node._parameter_overrides  # noqa: SLF001  rclpy gives them nowhere else
    own = {parameter.name: parameter for parameter in parameters_of(kind)}
    lists = {name for name, parameter in own.items() if isinstance(parameter.default, tuple)}
    others = {p.name for kind in NODE_CONFIGS.values() for p in parameters_of(kind)} | _ROS_OWN
    return {
        # rcl reads an empty list as None.
        name: () if override.value is None and name in lists else override.value
        for name, override in overrides.items()
        if name in own or not (name in others or overridden_topic(name))
    }


def idle_overrides(node: Node) -> list[str]:
    """Return the QoS overrides of topics that neither this node nor tirgeo's contract has."""
    names = [name for name in node._parameter_overrides if not node.has_parameter(name)]  # noqa: SLF001  rclpy gives them nowhere else
    # The first topic of the contract stands in for a name that is no QoS override.
    contract = tuple(f"/{topic.strip('/')}" for topic in TOPIC_TYPES)
    return [
        name for name in names if not (overridden_topic(name) or contract[0]).endswith(contract)
    ]


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(name=parameter.name, read_only=not parameter.live)
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    descriptor.description = parameter.description + unit
    low, high, default = parameter.low, parameter.high, parameter.default
    sizes = " or ".join(map(str, parameter.sizes))
    texts = {
        f"one of {', '.join(parameter.choices)}": parameter.choices,
        f"{sizes} numbers": parameter.sizes,
        f"{low:g} to {high:g}": math.isfinite(low),
    }
    constraints = [text for text, applies in texts.items() if applies]
    descriptor.additional_constraints = ", ".join(constraints)
    if type(default) is int and math.isfinite(low):
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    # A range would refuse nan, which marks an unset value.
    if isinstance(default, float) and math.isfinite(low) and not math.isnan(default):
        span = FloatingPointRange(from_value=float(low), to_value=float(high))
        descriptor.floating_point_range = [span]
    return descriptor


def unchanging(_config: Any) -> None:
    """Ignore new values: for nodes without live parameters, which never call it."""


class LiveParameters(Generic[T]):
    """Hold a node's parameters as ``config``; call ``take`` with each new configuration.

    Each request is checked here before rclpy gets it, because rclpy refuses a whole number for a
    double and an empty list (whose type it cannot know), and does not say why a parameter is
    read-only or which names exist.

    ``take`` may refuse a configuration: it raises a TirgeoError and changes nothing.
    The executor serves a request between two messages, so each sample is processed with all the
    old values or with all the new ones.
    """

    def __init__(self, node: Node, kind: type[T], take: Callable[[T], None]) -> None:
        self.config = declare(node, kind)
        self._node, self._take = node, take
        self._names = {parameter.name for parameter in parameters_of(kind)}
        self._secrets = {parameter.name for parameter in parameters_of(kind) if parameter.secret}

    def set(self, parameters: Sequence[RosParameter], by_ros: _Set) -> SetParametersResult:
        """Set parameters, all or none; rclpy's ``by_ros`` sets those that change."""
        has = self._node.has_parameter
        others = [p for p in parameters if p.name not in self._names and has(p.name)]
        # A dump holds HIDDEN in place of a secret, which then stays as it is.
        kept = [p for p in parameters if p.name in self._secrets and p.value == HIDDEN]
        wanted = {p.name: p.value for p in parameters if p not in others and p not in kept}
        try:
            new = changed_in_flight(self.config, wanted)
            changed, values = changes(self.config, new), values_of(new)
            if changed:
                self._take(new)
        except TirgeoError as error:
            return SetParametersResult(successful=False, reason=str(error))
        result = by_ros([*(RosParameter(name, value=values[name]) for name in changed), *others])
        if not result.successful:
            self._take(self.config)
        elif changed:
            self.config = new
            text = ", ".join(f"{name}: {old} -> {now}" for name, (old, now) in changed.items())
            self._node.get_logger().info(f"set in flight: {text}")
        return result

"""Check a node's command line and parameter files; declare the dataclasses as ROS parameters.

rcl's errors are rewritten: they do not name the key and do not say what to do.
"""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from typing import TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.config.schema import Parameter, config_from, parameters_of, values_of
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.parameters.parameter_file import ParameterFile

T = TypeVar("T")
_ROS_OWN = {"use_sim_time", "start_type_description_service"}  # rclpy checks these itself


def parameter_files(arguments: Sequence[str]) -> list[str]:
    """Return the paths of the parameter files on a command line, in order."""
    return [b for a, b in pairwise(arguments) if a == "--params-file"]


def check_arguments(name: str, arguments: Sequence[str]) -> None:
    """Read and check each parameter file before rcl does.

    Raise ConfigError naming file and key. A node that was given a name without a configuration is
    not checked here: rcl checks it.
    """
    if any(argument.startswith("__node:=") for argument in arguments):
        name = next(a for a in arguments if a.startswith("__node:=")).removeprefix("__node:=")
    if name not in NODE_CONFIGS:
        return
    namespaces = [a.removeprefix("__ns:=") for a in arguments if a.startswith("__ns:=")]
    namespace = namespaces[-1] if namespaces else ""
    for path in parameter_files(arguments):
        values = ParameterFile(path).values(name, namespace)
        for key, value in values.items():
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
    except (ParameterException, NameValidationException) as error:
        raise ConfigError(f"{_where(arguments)}{_one_line(error)}") from None
    except RuntimeError as error:
        # rcl's errors are not importable from the public API, so they are compared by name.
        if type(error).__name__ not in {
            "RCLError",
            "UnknownROSArgsError",
            "RCLInvalidROSArgsError",
        }:
            raise
        raise ConfigError(f"{_where(arguments)}{_one_line(error)}") from None


def _where(arguments: Sequence[str]) -> str:
    files = ", ".join(parameter_files(arguments))
    return f"{files}: " if files else ""


def _one_line(error: Exception) -> str:
    # The position in rcl's C source does not help the user.
    text = re.sub(r", at \S+:\d+", "", " ".join(str(error).split()))
    mixed = "Sequence should be of same type" in text
    return f"{text}: write every number of a list with a decimal point" if mixed else text


def declare(node: Node, kind: type[T]) -> T:
    """Declare every parameter of ``kind`` on the node, read-only, and return their values.

    Raise ConfigError, naming the key and the parameter file, for an unknown name, a wrong type or
    a value out of range. A whole number for a double is converted.
    """
    config = config_from(kind, _given(node, kind), ", ".join(parameter_files(sys.argv)))
    values = values_of(config)
    for parameter in parameters_of(kind):
        value: object = values[parameter.name]
        if isinstance(value, tuple):
            # rclpy cannot infer the type of an empty list, so it is declared by type only.
            value = list(value) or RosParameter.Type.DOUBLE_ARRAY
        node.declare_parameter(parameter.name, value, _descriptor(parameter), ignore_override=True)
    return config


def given_names(node: Node, kind: type) -> frozenset[str]:
    """Return the names of those parameters of ``kind`` that a file or the command line sets."""
    own = {parameter.name for parameter in parameters_of(kind)}
    return frozenset(own.intersection(_given(node, kind)))


def _given(node: Node, kind: type) -> dict[str, object]:
    """Return the values from files and command line, without those that belong to other nodes."""
    # rclpy has no public access to overrides that are not declared yet.
    overrides: Mapping[str, RosParameter] = node._parameter_overrides  # noqa: SLF001
    own = {parameter.name: parameter for parameter in parameters_of(kind)}
    lists = {name for name, parameter in own.items() if isinstance(parameter.default, tuple)}
    others = {p.name for kind in NODE_CONFIGS.values() for p in parameters_of(kind)} | _ROS_OWN
    return {
        # rcl reads an empty list as None.
        name: () if given.value is None and name in lists else given.value
        for name, given in overrides.items()
        if name in own or not (name in others or name.startswith("qos_overrides."))
    }


def _descriptor(parameter: Parameter) -> ParameterDescriptor:
    made = ParameterDescriptor(name=parameter.name, read_only=True)
    unit = f" [{parameter.unit}]" if parameter.unit else ""
    made.description = parameter.description + unit
    made.additional_constraints = _constraints(parameter)
    low, high = parameter.low, parameter.high
    if not (math.isfinite(low) and math.isfinite(high)):
        return made
    if type(parameter.default) is int:
        made.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
    elif isinstance(parameter.default, float) and not math.isnan(parameter.default):
        # A range would refuse nan, which marks an unset value.
        made.floating_point_range = [
            FloatingPointRange(from_value=float(low), to_value=float(high))
        ]
    return made


def _constraints(parameter: Parameter) -> str:
    parts = []
    if parameter.choices:
        parts.append("one of " + ", ".join(parameter.choices))
    if parameter.sizes:
        parts.append(" or ".join(map(str, parameter.sizes)) + " numbers")
    if math.isfinite(parameter.low) or math.isfinite(parameter.high):
        parts.append(f"{parameter.low:g} to {parameter.high:g}")
    return ", ".join(parts)

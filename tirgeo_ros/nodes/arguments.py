"""Check a node's command line and parameter files before rcl does, and rewrite rcl's errors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise

from rclpy.exceptions import NameValidationException, ParameterException

from tirgeo_ros.core.config import NODE_CONFIGS
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.io.parameters.parameter_file import load_parameters


def parameter_files(arguments: Sequence[str]) -> list[str]:
    """Return the paths of the parameter files on a command line, in order."""
    return [b for a, b in pairwise(arguments) if a == "--params-file"]


def check_arguments(name: str, arguments: Sequence[str]) -> None:
    """Read and check each parameter file before rcl does.

    rcl's own error messages do not name the key and do not say what to do.
    Raise ConfigError naming file and key. A node that was given a name without a configuration is
    not checked here: rcl checks it.
    """
    if any(argument.startswith("__node:=") for argument in arguments):
        name = next(a for a in arguments if a.startswith("__node:=")).removeprefix("__node:=")
    if name not in NODE_CONFIGS:
        return
    for path in parameter_files(arguments):
        values = load_parameters(path, name, _namespace(arguments))
        for key, value in values.items():
            if isinstance(value, list) and len({type(item) for item in value}) > 1:
                raise ConfigError(
                    f"{path}: parameter {key}: ROS takes lists of one type only: "
                    f"write all of {value} with a decimal point"
                )


def _namespace(arguments: Sequence[str]) -> str:
    found = [a.removeprefix("__ns:=") for a in arguments if a.startswith("__ns:=")]
    return found[-1] if found else ""


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

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
"""Hold, print and write the estimates of a calibration, in one form for all calibrations.

An estimate is a mapping with ``key`` (node and name of the parameter that holds it), ``unit``
(deg, ms or m) and, in this unit, ``before``, ``found`` and ``sigma``.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.whole_files import PathLike, write_files
from tirgeo_ros.io.parameters.parameter_file import Value, parameters_yaml

#: Unit -> how many units make one rad, s or m.
PER_UNIT = {"deg": math.degrees(1.0), "ms": 1e3, "m": 1.0, "px": 1.0, "1": 1.0}
PER_UNIT |= {"deg/s": math.degrees(1.0), "m/s2": 1.0}
_DIGITS = {"deg": 3, "ms": 1, "m": 3, "px": 1, "1": 3, "deg/s": 3, "m/s2": 3}
_COLUMNS = ("before", "found", "sigma")

Estimates = Mapping[str, Mapping[str, Any]]


class Result(NamedTuple):
    """Hold the result of a fit to a flight."""

    numbers: dict[str, Any]  # for JSON, with the estimates as ``parameters``
    nodes: dict[str, dict[str, Value]]  # the parameters, by node
    notes: list[str]

    def yaml(self, command: str, bag: PathLike, lines: Sequence[str]) -> str:
        """Return the parameter file; its head comment has ``lines`` and the notes."""
        first = f"Written by 'tirgeo calibrate {command}' from {os.fspath(bag)}."
        head = "\n".join([first, *lines, *(f"note: {note}" for note in self.notes)])
        return parameters_yaml(self.nodes, head)


def estimate(key: str, unit: str, *numbers: float) -> dict[str, Any]:
    """Return an estimate of numbers in rad, s or m, in the order of the columns.

    A fourth one is the sigma that was known before.
    """
    columns = zip((*_COLUMNS, "prior_sigma")[: len(numbers)], numbers, strict=True)
    return {"key": key, "unit": unit} | {c: float(x) * PER_UNIT[unit] for c, x in columns}


def estimates_table(estimates: Estimates) -> list[str]:
    """Return the lines of a table with a row for each parameter."""
    columns = list(_COLUMNS)
    if any("prior_sigma" in row for row in estimates.values()):
        columns.append("prior_sigma")
    head = "".join(f"{name.removesuffix('_sigma'):>10}" for name in columns)
    lines = [f"{'parameter':<18}{head}       key"]
    for name, row in estimates.items():
        numbers = "".join(f"{row[key]:>10.{_DIGITS[row['unit']]}f}" for key in columns)
        lines.append(f"{name:<18}{numbers} {row['unit']:<5} {row['key']}")
    return lines


def described(lines: Sequence[str], result: Mapping[str, Any]) -> str:
    """Return the text for the screen: lines, notes and the files written."""
    notes = [f"note: {note}" for note in result.get("notes", ())]
    return "\n".join([*lines, *notes, *(f"wrote {path}" for path in result["output"])])


def written(
    files: Sequence[tuple[PathLike | None, Callable[[], str | bytes]]],
    numbers: Mapping[str, object],
    reader: BagReader | None,
) -> dict[str, object]:
    """Write the files whose name is not None, all or none; return the command's result.

    ``files`` are pairs of a name and a function that returns the contents. If the bag of
    ``reader`` is damaged, that is the result's ``error``. Raise CalibrationError.
    """
    contents = {path: content() for path, content in files if path is not None}
    write_files(contents, CalibrationError)
    damage = None if reader is None else reader.damage
    error = None if reader is None or damage is None else f"{reader.path}: {damage}"
    return {"output": [os.fspath(path) for path in contents], **numbers, "error": error}

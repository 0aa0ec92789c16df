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
"""Open a flight for a verb: a bag as it is; stills, MP4 or MISB by importing them first."""

from __future__ import annotations

import re
import weakref
from contextlib import ExitStack, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

from tirgeo_ros.core.types.errors import BagError, LogError
from tirgeo_ros.io.bags.bag import ROS2_MAGICS, BagReader, is_bag
from tirgeo_ros.io.files.whole_files import PathLike, first_bytes, path_of
from tirgeo_ros.io.logs.forms import Form, form_of
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent

NO_OPTIONS = LogOptions()


class OpenedInput(NamedTuple):
    """Hold a flight that can be read, and what follows from its import; nothing for a bag."""

    reader: BagReader
    params: list[PathLike]  # those of the import, then the user's, which override them
    notes: list[str]
    refused: list[tuple[str, str]]  # record (the name of a still) and reason


def given(options: LogOptions) -> list[str]:
    """Return the names on the command line of the options that are given."""
    names = [name for name, value in vars(options).items() if value != getattr(NO_OPTIONS, name)]
    return ["--" + re.sub("_(m|s|rad)$", "", name).replace("_", "-") for name in names]


def direct_form(path: PathLike) -> Form | None:
    """Return the form of what is imported before it is read; None for a bag and anything else."""
    place = path_of(path, BagError)
    if place.is_file():
        if is_bag(place) or first_bytes(place, 8, BagError).startswith(ROS2_MAGICS):
            return None
    elif not place.is_dir():  # reading a pipe would block without end
        return None
    with suppress(LogError):
        return form_of(place)
    return None


def open_input(
    path: PathLike,
    params: Files = None,
    namespace: str = "",
    options: LogOptions = NO_OPTIONS,
    progress: Report = silent,
) -> OpenedInput:
    """Open a bag, or import a folder or file into a temporary one.

    The temporary bag is removed with its reader, at the latest when the process ends; ``progress``
    decides only whether a bar is shown. Raise BagError, also for ``options`` of a bag, LogError
    and ConfigError.
    """
    own = paths_of(params)
    if direct_form(path) is None:
        for option in given(options):
            raise BagError(f"{path}: a bag: {option} is for stills, MP4 and MISB")
        return OpenedInput(BagReader(path), own, [], [])
    with ExitStack() as stack:
        temporary = TemporaryDirectory(prefix="tirgeo-import-", ignore_cleanup_errors=True)
        bag = Path(stack.enter_context(temporary)) / "flight.mcap"
        with Progress("importing") as bar:
            shown = silent if progress is silent else bar
            result = import_flight(
                path, bag, params=own, namespace=namespace, logs=options, progress=shown
            )
        reader = BagReader(bag)
        weakref.finalize(reader, stack.pop_all().close)
    reader.path = Path(path)  # the name for people
    params = [*filter(None, [result["parameter_file"]]), *own]
    notes = [note for file in result["files"] for note in file["notes"]]
    notes += [*result["warnings"], *filter(None, [result["error"]])]
    rows = [row for file in result["files"] for row in file["refused"]]
    refused = [(str(row["record"]), str(row["reason"])) for row in rows]
    return OpenedInput(reader, params, notes, refused)

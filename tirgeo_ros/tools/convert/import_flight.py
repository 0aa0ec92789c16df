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
"""Import flights in other forms to bags with the contract's topics: ``tirgeo import``."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from tirgeo_ros.core.config import DjiConfig
from tirgeo_ros.core.types.errors import BagError
from tirgeo_ros.io.bags.bag import ROS2_MAGICS, BagWriter, is_bag
from tirgeo_ros.io.bags.ros1_bag import MAGIC as ROS1_MAGIC
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, first_bytes, write_files
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.parameters.parameter_file import Files, ParameterFile, parameters_yaml, paths_of
from tirgeo_ros.tools.convert.import_capture import CaptureOptions, import_capture
from tirgeo_ros.tools.convert.import_logs import forms_of, import_logs
from tirgeo_ros.tools.convert.import_mapped import MappedTopics, import_mapped, what_can_be_mapped
from tirgeo_ros.tools.convert.import_ros1 import Pictures, import_ros1
from tirgeo_ros.tools.convert.import_sink import ImportSink
from tirgeo_ros.tools.presentation.progress import Report, silent

_OTHERS = {
    b"#ROSBAG": "a ROS 1 bag of an older version; make it 2.0 with rosbag fix",
    b"\x1f\x8b": "packed with gzip; unpack it",
    b"PK\3\4": "packed with zip; unpack it",
}
_HEAD = 4096
_SOF = 0xAA  # begins every frame of the aircraft, and never occurs in text


def import_flight(
    source: PathLike | Sequence[PathLike],
    output: PathLike,
    *,
    params: Files = None,
    namespace: str = "",
    pictures: Pictures = Pictures(),  # noqa: B008  immutable
    capture: CaptureOptions = CaptureOptions(),  # noqa: B008  immutable
    mapped: MappedTopics = MappedTopics(),  # noqa: B008  immutable
    logs: LogOptions = LogOptions(),  # noqa: B008  immutable
    columns: Sequence[PathLike] = (),
    progress: Report = silent,
) -> dict[str, Any]:
    """Import a flight and return what was read and written.

    ``source`` is a ROS 1 bag of DJI's wrapper, a capture of the aircraft's serial port, or one or
    several logs of one flight, recognised by their content; or a bag of ROS 1 or ROS 2 whose
    topics ``mapped`` names. ``params`` are YAML files with dji_node's parameters; ``namespace`` is
    that of the bag's topics and of the written ones; ``pictures`` is for DJI's bags, ``capture``
    for captures, ``logs`` for logs, ``columns`` for logs in CSV. In the result ``warning`` is None
    or a warning. The output gets its name only when it is complete. ``parameters`` of the nodes
    that follow from logs are also written beside it, as ``.yaml``. Raise BagError, DjiError,
    LogError, ConfigError.
    """
    paths = [Path(source)] if isinstance(source, str | os.PathLike) else list(map(Path, source))
    tables = list(map(Path, columns))
    if mapped.pairs and len(paths) > 1:
        raise BagError(f"{paths[1]}: --map-topic is for one bag: import this one alone")
    forms = [None] if mapped.pairs else forms_of(paths, tables)
    files = [(path, form) for path, form in zip(paths, forms, strict=True) if form is not None]
    is_ros1 = not files and not mapped.pairs and _is_ros1(paths[0], namespace)
    config = ParameterFile(params).config("dji_node", DjiConfig, namespace)
    inputs = (*paths, *tables, *paths_of(params), capture.packages, config.packages)
    check_outputs(inputs, [output], BagError)
    with BagWriter(output) as writer:
        sink = ImportSink(writer, config, namespace)
        if mapped.pairs:
            imported = import_mapped(paths[0], sink, mapped, config.aircraft, progress)
        elif files:
            imported = import_logs(files, tables, sink, config, logs, progress)
        elif is_ros1:
            imported = import_ros1(paths[0], sink, namespace, pictures, progress)
        else:
            imported = import_capture(paths[0], sink, config, capture, progress)
        sink.finish()
        parameters = imported.get("parameters") or {}
        beside = Path(output).with_suffix(".yaml") if parameters else None
        check_outputs(inputs, [output, beside], BagError)
    if beside is not None:
        head = f"Parameters that follow from {', '.join(path.name for path in paths)}"
        write_files({beside: parameters_yaml({"": parameters}, head)}, BagError)
    names = [str(path) for path in paths]
    of_dji = [] if files or mapped.pairs else sink.interpreter.warnings
    warnings = [*imported["warnings"], *of_dji]
    return {
        "input": names if files else names[0],
        "output": os.fspath(output),
        "parameter_file": beside and str(beside),
        **imported,
        "written": {name: vars(counts) for name, counts in sorted(sink.written.items())},
        "counts": sink.interpreter.counts,
        "warnings": warnings,
        "warning": "; ".join(warnings) or None,
    }


def _is_ros1(path: Path, namespace: str) -> bool:
    """Return True for a ROS 1 bag, False for a capture. Raise BagError for anything else."""
    if path.is_dir():
        other = "a directory; give a ROS 1 bag or a capture of the serial port"
        raise BagError(f"{path}: {_of_ros2(path, namespace) if is_bag(path) else other}")
    head = first_bytes(path, _HEAD, BagError)
    if not head:
        raise BagError(f"{path}: the file is empty")
    if head.startswith(ROS1_MAGIC):
        return True
    if head.startswith(ROS2_MAGICS):
        raise BagError(f"{path}: {_of_ros2(path, namespace)}")
    for mark, kind in _OTHERS.items():
        if head.startswith(mark):
            raise BagError(f"{path}: {kind}")
    if _SOF not in head and all(byte >= 32 or byte in b"\t\n\r\f" for byte in head):
        raise BagError(f"{path}: a text, but no known log: docs/import.md lists the known logs")
    return False


def _of_ros2(path: Path, namespace: str) -> str:
    """Return the message for a ROS 2 bag without --map-topic."""
    try:
        return f"a ROS 2 bag; {what_can_be_mapped(path, namespace)}"
    except BagError as error:
        return str(error).removeprefix(f"{path}: ")

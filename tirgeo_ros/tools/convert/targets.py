"""Convert a file of targets to another format, for ``tirgeo locate`` without pixels."""

from __future__ import annotations

import os

from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.targets.formats import exported, form_of, read_targets


def convert_targets(
    targets_in: PathLike, output: PathLike, kml_out: PathLike | None = None
) -> dict[str, object]:
    """Write targets in the format that the output's name asks for, and as KML if asked.

    Return a summary. Raises TargetError naming the file.
    """
    outputs = [one for one in (output, kml_out) if one]
    check_outputs([targets_in], outputs, TargetError)
    try:
        targets = read_targets(targets_in)
    except TargetError as error:
        raise TargetError(f"{error} (a recorded flight needs --pixels)") from None
    forms = {output: form_of(output), kml_out: "kml"}
    files: dict[PathLike, str | bytes]
    files = {path: exported(targets, form) for path, form in forms.items() if path}
    write_files(files, TargetError)
    return {
        "input": os.fspath(targets_in),
        "output": [os.fspath(path) for path in outputs],
        "targets": len(targets),
    }

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
"""Recognise the form of a log by its content; list the readers."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.io.files.whole_files import UTF16, first_bytes
from tirgeo_ros.io.logs import (
    csv_log,
    dataflash,
    dji_mrk,
    dji_srt,
    dji_video,
    misb,
    nmea,
    px4_ulog,
    rtklib_pos,
    stills,
    ubx,
)
from tirgeo_ros.io.logs.log_contents import LogContents, LogOptions


class Form(NamedTuple):
    """Hold a form of logs: its name, how a file's first bytes show it, and its reader."""

    name: str
    is_form: Callable[[bytes], bool]
    read: Callable[[Path, LogOptions], LogContents]  # raises LogError naming the log
    module: str = ""  # the optional one that the reader needs


UBX = Form("u-blox UBX", ubx.is_ubx, ubx.read_ubx, "pyubx2")
STILLS = Form("stills", stills.is_still, stills.read_stills)
NMEA = Form("NMEA", nmea.is_nmea, nmea.read_nmea, "pynmeagps")
VIDEO = Form("DJI video", dji_video.is_dji_video, dji_video.read_dji_video, "av")
#: The first form that fits is used.
FORMS = (
    STILLS,
    Form("PX4 ULog", px4_ulog.is_px4_ulog, px4_ulog.read_px4_ulog, "pyulog"),
    Form("ArduPilot DataFlash", dataflash.is_dataflash, dataflash.read_dataflash, "pymavlink"),
    UBX,
    Form("RTKLIB .pos", rtklib_pos.is_pos, rtklib_pos.read_pos),
    Form("DJI subtitles (SRT)", dji_srt.is_srt, dji_srt.read_srt),
    Form("MISB ST 0601", misb.is_misb, misb.read_misb),
    VIDEO,
    Form("DJI marks of stills (MRK)", dji_mrk.is_mrk, dji_mrk.read_mrk),
    NMEA,
)


def _is_text(head: bytes) -> bool:
    """Return whether a file is a text: it has hardly any control bytes, except tabs and line ends.

    A text on a memory card has some where the power was cut; a binary log has a tenth and more.
    """
    return sum(byte < 32 and byte not in b"\t\n\r\f" for byte in head) <= len(head) // 100


#: Any text, if a columns file says what its columns mean.
CSV = Form("CSV", _is_text, csv_log.read_csv)


def form_of(path: Path, *, columns: bool = False) -> Form | None:
    """Return the form of a log by its first bytes; None if no reader fits.

    With ``columns`` a text of no other form is CSV. Raise LogError for a file that cannot be read,
    and for a table without ``columns``.
    """
    if path.is_dir():
        return STILLS if stills.is_folder_of_stills(path) else None
    head = first_bytes(path, 1 << 16, LogError)  # enough to recognise a log
    if head.startswith(UTF16):
        with suppress(UnicodeDecodeError):  # it is not a text
            head = head.decode("utf-16").encode()
    form = next((form for form in FORMS if form.is_form(head)), None)
    if form in {UBX, NMEA} and NMEA.is_form(head):  # of a receiver that sends both
        return UBX if ubx.has_solutions(path.read_bytes()) else NMEA
    if form is not None or not head or not CSV.is_form(head):
        return form
    if columns:
        return CSV
    if b"," in head or b";" in head:
        raise LogError(
            f"{path}: text in columns: say what they mean with --columns YAML, "
            "made from config/columns/template.yaml"
        )
    return None

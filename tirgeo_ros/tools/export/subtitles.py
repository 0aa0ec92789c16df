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
"""Export subtitles for a flight's video that say where the camera was and where it looked.

A cue has the form of DJI's newer cameras, for the programs that read it, then a line of words.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

from tirgeo_ros.core.ground.frame_geometry import camera_heading_rad, camera_place, height_above_m
from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.core.types.texts import utc
from tirgeo_ros.io.files.whole_files import write_files
from tirgeo_ros.io.video.video_file import FrameTimes
from tirgeo_ros.tools.export.frames import ExportFrame

#: If the time between two pictures is longer than so many intervals, a picture is missing.
_LATE = 1.5


class Subtitles:
    """Write an .srt beside the video that ``tirgeo process`` makes of the same bag.

    ``stamps_ns`` are those of all pictures of the flight, in the order of the bag: times count
    from the first of them, as in the video. Each picture that is taken begins a cue, which ends
    with the next one. They are expected every ``every_s`` seconds (0: all of the flight): if the
    next is missing, the cue ends with its picture. ``undulation_m`` of the geoid makes ``abs_alt``
    the height above sea level; without it ``abs_alt`` is ellipsoidal. Raises ExportError naming a
    file that cannot be written.
    """

    def __init__(
        self,
        path: Path,
        stamps_ns: Sequence[int],
        every_s: float = 0.0,
        undulation_m: float = math.nan,
    ) -> None:
        self._path, self._times_ns = path, _begins(stamps_ns)
        self._longest_ns = round(_LATE * every_s * 1e9)
        self._undulation_m = undulation_m
        self._numbers: list[int] = []  # of the pictures with a cue
        self._cues: list[str] = []  # their lines, from the date on

    def take(self, frame: ExportFrame) -> None:
        """Begin a cue."""
        self._numbers.append(frame.number)
        self._cues.append(self._lines(frame))

    def finish(self) -> dict[str, object]:
        """Write the file, if there is a cue."""
        text = ""
        for cue, (number, following) in enumerate(pairwise([*self._numbers, -1])):
            begin_ns, end_ns = self._times_ns[number : number + 2]
            if self._times_ns[following] <= begin_ns + self._longest_ns:
                end_ns = self._times_ns[following]
            head = f"FrameCnt: {number + 1}, DiffTime: {round((end_ns - begin_ns) * 1e-6)}ms"
            text += f"{cue + 1}\n{_clock(begin_ns)} --> {_clock(end_ns)}\n"
            text += f'<font size="28">{head}\n{self._cues[cue]}\n\n'
        if text:
            write_files({self._path: text}, ExportError)
        return {"file": str(self._path), "cues": len(self._cues)}

    def _lines(self, frame: ExportFrame) -> str:
        place = camera_place(frame.pose, frame.plane)
        above_m = height_above_m(frame.pose, frame.plane, frame.ground)
        altitude_m = place.altitude_m(self._undulation_m)
        zero = "sea level" if math.isfinite(self._undulation_m) else "the ellipsoid"
        latitude, longitude = math.degrees(place.latitude_rad), math.degrees(place.longitude_rad)
        roll, pitch, yaw = map(math.degrees, place.rpy)
        relative = f"rel_alt: {above_m:.3f} " if math.isfinite(above_m) else ""
        above = f"{above_m:.0f} m above the ground, " if relative else ""
        heading = round(math.degrees(camera_heading_rad(frame.pose))) % 360
        return (
            f"{utc(frame.pose.stamp_ns).rstrip('Z').replace('T', ' ')}\n"
            f"[latitude: {latitude:.8f}] [longitude: {longitude:.8f}] "
            f"[{relative}abs_alt: {altitude_m:.3f}] "
            f"[gb_yaw: {yaw:.2f} gb_pitch: {pitch:.2f} gb_roll: {roll:.2f}] </font>\n"
            f"{above}{altitude_m:.0f} m above {zero}, "
            f"camera to {heading:03} deg, "
            f"{abs(pitch):.0f} deg {'down' if pitch < 0 else 'up'}"
        )


def _begins(stamps_ns: Sequence[int]) -> list[int]:
    """Return the time at which each picture begins in the video, ns, and the end of the last."""
    times = FrameTimes()
    begins = [times.at(stamp) for stamp in stamps_ns]
    step_ns = next((after - before for before, after in pairwise(begins[-2:])), 100_000_000)
    return begins + [begin + step_ns for begin in begins[-1:]]


def _clock(time_ns: int) -> str:
    """Return hours, minutes, seconds and milliseconds."""
    seconds, milliseconds = divmod(round(time_ns * 1e-6), 1000)
    minutes, seconds = divmod(seconds, 60)
    return f"{minutes // 60:02}:{minutes % 60:02}:{seconds:02},{milliseconds:03}"

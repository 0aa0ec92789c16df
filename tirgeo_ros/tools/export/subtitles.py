"""Export subtitles for a flight's video that say where the camera was and where it looked.

A cue has the form of DJI's newer cameras, for the programs that read it, then a line of words.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator, Sequence
from datetime import datetime, timezone
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.core.ground.camera_place import camera_heading_rad, camera_place, height_above_m
from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.io.files.whole_files import check_place, part_of
from tirgeo_ros.io.video.video_file import FrameTimes
from tirgeo_ros.tools.export.frames import ExportFrame


class SubtitleFile:
    """Append cues to a file, which gets its name in ``finish``; without a cue there is no file.

    Raises ExportError naming the file.
    """

    def __init__(self, path: Path) -> None:
        self.path, self.cues = path, 0
        check_place(path, ExportError)
        self._part = part_of(path)
        with self._writing():
            self._file = self._part.open("w", encoding="utf-8")

    def add(self, begin_ns: int, end_ns: int, text: str) -> None:
        """Append a cue, shown between two times from the video's begin, ns."""
        self.cues += 1
        with self._writing():
            times = f"{_clock(begin_ns)} --> {_clock(end_ns)}"
            self._file.write(f"{self.cues}\n{times}\n{text}\n\n")

    def finish(self) -> None:
        """Complete the file."""
        with self._writing():
            self._file.close()
            if self.cues:
                self._part.replace(self.path)
        self.close()

    def close(self) -> None:
        """Remove what is not finished."""
        self._file.close()
        self._part.unlink(missing_ok=True)

    @contextlib.contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            why = error.strerror or error
            raise ExportError(f"{self.path}: cannot be written: {why}") from None


def _clock(time_ns: int) -> str:
    """Return hours, minutes, seconds and milliseconds."""
    seconds, milliseconds = divmod(round(time_ns * 1e-6), 1000)
    minutes, seconds = divmod(seconds, 60)
    return f"{minutes // 60:02}:{minutes % 60:02}:{seconds:02},{milliseconds:03}"


#: A picture that comes later than so many intervals after the one before is not the next one.
_LATE = 1.5


class _Cue(NamedTuple):
    """Hold a cue whose end is not known yet."""

    number: int  # of its picture
    lines: str  # from the date on


class Subtitles:
    """Write an .srt beside the video that ``tirgeo process`` makes of the same bag.

    ``stamps_ns`` are those of all pictures of the flight, in the order of the bag: times count
    from the first of them, as in the video. Each picture that is taken begins a cue, which ends
    with the next one. They are expected every ``every_s`` seconds (0: all of the flight): if the
    next is missing, the cue ends with its picture. ``undulation_m`` of the geoid makes ``abs_alt``
    the height above sea level; without it, it is ellipsoidal. Raises ExportError naming a file
    that cannot be written.
    """

    def __init__(
        self,
        path: Path,
        *,
        stamps_ns: Sequence[int],
        every_s: float = 0.0,
        undulation_m: float = math.nan,
    ) -> None:
        self._file = SubtitleFile(path)
        self._times_ns = _begins(stamps_ns)
        self._longest_ns = round(_LATE * every_s * 1e9)
        self._undulation_m = undulation_m
        self._cue: _Cue | None = None

    def take(self, frame: ExportFrame) -> None:
        """End the cue before, and begin one."""
        self._end(self._times_ns[frame.number])
        self._cue = _Cue(frame.number, self._lines(frame))

    def finish(self) -> dict[str, object]:
        """Write the last cue, and give the file its name."""
        self._end(self._times_ns[-1] if self._times_ns else 0)
        self._file.finish()
        return {"file": str(self._file.path), "cues": self._file.cues}

    def close(self) -> None:
        """Remove the file if it is not finished."""
        self._file.close()

    def _end(self, next_ns: int) -> None:
        """Write the cue that is not written yet; the one after it begins at ``next_ns``."""
        if self._cue is None:
            return
        begin_ns, own_end_ns = self._times_ns[self._cue.number : self._cue.number + 2]
        end_ns = next_ns if next_ns <= begin_ns + self._longest_ns else own_end_ns
        head = f"FrameCnt: {self._cue.number + 1}, DiffTime: {round((end_ns - begin_ns) * 1e-6)}ms"
        self._file.add(begin_ns, end_ns, f'<font size="28">{head}\n{self._cue.lines}')
        self._cue = None

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
            f"{_date(frame.pose.stamp_ns)}\n"
            f"[latitude: {latitude:.8f}] [longitude: {longitude:.8f}] "
            f"[{relative}abs_alt: {altitude_m:.3f}] "
            f"[gb_yaw: {yaw:.2f} gb_pitch: {pitch:.2f} gb_roll: {roll:.2f}] </font>\n"
            f"{above}{altitude_m:.0f} m above {zero}, "
            f"camera to {heading:03} deg, {_tilt(pitch)}"
        )


def _begins(stamps_ns: Sequence[int]) -> list[int]:
    """Return when each picture begins in the video, ns, and when the last one ends."""
    times = FrameTimes()
    begins = [times.at(stamp) for stamp in stamps_ns]
    last = begins[-1:]
    step_ns = next((after - before for before, after in pairwise(begins[-2:])), 100_000_000)
    return begins + [begin + step_ns for begin in last]


def _date(stamp_ns: int) -> str:
    """Return the date and the time, UTC, to a millisecond, rounded down."""
    seconds, rest_ns = divmod(stamp_ns, 1_000_000_000)
    date = datetime.fromtimestamp(seconds, timezone.utc)
    return f"{date:%Y-%m-%d %H:%M:%S}.{rest_ns // 1_000_000:03}"


def _tilt(pitch_deg: float) -> str:
    return f"{abs(pitch_deg):.0f} deg {'down' if pitch_deg < 0 else 'up'}"

"""Write subtitles as SubRip (.srt): under its name the file is complete or absent."""

from __future__ import annotations

import contextlib
import weakref
from collections.abc import Iterator
from pathlib import Path

from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.io.files.whole_files import check_place, part_of


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
        # What was not finished is removed with this object, at the latest when the program ends.
        self._remove = weakref.finalize(self, self._part.unlink, missing_ok=True)

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
        self._remove()

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

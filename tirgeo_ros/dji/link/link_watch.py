"""Describe the serial link for a person: a condition, a message and a level.

The port's own state shows whether it is open. What comes through it shows whether the cable, the
aircraft's settings, the baud rate and the key are right.
"""

from __future__ import annotations

from collections import deque
from enum import IntEnum
from typing import NamedTuple

from tirgeo_ros.dji.link.serial_link import LinkState

#: Time without data before a warning; the slowest useful stream, 5 Hz of RTK, pauses 0.2 s.
PATIENCE_S = 2.0
_STEP_S = 0.1  # smallest interval between the looks that are kept
#: Bytes within this time after a frame are the beginning of a cut frame, not a wrong baud rate.
_CUT_FRAME_S = 0.2
#: If at least this percentage of the frames cannot be decrypted, the key is not the aircraft's. Of
#: those that a wrong key decrypts, one in 256 looks right by chance.
_LOCKED_PERCENT = 90
#: Rates of DJI's own samples and wrapper, the likelier one first.
_USUAL_BAUDS = (921600, 230400, 115200, 1000000)
_NEVER_S = float("-inf")


class LinkLevel(IntEnum):
    """List the severities; the numbers are those of a DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


#: Level (others are errors) and message of the conditions of an open port. A port that is not open
#: has its state for a condition.
_LEVELS = {
    "waiting": LinkLevel.WARN,  # just opened
    "silent": LinkLevel.WARN,
    "receiving": LinkLevel.OK,
}
_WORDS = {
    "receiving": "receiving at {baud} baud",
    "waiting": "open, nothing understood yet",
    "silent": (
        f"open but no bytes for {PATIENCE_S:.0f} s: check that the aircraft is on, the "
        "cable (TX to RX) and that 'API control' is ticked in DJI Assistant 2 (SDK tab)"
    ),
    "wrong_key": (
        "frames come, but they are encrypted and the parameter key {wrong_key}: set it "
        "to the app key with which the aircraft was activated (DJI's developer site)"
    ),
    "wrong_baud": (
        f"bytes come but no valid frame for {PATIENCE_S:.0f} s at {{baud}} baud: set "
        "baud as in DJI Assistant 2 (SDK tab); usual are {others}"
    ),
}


class LinkReport(NamedTuple):
    """Hold the condition of the link."""

    condition: str
    level: LinkLevel
    message: str  # one line: the port and what to do
    since_s: float  # when it began, by the clock of ``look``
    bytes_per_s: float  # over the last two seconds
    frames_per_s: float


class LinkWatch:
    """Watch the port ``port`` that is read with ``baud``, with a key or without."""

    def __init__(self, port: str, baud: int, *, has_key: bool = False) -> None:
        self._port = port
        self._words = {
            "baud": baud,
            "others": ", ".join(str(usual) for usual in _USUAL_BAUDS if usual != baud),
            "wrong_key": "is not the aircraft's" if has_key else "is not set",
        }
        #: Time, and total numbers of bytes, frames and frames that were not decrypted.
        self._looks: deque[tuple[float, int, int, int]] = deque()
        self._last = (0.0, 0, 0, 0)
        self._opened_s = self._heard_bytes_s = self._heard_frame_s = _NEVER_S
        self.report: LinkReport | None = None  # the condition at the last look

    def look(
        self,
        now_s: float,
        state: LinkState,
        message: str,
        byte_count: int,
        frame_count: int,
        locked_count: int = 0,
    ) -> LinkReport | None:
        """Take the port's state and message, and the total numbers of bytes and frames.

        Returns the report if the condition has changed since the last look, else None. ``now_s``:
        of a monotonic clock. ``locked_count``: number of frames that were not decrypted.
        """
        if state is LinkState.OPEN:
            self._listen(now_s, byte_count, frame_count, locked_count)
            condition = self._condition(now_s)
            message = f"{self._port}: {_WORDS[condition].format(**self._words)}"
        else:
            self._looks.clear()
            condition = state.value
        before = self.report
        changed = before is None or before.condition != condition
        since_s = now_s if before is None or changed else before.since_s
        level = _LEVELS.get(condition, LinkLevel.ERROR)
        span_s, byte_count, frame_count, _ = self._counted
        rates = (byte_count / span_s, frame_count / span_s) if span_s > 0 else (0.0, 0.0)
        self.report = LinkReport(condition, level, message, since_s, *rates)
        return self.report if changed else None

    @property
    def _counted(self) -> tuple[float, int, int, int]:
        """Return time, bytes, frames and undecrypted frames over the last two seconds."""
        first, last = (self._looks[0] if self._looks else self._last), self._last
        return last[0] - first[0], last[1] - first[1], last[2] - first[2], last[3] - first[3]

    def _listen(self, now_s: float, byte_count: int, frame_count: int, locked_count: int) -> None:
        look = (now_s, byte_count, frame_count, locked_count)
        if not self._looks:  # what came before the port was open does not count
            self._opened_s, self._heard_bytes_s, self._heard_frame_s = now_s, _NEVER_S, _NEVER_S
            self._looks.append(look)
            self._last = look
        if byte_count > self._last[1]:
            self._heard_bytes_s = now_s
        if frame_count > self._last[2]:
            self._heard_frame_s = now_s
        self._last = look
        if now_s - self._looks[-1][0] >= _STEP_S:
            self._looks.append(look)
        while len(self._looks) > 1 and now_s - self._looks[1][0] >= PATIENCE_S:
            self._looks.popleft()

    def _condition(self, now_s: float) -> str:
        if now_s - self._heard_frame_s < PATIENCE_S:
            _, _, frames, locked = self._counted
            is_locked = 0 < _LOCKED_PERCENT * frames <= 100 * locked
            return "wrong_key" if is_locked else "receiving"
        if now_s - self._opened_s < PATIENCE_S:
            return "waiting"
        garbage = self._heard_bytes_s > self._heard_frame_s + _CUT_FRAME_S
        if garbage and now_s - self._heard_bytes_s < PATIENCE_S:
            return "wrong_baud"
        return "silent"

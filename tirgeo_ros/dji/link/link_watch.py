"""Describe the serial link for a person: a condition, a message and a level.

The port's own state shows whether it is open. What comes through it shows whether the cable, the
aircraft's settings, the baud rate and the key are right.
"""

from __future__ import annotations

from collections import deque
from enum import Enum, IntEnum
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
USUAL_BAUDS = (921600, 230400, 115200, 1000000)


class LinkLevel(IntEnum):
    """List the severities; the numbers are those of a DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2


class LinkCondition(Enum):
    """List the link's conditions: states of a port that is not open, else of its data."""

    NO_DEVICE = "no_device"
    PERMISSION_DENIED = "permission_denied"
    BUSY = "busy"
    NOT_A_PORT = "not_a_port"
    BAUD_REFUSED = "baud_refused"
    LOST = "lost"
    WAITING = "waiting"  # just opened
    SILENT = "silent"  # open, no bytes
    WRONG_BAUD = "wrong_baud"  # bytes, no frame
    WRONG_KEY = "wrong_key"  # frames, but encrypted with another key, or no key is set
    RECEIVING = "receiving"


_LEVELS = {
    LinkCondition.WAITING: LinkLevel.WARN,
    LinkCondition.SILENT: LinkLevel.WARN,
    LinkCondition.RECEIVING: LinkLevel.OK,
}


class LinkReport(NamedTuple):
    """Hold the condition of the link."""

    condition: LinkCondition
    level: LinkLevel
    message: str  # one line: the port and what to do
    since_s: float  # when it began, by the clock of ``look``
    bytes_per_s: float  # over the last two seconds
    frames_per_s: float


class _Look(NamedTuple):
    now_s: float
    byte_count: int
    frame_count: int
    locked_count: int


class LinkWatch:
    """Watch the port ``port`` that is read with ``baud``, with a key or without."""

    def __init__(self, port: str, baud: int, *, has_key: bool = False) -> None:
        self._port, self._baud, self._has_key = port, baud, has_key
        self._looks: deque[_Look] = deque()
        self._heard_bytes_s = self._heard_frame_s = float("-inf")
        self._opened_s = float("-inf")
        self._last = _Look(0.0, 0, 0, 0)
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
            condition = self._listen(_Look(now_s, byte_count, frame_count, locked_count))
            message = f"{self._port}: {self._words(condition)}"
        else:
            self._looks.clear()
            condition = LinkCondition(state.value)
        before = self.report
        changed = before is None or before.condition is not condition
        since_s = now_s if before is None or changed else before.since_s
        level = _LEVELS.get(condition, LinkLevel.ERROR)
        self.report = LinkReport(condition, level, message, since_s, *self._rates())
        return self.report if changed else None

    def _listen(self, look: _Look) -> LinkCondition:
        if not self._looks:  # what came before the port was open does not count
            self._opened_s = look.now_s
            self._heard_bytes_s = self._heard_frame_s = float("-inf")
            self._looks.append(look)
            self._last = look
        if look.byte_count > self._last.byte_count:
            self._heard_bytes_s = look.now_s
        if look.frame_count > self._last.frame_count:
            self._heard_frame_s = look.now_s
        self._last = look
        if look.now_s - self._looks[-1].now_s >= _STEP_S:
            self._looks.append(look)
        while len(self._looks) > 1 and look.now_s - self._looks[1].now_s >= PATIENCE_S:
            self._looks.popleft()
        return self._condition(look.now_s)

    def _condition(self, now_s: float) -> LinkCondition:
        if now_s - self._heard_frame_s < PATIENCE_S:
            return LinkCondition.WRONG_KEY if self._locked else LinkCondition.RECEIVING
        if now_s - self._opened_s < PATIENCE_S:
            return LinkCondition.WAITING
        garbage = self._heard_bytes_s > self._heard_frame_s + _CUT_FRAME_S
        if garbage and now_s - self._heard_bytes_s < PATIENCE_S:
            return LinkCondition.WRONG_BAUD
        return LinkCondition.SILENT

    @property
    def _locked(self) -> bool:
        """Return whether nearly all frames of the last two seconds are still encrypted."""
        first, last = self._looks[0], self._last
        locked = last.locked_count - first.locked_count
        return 0 < _LOCKED_PERCENT * (last.frame_count - first.frame_count) <= 100 * locked

    def _words(self, condition: LinkCondition) -> str:
        others = ", ".join(str(baud) for baud in USUAL_BAUDS if baud != self._baud)
        wrong_key = "is not the aircraft's" if self._has_key else "is not set"
        words = {
            LinkCondition.RECEIVING: f"receiving at {self._baud} baud",
            LinkCondition.WAITING: "open, nothing understood yet",
            LinkCondition.SILENT: (
                f"open but no bytes for {PATIENCE_S:.0f} s: check that the aircraft is on, the "
                "cable (TX to RX) and that 'API control' is ticked in DJI Assistant 2 (SDK tab)"
            ),
            LinkCondition.WRONG_KEY: (
                f"frames come, but they are encrypted and the parameter key {wrong_key}: set it "
                "to the app key with which the aircraft was activated (DJI's developer site)"
            ),
            LinkCondition.WRONG_BAUD: (
                f"bytes come but no valid frame for {PATIENCE_S:.0f} s at {self._baud} baud: set "
                f"baud as in DJI Assistant 2 (SDK tab); usual are {others}"
            ),
        }
        return words[condition]

    def _rates(self) -> tuple[float, float]:
        """Return bytes and frames per second; zeros before there is a time to count over."""
        if not self._looks or self._last.now_s <= self._looks[0].now_s:
            return 0.0, 0.0
        first, last = self._looks[0], self._last
        span_s = last.now_s - first.now_s
        byte_count = last.byte_count - first.byte_count
        return byte_count / span_s, (last.frame_count - first.frame_count) / span_s

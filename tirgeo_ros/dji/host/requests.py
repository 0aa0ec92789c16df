"""Send requests to the aircraft one after the other, each until it is answered or given up.

A dialogue is a generator. It yields a request (and receives the value of the ack, None if there is
none) or the seconds of a pause. So it reads from top to bottom although nothing in it waits.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import TypeVar

from tirgeo_ros.dji.link.framing import ProtocolFrame, encode_frame
from tirgeo_ros.dji.protocol.commands import Request, decode_code

#: A session that wants an ack and may repeat the frame: 2 to 31 are such, DJI's host uses 2.
SESSION = 2
#: The longest request and its ack take 5 ms on the wire at 230400 baud, behind a full line.
ANSWER_TIMEOUT_S = 0.5
TRIES = 4

T = TypeVar("T")
Dialogue = Generator[Request | float, "bytes | None", T]


class NoAnswerError(Exception):
    """Report a request that the aircraft did not answer."""


def ask(request: Request) -> Dialogue[bytes]:
    """Return the value of the ack. Raises NoAnswerError if none came."""
    value = yield request
    if value is None:
        raise NoAnswerError(request)
    return value


def ask_code(request: Request) -> Dialogue[int]:
    """Return the code of the ack. Raises NoAnswerError if none came, or one without a code."""
    code = decode_code(request, (yield from ask(request)))
    if code is None:
        raise NoAnswerError(request)
    return code


class Exchange:
    """Run a dialogue: acks in, frames to send out."""

    def __init__(self) -> None:
        self._dialogue: Dialogue[None] | None = None
        self._step: Request | float | None = None
        self._frame = b""
        self._sequence: int | None = None
        self._tries = 0
        self._until_s = 0.0
        self.now_s = 0.0  # time of the last call, for the dialogue
        self.counts = dict.fromkeys(("sent", "sent again", "encrypted acks"), 0)

    def begin(self, dialogue: Dialogue[None]) -> None:
        """Run this endless dialogue from the next ``due`` on, and drop any other."""
        self._dialogue, self._step = dialogue, None

    def take(self, frame: ProtocolFrame, now_s: float) -> None:
        """Take a received frame; acks other than the expected one are ignored."""
        self.now_s = now_s
        waits = self._tries > 0 and not isinstance(self._step, float)
        number = (frame.session, frame.sequence)
        if not (frame.is_ack and waits and number == (SESSION, self._sequence)):
            return
        if frame.is_encrypted:
            self.counts["encrypted acks"] += 1
        else:
            self._go_on(frame.value)

    def due(self, now_s: float) -> bytes:
        """Return the frame to send now; b"" if there is none."""
        self.now_s = now_s
        if self._dialogue is not None and self._step is None:
            self._go_on(None)
        while self._step is not None and now_s >= self._until_s:
            if not isinstance(self._step, float) and self._tries < TRIES:
                self._tries += 1
                self._until_s = now_s + ANSWER_TIMEOUT_S
                self.counts["sent" if self._tries == 1 else "sent again"] += 1
                return self._frame
            self._go_on(None)
        return b""

    def _go_on(self, value: bytes | None) -> None:
        """Send ``value`` into the dialogue and run it up to its next step."""
        assert self._dialogue is not None
        self._step = step = self._dialogue.send(value if self._step is not None else None)
        self._tries = 0
        self._until_s = self.now_s
        if isinstance(step, float):
            self._until_s += step
            return
        # each request has a number of its own, which its repetitions keep; the first is not
        # that of an earlier run of the host, whose repetition it would seem
        last = int(self.now_s * 1e3) if self._sequence is None else self._sequence
        self._sequence = (last + 1) & 0xFFFF
        self._frame = encode_frame(step.data, session=SESSION, sequence=self._sequence)

"""Send requests to the aircraft one after the other, each until it is answered or given up.

A dialogue is a generator. It yields an ``Ask`` (and receives the value of the ack, None if there
is none) or a ``Pause``. So it reads from top to bottom although nothing in it waits.
"""

from __future__ import annotations

from collections.abc import Generator
from typing import NamedTuple, TypeVar

from tirgeo_ros.dji.link.framing import ProtocolFrame, encode_frame
from tirgeo_ros.dji.protocol.commands import Request, decode_code, encode_request

#: A session that wants an ack and may repeat the frame: 2 to 31 are such, DJI's host uses 2.
SESSION = 2
#: The longest request and its ack take 5 ms on the wire at 230400 baud, behind a full line.
ANSWER_TIMEOUT_S = 0.5
TRIES = 4


class Ask(NamedTuple):
    """Send a request and wait for its ack."""

    request: Request


class Pause(NamedTuple):
    """Pause for this time before the next step."""

    seconds: float


T = TypeVar("T")
Dialogue = Generator[Ask | Pause, "bytes | None", T]


class NoAnswerError(Exception):
    """Report a request, held as ``request``, that the aircraft did not answer."""

    def __init__(self, request: Request) -> None:
        super().__init__(request)
        self.request = request


def ask(request: Request) -> Dialogue[bytes]:
    """Return the value of the ack. Raises NoAnswerError if none came."""
    value = yield Ask(request)
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
        self._step: Ask | Pause | None = None
        self._frame = b""
        self._sequence: int | None = None
        self._tries = 0
        self._until_s = 0.0
        self.now_s = 0.0  # time of the last call, for the dialogue
        self.counts = dict.fromkeys(
            ("sent", "sent again", "acks", "acks that nothing waits for", "encrypted acks"), 0
        )

    def begin(self, dialogue: Dialogue[None]) -> None:
        """Run this dialogue from the next ``due`` on, and drop any other."""
        self._dialogue, self._step = dialogue, None

    def take(self, frame: ProtocolFrame, now_s: float) -> None:
        """Take a received frame; count acks other than the expected one."""
        self.now_s = now_s
        if not frame.is_ack:
            return
        number = frame.session, frame.sequence
        waits = isinstance(self._step, Ask) and self._tries > 0
        if not waits or number != (SESSION, self._sequence):
            self.counts["acks that nothing waits for"] += 1
        elif frame.is_encrypted:
            self.counts["encrypted acks"] += 1
        else:
            self.counts["acks"] += 1
            self._go_on(frame.value)

    def due(self, now_s: float) -> bytes:
        """Return the frame to send now; b"" if there is none."""
        self.now_s = now_s
        if self._dialogue is not None and self._step is None:
            self._go_on(None)
        while self._step is not None and now_s >= self._until_s:
            if isinstance(self._step, Ask) and self._tries < TRIES:
                self._tries += 1
                self._until_s = now_s + ANSWER_TIMEOUT_S
                self.counts["sent" if self._tries == 1 else "sent again"] += 1
                return self._frame
            self._go_on(None)
        return b""

    def _go_on(self, value: bytes | None) -> None:
        """Send ``value`` into the dialogue and run it up to its next step."""
        if self._dialogue is None:
            return
        try:
            self._step = self._dialogue.send(value if self._step else None)
        except StopIteration:
            self._dialogue = self._step = None
            return
        self._until_s = self.now_s
        if isinstance(self._step, Pause):
            self._until_s += self._step.seconds
        else:
            self._prepare(self._step.request)

    def _prepare(self, request: Request) -> None:
        """Give the request its own sequence number; its repetitions keep it."""
        # not that of an earlier run of the host, whose repetition it would seem
        if self._sequence is None:
            self._sequence = int(self.now_s * 1e3)
        self._sequence = (self._sequence + 1) & 0xFFFF
        self._frame = encode_frame(
            encode_request(request), session=SESSION, sequence=self._sequence
        )
        self._tries = 0

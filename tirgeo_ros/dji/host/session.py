"""Decide what the host asks of the aircraft, and when; nothing at all unless it is configured.

The order is activation, broadcast rates, subscription. What fails is tried again after growing
pauses and does not hold up the rest. When the aircraft falls silent, for example because it is
switched off and on, everything is asked for again. Without an activated application the aircraft
only broadcasts.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from enum import Enum
from typing import TypeVar

from tirgeo_ros.core.config.dji_parameters import RATE_CODES, DjiHostConfig
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.link.framing import ProtocolFrame, encode_frame
from tirgeo_ros.dji.protocol.commands import (
    GET_VERSION,
    MATCH_VERSION,
    NOT_ACTIVATED,
    PACKAGE_IDS,
    RESET_PACKAGES,
    Request,
    VersionAck,
    activate,
    decode_code,
    decode_version_ack,
    explain,
    remove_package,
    set_rates,
)
from tirgeo_ros.dji.protocol.subscription import BY_NAME, Package, PackageTable

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
    """Run a dialogue: acks in, frames to send out, one request after the other.

    A dialogue is a generator. It yields a request (and receives the value of the ack, None if
    there is none) or the seconds of a pause. So it reads from top to bottom although nothing in
    it waits.
    """

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


_DONE, _UNKNOWN_TOPIC, _OFFLINE = 0x00, 0x22, 0x25
#: Answers that another try does not change: done, or refused for the request's length, version,
#: id, rate or size, or for its topics.
_FINAL = {_DONE, 0x01, 0x02, 0x03, 0x06, 0x07, 0x20, 0x21, _UNKNOWN_TOPIC}
_NEEDS_ACTIVATION = {0x23, 0x50}
#: Topics that are left out when a package is refused with this code: those that an M600 does not
#: know (they were announced, or belong to other aircraft), and those of RTK hardware that is
#: absent or off.
_DISPENSABLE = {
    _UNKNOWN_TOPIC: {"RTK_CONNECT_STATUS", "GIMBAL_CONTROL_MODE", "HEIGHT_FUSION"},
    _OFFLINE: {name for name in BY_NAME if name.startswith("RTK_")},
}


class Subscriber:
    """Manage the subscription of the packages ``wanted``, which may be none.

    While it runs, ``table`` is kept to what the aircraft pushes: the packages that it accepted.
    """

    def __init__(self, packages: Sequence[Package], table: PackageTable) -> None:
        self._packages, self._table = packages, table
        self.forget()

    def forget(self) -> None:
        """Mark everything as not asked for; the table stays until the aircraft is asked."""
        self._is_clean = False  # versions match and no package of another host is left
        self._asked: set[int] = set()
        self._answers: dict[int, int] = {}  # package's id -> code of its last refusal, or 0
        self.problems: dict[int, str] = {}  # of packages that are not fully subscribed

    @property
    def has_packages(self) -> bool:
        """Return whether the aircraft pushes a package that was asked for."""
        return any(number in self._table for number in self._answers)

    @property
    def is_open(self) -> bool:
        """Return whether another try may bring a package."""
        return any(self._answers.get(package.id) not in _FINAL for package in self._packages)

    def run(self) -> Dialogue[str]:
        """Ask for everything that is open; return "" or why nothing can be subscribed to.

        Raises NoAnswerError if the aircraft does not answer.
        """
        if not self._is_clean:
            refusal = yield from self._clean()
            if refusal:
                return refusal
        for package in self._packages:
            if self._answers.get(package.id) not in _FINAL:
                yield from self._add(package)
                if self._answers[package.id] in _NEEDS_ACTIVATION:
                    return self.problems[package.id]
        return ""

    def _clean(self) -> Dialogue[str]:
        """Match versions; remove the packages that this or another host left behind."""
        code = yield from ask_code(MATCH_VERSION)
        if code != _DONE:
            return explain(MATCH_VERSION, code)
        if (yield from ask_code(RESET_PACKAGES)) != _DONE:
            for number in PACKAGE_IDS:
                yield from ask_code(remove_package(number))
        self._table.clear()
        self._is_clean = True
        return ""

    def _add(self, asked: Package) -> Dialogue[None]:
        """Add a package, without the dispensable topics for which it is refused."""
        number, package, answer = asked.id, asked, _DONE
        if number in self._asked:  # it may be there in part, or its ack was lost
            yield from ask_code(remove_package(number))
            self._table.pop(number, None)
        self._asked.add(number)
        while (code := (yield from ask_code(package.request))) != _DONE:
            answer = _OFFLINE if _OFFLINE in {answer, code} else code
            left_out = _DISPENSABLE.get(code, set())
            topics = tuple(topic for topic in package.topics if topic.name not in left_out)
            if not topics or len(topics) == len(package.topics):
                break
            package = package._replace(topics=topics)
        else:
            self._table[number] = package
        self._answers[number] = answer
        self.problems.pop(number, None)
        if answer != _DONE:
            missing = [topic.name for topic in asked.topics if topic not in package.topics]
            what = f"is without {', '.join(missing)}" if number in self._table else "refused"
            self.problems[number] = f"package {number} {what}: {explain(asked.request, answer)}"


_SUBSCRIPTION_PUSH = (0x02, 0x05)
_NEW_DEVICE = 3
#: At a new device's first try DJI GO fetches the permission from DJI; the second try finds it.
_SECOND_TRY_S = 1.0
_LOOK_S = 0.5  # between checks of what is still to be done
_FIRST_PAUSE_S = 1.0  # before the first new try, doubled each time
_LONGEST_PAUSE_S = 30.0
# limit while nothing answers, since the aircraft may be switched on later
_LONGEST_UNANSWERED_S = 5.0
#: The aircraft may be silent for this long; doubled at each silence, and reset after
#: _LONGEST_PATIENCE_S without one.
_PATIENCE_S, _LONGEST_PATIENCE_S = 3.0, 60.0


class HostState(Enum):
    """List the states of the host's requests."""

    LISTENING = "listening"  # there is nothing to ask for
    ASKING = "asking"
    READY = "ready"
    NO_ANSWER = "no_answer"
    NOT_ACTIVATED = "not_activated"
    INCOMPLETE = "incomplete"  # rates or packages were refused


#: Names of what can be wrong, the worst first.
_PROBLEMS = {
    "answer": HostState.NO_ANSWER,
    "activation": HostState.NOT_ACTIVATED,
    "rates": HostState.INCOMPLETE,
    "subscription": HostState.INCOMPLETE,
}


class HostSession:
    """Take received frames and return bytes to send; the caller's clock must be monotonic.

    ``packages`` are those to subscribe to; from then on the table is kept to what the aircraft
    pushes. ``key`` only tells that encrypted answers can be read: requests are sent plain, as
    DJI's own host does. Raises DjiError if a broadcast rate is no rate code.
    """

    def __init__(
        self, config: DjiHostConfig, packages: PackageTable, key: bytes | None = None
    ) -> None:
        self._has_key = key is not None
        self._app_id = config.app_id
        self._rates = _rates(config)
        self._activates = bool(config.app_id or config.subscribe)
        self._exchange = Exchange()
        asked = [packages[number] for number in sorted(packages)] if config.subscribe else []
        self._subscriber = Subscriber(asked, packages)
        self._forget()
        self._failures = 0  # rounds in a row that left something undone
        self._patience_s = _PATIENCE_S
        self._listens = self._rates is None and not self._activates
        if not self._listens:
            self._exchange.begin(self._talk())

    def _forget(self) -> None:
        """Forget the aircraft: it may be another one or may have been switched off."""
        # time of the last frame, or push where there are packages; None: none since the silence
        self._heard_s: float | None = None
        self._problems = dict.fromkeys(_PROBLEMS, "")
        self._version: VersionAck | None = None
        self._is_active = not self._activates
        self._rates_set = self._rates is None
        self._subscriber.forget()

    @property
    def state(self) -> HostState:
        """Return the state; a problem takes precedence over the round in progress."""
        if self._listens:
            return HostState.LISTENING
        for name, text in self._problems.items():
            if text:
                return _PROBLEMS[name]
        if self._subscriber.problems:
            return HostState.INCOMPLETE
        return HostState.ASKING if self._is_open else HostState.READY

    @property
    def message(self) -> str:
        """Return a line for a person: the aircraft and the problems, or else the state."""
        if self._listens:
            return "listening only: no requests are sent to the aircraft"
        problems = [*self._problems.values(), *self._subscriber.problems.values()]
        notes = list(filter(None, problems)) or [self.state.value]
        return "; ".join(filter(None, [self._aircraft, *notes]))

    @property
    def _aircraft(self) -> str:
        """Return hardware and firmware in words; "" as long as they are not known."""
        if self._version is None or self._version.firmware is None:
            return ""
        numbers = ".".join(map(str, self._version.firmware))
        return f"{self._version.hardware} with firmware {numbers}"

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return state, aircraft and counts, under names that begin with ``host``."""
        values = {"state": self.state.value}
        if self._version:
            values |= {"aircraft": self._aircraft, "serial number": self._version.serial}
        values |= {name: str(count) for name, count in self._exchange.counts.items()}
        return {f"host {name}": value for name, value in values.items()}

    def take(self, frame: ProtocolFrame, now_s: float) -> None:
        """Take a received frame of any kind."""
        if self._listens:
            return
        if self._heard_s is None:  # it was switched on just now: no need to wait any longer
            self._failures = 0
        is_push = (frame.cmd_set, frame.cmd_id) == _SUBSCRIPTION_PUSH
        if is_push or self._heard_s is None or not self._subscriber.has_packages:
            self._heard_s = now_s
        self._exchange.take(frame, now_s)

    def due(self, now_s: float) -> bytes:
        """Return the frame to send now; b"" if there is none."""
        return self._exchange.due(now_s)

    def restart(self) -> None:
        """Begin again: the port was opened again, possibly with another aircraft behind it."""
        if self._listens:
            return
        self._forget()
        self._failures, self._patience_s = 0, _PATIENCE_S
        self._exchange.begin(self._talk())

    def _talk(self) -> Dialogue[None]:
        while True:
            yield from self._round()
            yield from self._wait()

    def _round(self) -> Dialogue[None]:
        """Ask for everything that is not done; a missing answer does not hold up the rest."""
        unanswered = ""
        for part in (self._activate, self._set_rates, self._subscribe):
            try:
                yield from part()
            except NoAnswerError:  # noqa: PERF203  the rest is asked for all the same
                unanswered = self._unanswered()
        self._problems["answer"] = unanswered
        self._failures = self._failures + 1 if self._is_open else 0

    def _activate(self) -> Dialogue[None]:
        """Ask for the version and activate; without an app id, ask whether one is activated."""
        if self._is_active:
            return
        self._version = decode_version_ack((yield from ask(GET_VERSION)))
        if self._version is None:
            raise NoAnswerError
        if self._app_id:
            request = activate(self._app_id, self._version.firmware or (0, 0, 0, 0))
            code = yield from ask_code(request)
            if code == _NEW_DEVICE:
                yield _SECOND_TRY_S
                code = yield from ask_code(request)
            self._is_active = code == _DONE
            refusal = f"activation failed, {explain(request, code)}"
        else:
            self._is_active = self._version.code != NOT_ACTIVATED
            refusal = f"it is {explain(GET_VERSION, self._version.code)}"
        self._problems["activation"] = "" if self._is_active else refusal

    def _set_rates(self) -> Dialogue[None]:
        if self._rates is None or self._rates_set:
            return
        code = yield from ask_code(self._rates)
        self._rates_set = code == _DONE
        refusal = f"broadcast rates: {explain(self._rates, code)}"
        self._problems["rates"] = "" if self._rates_set else refusal

    def _subscribe(self) -> Dialogue[None]:
        if not (self._is_active and self._subscriber.is_open):
            return
        refusal = yield from self._subscriber.run()
        self._problems["subscription"] = refusal and f"subscription: {refusal}"
        if refusal:  # the aircraft may have been switched off and on meanwhile
            self._is_active = False
            self._subscriber.forget()

    def _wait(self) -> Dialogue[None]:
        """Wait until there is something to ask for."""
        begun_s = self._exchange.now_s
        while True:
            yield _LOOK_S
            now_s = self._exchange.now_s
            if self._heard_s is not None and now_s - self._heard_s > self._patience_s:
                self._patience_s = min(2 * self._patience_s, _LONGEST_PATIENCE_S)
                self._forget()
                return
            if self._is_open and now_s - begun_s >= self._pause_s:
                return
            if now_s - begun_s > _LONGEST_PATIENCE_S:
                self._patience_s = _PATIENCE_S

    @property
    def _is_open(self) -> bool:
        """Return whether something is left to ask for."""
        return not (self._is_active and self._rates_set) or self._subscriber.is_open

    @property
    def _pause_s(self) -> float:
        """Return the time from the end of a round to the next one, in seconds."""
        if not self._failures:
            return 0.0
        longest_s = _LONGEST_UNANSWERED_S if self._problems["answer"] else _LONGEST_PAUSE_S
        return min(_FIRST_PAUSE_S * 2.0 ** min(self._failures - 1, 10), longest_s)

    def _unanswered(self) -> str:
        if self._exchange.counts["encrypted acks"]:
            wrong = "check key" if self._has_key else "set key to that of the application"
            return f"the aircraft's answers are encrypted: {wrong}"
        if self._heard_s is None:
            return "the aircraft does not answer"
        return "the aircraft sends but does not answer: check the wire from the host's TX"


def _rates(config: DjiHostConfig) -> Request | None:
    """Return the request for rates; None without any. Raises DjiError for one that is no code."""
    for rate in config.broadcast_rates:
        if rate not in range(RATE_CODES):
            raise DjiError(
                f"host.broadcast_rates: {rate:g} is not a rate code (0 to {RATE_CODES - 1})"
            )
    return set_rates([*map(int, config.broadcast_rates)]) if config.broadcast_rates else None

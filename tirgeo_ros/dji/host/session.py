"""Decide what the host asks of the aircraft, and when; nothing at all unless it is configured.

The order is activation, broadcast rates, subscription. What fails is tried again after growing
pauses and does not hold up the rest. When the aircraft falls silent, for example because it is
switched off and on, everything is asked for again.
"""

from __future__ import annotations

from enum import Enum

from tirgeo_ros.core.config.dji import RATE_CODES, DjiHostConfig
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.host.activation import Activation
from tirgeo_ros.dji.host.requests import Dialogue, Exchange, NoAnswerError, Pause, ask
from tirgeo_ros.dji.host.subscriber import Subscriber
from tirgeo_ros.dji.link.framing import ProtocolFrame
from tirgeo_ros.dji.protocol.commands import SetRates, decode_code, encode_request, explain
from tirgeo_ros.dji.protocol.subscription import PackageTable

_SUBSCRIPTION_PUSH = (0x02, 0x05)
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
    ACTIVATING = "activating"
    SETTING_RATES = "setting_rates"
    SUBSCRIBING = "subscribing"
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
        self._rates = _rates(config)
        self._rates_set = self._rates is None
        self._exchange = Exchange()
        self._activates = bool(config.app_id or config.subscribe)
        self._activation = Activation(config.app_id)
        wanted = [packages[number] for number in sorted(packages)] if config.subscribe else []
        self._subscriber = Subscriber(wanted, packages, self._exchange)
        self._busy = HostState.ACTIVATING if self._activates else HostState.SETTING_RATES
        self._problems: dict[str, str] = {}
        # time of the last frame; None: none since it fell silent
        self._heard_s: float | None = None
        self._patience_s = _PATIENCE_S
        self._failures = 0  # rounds in a row that left something undone
        self._rounds = 0
        self._listens = self._rates is None and not self._activates
        if not self._listens:
            self._exchange.begin(self._talk())

    @property
    def state(self) -> HostState:
        """Return the state; a problem takes precedence over the step in progress."""
        if self._listens:
            return HostState.LISTENING
        return next((state for state, _ in self._wrong), self._busy)

    @property
    def message(self) -> str:
        """Return a line for a person: the aircraft and the problems, or else the current step."""
        if self._listens:
            return "listening only: nothing is asked of the aircraft"
        problems = [text for _, text in self._wrong] or [self._busy.value.replace("_", " ")]
        return "; ".join(filter(None, [self._activation.aircraft, *problems]))

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return state, aircraft, packages and counts, under names that begin with ``host``."""
        values = {"state": self.state.value, "rounds": str(self._rounds)}
        if self._activation.version:
            values["aircraft"] = self._activation.aircraft
            values["serial number"] = self._activation.version.serial
        values |= self._subscriber.diagnostics
        values |= {name: str(count) for name, count in self._exchange.counts.items()}
        return {f"host {name}": value for name, value in values.items()}

    def take(self, frame: ProtocolFrame, now_s: float) -> None:
        """Take a received frame of any kind."""
        if self._listens:
            return
        if self._heard_s is None:  # it was switched on just now: no need to wait any longer
            self._failures = 0
        self._heard_s = now_s
        if (frame.cmd_set, frame.cmd_id) == _SUBSCRIPTION_PUSH:
            self._subscriber.hear(frame.value, now_s)
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

    def _forget(self) -> None:
        self._heard_s = None
        self._problems.clear()
        self._rates_set = self._rates is None
        self._activation.forget()
        self._subscriber.forget()

    def _talk(self) -> Dialogue[None]:
        while True:
            yield from self._round()
            yield from self._watch()

    def _round(self) -> Dialogue[None]:
        """Ask for everything that is not done; a missing answer does not hold up the rest."""
        self._rounds += 1
        unanswered = ""
        for part in (self._activate, self._set_rates, self._subscribe):
            try:
                yield from part()
            except NoAnswerError:  # noqa: PERF203  the rest is asked for all the same
                unanswered = self._unanswered()
        self._note("answer", unanswered)
        self._busy = HostState.READY
        self._failures = self._failures + 1 if self._is_open else 0

    def _activate(self) -> Dialogue[None]:
        if self._activates and not self._activation.is_done:
            self._busy = HostState.ACTIVATING
            self._note("activation", (yield from self._activation.run()))

    def _set_rates(self) -> Dialogue[None]:
        if self._rates is not None and not self._rates_set:
            self._busy = HostState.SETTING_RATES
            code = decode_code(self._rates, (yield from ask(self._rates)))
            self._rates_set = code == 0
            refusal = "refused without a code" if code is None else explain(self._rates, code)
            self._note("rates", "" if code == 0 else f"broadcast rates: {refusal}")

    def _subscribe(self) -> Dialogue[None]:
        if self._activation.is_done and self._subscriber.is_open:
            self._busy = HostState.SUBSCRIBING
            refusal = yield from self._subscriber.run()
            self._note("subscription", refusal and f"subscription: {refusal}")
            if refusal:  # the aircraft may have been switched off and on meanwhile
                self._activation.is_done = False

    def _watch(self) -> Dialogue[None]:
        """Wait until there is something to ask for."""
        begun_s = self._exchange.now_s
        while True:
            yield Pause(_LOOK_S)
            now_s = self._exchange.now_s
            if self._falls_silent(now_s):
                self._forget()
                return
            if self._is_open and now_s - begun_s >= self._pause_s:
                return
            if now_s - begun_s > _LONGEST_PATIENCE_S:
                self._patience_s = _PATIENCE_S

    def _falls_silent(self, now_s: float) -> bool:
        """Return whether all frames, or the pushes of all added packages, have stopped."""
        if self._heard_s is not None and now_s - self._heard_s > self._patience_s:
            self._patience_s = min(2 * self._patience_s, _LONGEST_PATIENCE_S)
            return True
        return self._subscriber.note_silence(now_s)

    @property
    def _is_open(self) -> bool:
        """Return whether something is left to ask for."""
        inactive = self._activates and not self._activation.is_done
        return inactive or not self._rates_set or self._subscriber.is_open

    @property
    def _pause_s(self) -> float:
        """Return the time from the end of a round to the next one, in seconds."""
        if not self._failures:
            return 0.0
        longest_s = _LONGEST_UNANSWERED_S if "answer" in self._problems else _LONGEST_PAUSE_S
        return min(_FIRST_PAUSE_S * 2.0 ** min(self._failures - 1, 10), longest_s)

    @property
    def _wrong(self) -> list[tuple[HostState, str]]:
        """Return the problems, the worst first."""
        told = [
            (s, self._problems[name]) for name, s in _PROBLEMS.items() if name in self._problems
        ]
        return told + [(HostState.INCOMPLETE, text) for text in self._subscriber.problems]

    def _note(self, name: str, problem: str) -> None:
        self._problems.pop(name, None)
        if problem:
            self._problems[name] = problem

    def _unanswered(self) -> str:
        if self._exchange.counts["encrypted acks"]:
            wrong = "check key" if self._has_key else "set key to the application's"
            return f"the aircraft's answers are encrypted: {wrong}"
        if self._heard_s is None:
            return "the aircraft does not answer"
        return "the aircraft sends but does not answer: check the wire from the host's TX"


def _rates(config: DjiHostConfig) -> SetRates | None:
    """Return the request for rates; None without any.

    Raises DjiError if a rate is no rate code.
    """
    for rate in config.broadcast_rates:
        if rate not in range(RATE_CODES):
            raise DjiError(
                f"host.broadcast_rates: {rate:g} is no rate code (0 to {RATE_CODES - 1})"
            )
    if not config.broadcast_rates:
        return None
    request = SetRates(tuple(int(rate) for rate in config.broadcast_rates))
    encode_request(request)  # raises DjiError for a wrong number of rates
    return request

"""An aircraft that answers a host as a script says, and a host's session that flies with it."""

from __future__ import annotations

from tirgeo_ros.core.config.dji import DjiHostConfig
from tirgeo_ros.dji.host.session import HostSession
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.protocol.commands import (
    NOT_ACTIVATED,
    Activate,
    AddPackage,
    GetVersion,
    MatchVersion,
    RemovePackage,
    ResetPackages,
    SetRates,
    decode_request,
    encode_code,
    encode_version_ack,
)
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, Package, PackageTable

STEP_S = 0.01
RATES = (4, 3, 4, 3, 4, 3, 3, 3, 2, 0, 3, 2, 1, 1, 5, 5)
FULL = DjiHostConfig(app_id=1234, broadcast_rates=tuple(map(float, RATES)), subscribe=True)
RTK = Package.of(0, 5, with_timestamp=True, names=("RTK_POSITION", "RTK_YAW"))
FAST = Package.of(3, 400, with_timestamp=True, names=("HARD_SYNC",))
GIMBAL = Package.of(1, 50, with_timestamp=True, names=("GIMBAL_ANGLES", "GIMBAL_CONTROL_MODE"))


class Aircraft:
    """Does what it is asked, as an M600 does; ``refusals`` gives codes to requests instead.

    ``refusals``: what is called with a request; a code, or None to do it.
    ``route``: what is called with an ack's bytes; the (delay, bytes) that arrive of it.
    """

    def __init__(self):
        self.reader = FrameReader()
        self.refusals = lambda _: None
        self.route = lambda ack: [(0.0, ack)]
        self.is_on = True
        self.asked = []
        self.switch_off_and_on()
        self.key = None

    def switch_off_and_on(self):
        self.activated, self.rates, self.packages = False, None, {}
        self.answered = {}

    def take(self, data):
        """The acks to what the host sent, as they arrive: (delay, bytes)."""
        if not self.is_on:
            return []
        return [part for frame in self.reader.feed(data) for part in self.route(self.ack(frame))]

    def ack(self, frame):
        """A repeated frame of a reliable session gets its ack again and is not done again."""
        request = decode_request(frame.data)
        assert request is not None, frame
        assert frame.session >= 2
        self.asked.append(request)
        number = (frame.sequence, request)
        if number not in self.answered:
            self.answered[number] = self.done(request)
        return encode_frame(
            self.answered[number],
            session=frame.session,
            sequence=frame.sequence,
            is_ack=True,
            key=self.key,
        )

    def done(self, request):
        if isinstance(request, GetVersion):
            return encode_version_ack(0 if self.activated else NOT_ACTIVATED, "03Z0CA3008")
        code = self.refusals(request)
        return encode_code(request, self.do(request) if code is None else code)

    def do(self, request):
        match request:
            case Activate():
                self.activated = True
            case SetRates(codes):
                self.rates = codes
            case _ if not self.activated:
                return 0x23
            case MatchVersion():
                pass
            case ResetPackages():
                self.packages.clear()
            case RemovePackage(number):
                return 0 if self.packages.pop(number, None) else 5
            case AddPackage(number) if number in self.packages:
                return 4
            case AddPackage(number):
                self.packages[number] = request
        return 0

    def pushes(self):
        return [encode_frame(bytes((2, 5, number, 0))) for number in self.packages]


class Flight:
    """Session and aircraft on one clock; pushes come every 0.2 s and a broadcast with them."""

    def __init__(self, config=FULL, packages=USUAL_PACKAGES, key=None):
        self.table = PackageTable(packages)
        self.session = HostSession(config, self.table, key)
        self.aircraft = Aircraft()
        self.reader = FrameReader(key)
        self.now_s = 5000.0
        self.air = []  # (arrival, bytes)
        self.sent = b""
        self.states = []
        self.broadcasts = True
        self.next_push_s = 0.0

    def fly(self, seconds, until=None):
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.now_s += STEP_S
            self.step()
            if until is not None and self.session.state is until:
                return self
        assert until is None, (self.session.message, self.session.diagnostics)
        return self

    def step(self):
        data = self.session.due(self.now_s)
        self.sent += data
        self.air += [(self.now_s + delay, part) for delay, part in self.aircraft.take(data)]
        if self.now_s >= self.next_push_s and self.aircraft.is_on:
            self.next_push_s = self.now_s + 0.2
            pushes = self.aircraft.pushes()
            pushes += [encode_frame(bytes((2, 0, 0, 0)))] if self.broadcasts else []
            self.air += [(self.now_s, part) for part in pushes]
        arrived = [part for at_s, part in self.air if at_s <= self.now_s]
        self.air = [(at_s, part) for at_s, part in self.air if at_s > self.now_s]
        for frame in self.reader.feed(b"".join(arrived)):
            self.session.take(frame, self.now_s)
        if not self.states or self.states[-1] is not self.session.state:
            self.states.append(self.session.state)

    @property
    def kinds(self):
        return [type(request).__name__ for request in self.aircraft.asked]

    @property
    def known(self):
        return sorted(self.table)

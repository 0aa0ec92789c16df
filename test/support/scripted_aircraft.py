"""An aircraft that answers a host as a script says, and a host's session that flies with it."""

from __future__ import annotations

from tirgeo_ros.core.config.dji_parameters import DjiHostConfig
from tirgeo_ros.dji.host.session import HostSession
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.protocol.commands import decode_request
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, Package, PackageTable
from tirgeo_ros.dji.simulator import CommandDesk

STEP_S = 0.01
RATES = (4, 3, 4, 3, 4, 3, 3, 3, 2, 0, 3, 2, 1, 1, 2, 2)
FULL = DjiHostConfig(app_id=1234, broadcast_rates=tuple(map(float, RATES)), subscribe=True)
RTK = Package.of(0, 5, with_timestamp=True, names=("RTK_POSITION", "RTK_YAW"))
FAST = Package.of(3, 400, with_timestamp=True, names=("HARD_SYNC",))


class Aircraft(CommandDesk):
    """Does what it is asked, as an M600 does; ``refusals`` gives codes to requests instead.

    ``refusals``: what is called with a request; a code, or None to do it.
    ``route``: what is called with an ack's bytes; the (delay, bytes) that arrive of it.
    """

    def __init__(self):
        super().__init__()
        self.refusals = lambda _: None
        self.route = lambda ack: [(0.0, ack)]
        self.is_on = True
        self.asked = []  # requests, also repeated ones

    def switch_off_and_on(self):
        self.activated, self.rates = False, ()
        self.packages.clear()

    def take(self, data):
        """The acks to what the host sent, as they arrive: (delay, bytes)."""
        if not self.is_on:
            return []
        self.asked += [decode_request(frame.data) for frame in FrameReader().feed(data)]
        ack = self.answer(data)
        return self.route(ack) if ack else []

    def do(self, request):
        code = self.refusals(request)
        return super().do(request) if code is None else code

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

    @property
    def kinds(self):
        return [request.opcode.name for request in self.aircraft.asked]

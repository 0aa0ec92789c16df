"""The host's side against an aircraft that answers as a script says: well, late, never, twice."""

from __future__ import annotations

import random

import pytest

from tirgeo_ros.core.config.dji_parameters import DjiHostConfig
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.host.session import HostSession, HostState
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.protocol.commands import (
    MATCH_VERSION,
    Opcode,
    activate,
    decode_request,
    remove_package,
)
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


KEY = bytes(range(32))


def ready(flight):
    return flight.fly(60.0, HostState.READY)


def refusing(code, kind, number=None):
    """What refuses requests of a kind, or those of one package."""
    return lambda r: code if r.opcode is kind and number in {None, r.value[0]} else None


def test_the_default_sends_nothing_whatever_comes():
    flight = Flight(DjiHostConfig())
    flight.fly(10.0)
    flight.session.restart()
    flight.fly(10.0)
    assert flight.sent == b""
    assert flight.session.state is HostState.LISTENING
    assert flight.session.message == "listening only: no requests are sent to the aircraft"
    assert flight.table == PackageTable()


def test_all_is_asked_for_in_order():
    flight = ready(Flight())
    assert flight.kinds == [
        *("GET_VERSION", "ACTIVATE", "SET_RATES", "MATCH_VERSION", "RESET_PACKAGES"),
        *["ADD_PACKAGE"] * 5,
    ]
    assert flight.aircraft.asked[1] == activate(1234, (3, 2, 41, 13))
    assert flight.aircraft.asked[-2].value == bytes.fromhex("03 9001 01 01 6df0beec")
    assert flight.aircraft.rates == RATES
    assert flight.aircraft.packages == flight.table == PackageTable()
    assert flight.session.message == "PM820V3PRO with firmware 3.2.41.13; ready"


def test_a_lost_ack_is_asked_for_again_under_the_same_number():
    flight = Flight()
    lost = [True, False, True, True, False] + [False] * 50
    flight.aircraft.route = lambda ack: [] if lost.pop(0) else [(0.0, ack)]
    ready(flight)
    assert flight.kinds[:5] == ["GET_VERSION", "GET_VERSION", "ACTIVATE", "ACTIVATE", "ACTIVATE"]
    frames = FrameReader().feed(flight.sent)
    assert frames[0] == frames[1]._replace(offset=frames[0].offset)
    assert flight.session.diagnostics["host sent again"] == "3"


def test_acks_of_others_are_not_taken():
    flight = Flight(DjiHostConfig(app_id=5))

    def foreign(ack):  # right number, other session; then right session, other number
        (frame,) = FrameReader().feed(ack)
        number = frame.sequence
        return [
            (0.0, encode_frame(frame.data, session=session, sequence=sequence, is_ack=True))
            for session, sequence in [(3, number), (2, number + 1 & 0xFFFF), (0, number)]
        ]

    flight.aircraft.route = foreign
    flight.fly(3.0)
    assert flight.session.state is HostState.NO_ANSWER
    assert not flight.aircraft.activated


@pytest.mark.parametrize("seed", range(6))
def test_over_a_bad_line_it_gets_there(seed):
    chance = random.Random(seed)
    flight = Flight()
    flight.aircraft.route = lambda ack: [
        (chance.uniform(0.0, 1.5), ack) for _ in range(chance.choice([0, 0, 1, 1, 2]))
    ]
    flight.fly(300.0, HostState.READY)
    assert flight.aircraft.activated
    assert flight.aircraft.rates == RATES
    assert flight.aircraft.packages == flight.table == PackageTable()


def test_an_aircraft_that_does_not_answer():
    flight = Flight()
    flight.aircraft.route = lambda _: []
    flight.fly(60.0)
    assert flight.session.state is HostState.NO_ANSWER
    assert "sends but does not answer: check the wire from the host's TX" in flight.session.message
    # Version and rates, four times each, in rounds that are 5 s apart in the end.
    assert 20 < len(flight.aircraft.asked) < 90
    assert flight.table == PackageTable()  # what it may push is still read
    flight.aircraft.route = lambda ack: [(0.0, ack)]
    flight.fly(12.0, HostState.READY)


def test_an_aircraft_that_is_switched_on_later():
    flight = Flight()
    flight.aircraft.is_on = False
    flight.fly(60.0)
    assert flight.session.message == "the aircraft does not answer"
    flight.aircraft.is_on = True
    flight.fly(1.0, HostState.READY)  # its first broadcast ends the pause


@pytest.mark.parametrize(
    ("code", "words"),
    [(3, "connect a phone or tablet with DJI GO"), (1, "host.app_id")],
)
def test_a_refused_activation_is_told_and_tried_again_with_pauses(code, words):
    flight = Flight()
    flight.aircraft.refusals = refusing(code, Opcode.ACTIVATE)
    flight.fly(100.0)
    assert flight.session.state is HostState.NOT_ACTIVATED
    assert words in flight.session.message
    assert flight.aircraft.rates == RATES  # these do not wait for it
    assert flight.kinds.count("ACTIVATE") < 20
    assert "ADD_PACKAGE" not in flight.kinds
    flight.aircraft.refusals = lambda _: None  # somebody did what the message says
    flight.fly(31.0, HostState.READY)
    assert sorted(flight.table) == [0, 1, 2, 3, 4]


def test_a_subscription_without_app_id_is_tried_where_it_is_activated_already():
    flight = Flight(DjiHostConfig(subscribe=True))
    flight.fly(2.0)
    assert flight.session.state is HostState.NOT_ACTIVATED
    assert "not activated: set host.app_id" in flight.session.message
    assert set(flight.kinds) == {"GET_VERSION"}
    flight.aircraft.activated = True
    flight.fly(31.0, HostState.READY)
    assert "ACTIVATE" not in flight.kinds


@pytest.mark.parametrize("at", [MATCH_VERSION, USUAL_PACKAGES[2].request])
def test_an_activation_that_is_lost_midway_is_asked_for_anew(at):
    flight = Flight()
    lost = []

    def refusals(request):
        if request == at and not lost:
            lost.append(request)
            flight.aircraft.switch_off_and_on()
            return 0x23
        return None

    flight.aircraft.refusals = refusals
    flight.fly(20.0, HostState.READY)
    assert flight.kinds.count("ACTIVATE") == 2
    assert flight.aircraft.packages == flight.table == PackageTable()


def test_a_quick_reboot_is_noticed_by_the_pushes_that_stop():
    flight = ready(Flight())
    flight.aircraft.switch_off_and_on()  # the broadcast goes on
    flight.aircraft.rates = (0,) * 16
    flight.fly(5.0)
    flight.fly(2.0, HostState.READY)
    assert flight.aircraft.rates == RATES
    assert flight.aircraft.packages == PackageTable()


def test_the_link_opened_again():
    flight = ready(Flight())
    flight.aircraft.asked.clear()
    flight.session.restart()
    ready(flight)
    assert flight.kinds[:2] == ["GET_VERSION", "ACTIVATE"]
    assert flight.kinds[-1] == "ADD_PACKAGE"
    frames = FrameReader().feed(flight.sent)
    assert len({frame.sequence for frame in frames}) == len(frames)


def encrypted(ack):
    (frame,) = FrameReader().feed(ack)
    number = {"session": frame.session, "sequence": frame.sequence}
    return [(0.0, encode_frame(frame.data, **number, is_ack=True, key=KEY))]


def test_encrypted_answers_need_the_key():
    pytest.importorskip("cryptography")
    flight = Flight()
    flight.aircraft.route = encrypted
    flight.fly(5.0)
    assert flight.session.state is HostState.NO_ANSWER
    assert "answers are encrypted: set key to that of the application" in flight.session.message
    with_key = Flight(key=KEY)
    with_key.aircraft.route = encrypted
    ready(with_key)


def test_where_the_reset_fails_each_is_removed():
    flight = Flight(packages=[RTK])
    flight.aircraft.packages |= {0: FAST, 4: FAST}
    flight.aircraft.refusals = refusing(0x08, Opcode.RESET_PACKAGES)
    ready(flight)
    removed = [r for r in flight.aircraft.asked if r.opcode is Opcode.REMOVE_PACKAGE]
    assert removed == [*map(remove_package, range(5))]
    assert flight.aircraft.packages == flight.table == {0: RTK}


@pytest.mark.parametrize("code", [0x06, 0x07, 0x20, 0x22])
def test_a_package_refused_for_good_does_not_stop_the_others(code):
    flight = Flight()
    flight.aircraft.refusals = wrong = refusing(code, Opcode.ADD_PACKAGE, 3)
    flight.fly(100.0)
    assert sorted(flight.table) == sorted(flight.aircraft.packages) == [0, 1, 2, 4]
    assert flight.session.state is HostState.INCOMPLETE
    assert "package 3 refused: " in flight.session.message
    assert sum(wrong(r) is not None for r in flight.aircraft.asked) == 1


def test_topics_that_are_unknown_or_offline_are_left_out_and_the_latter_tried_again():
    """RTK that is switched on later is found; GIMBAL_CONTROL_MODE this aircraft never has."""
    names = ("GPS_DATE", "RTK_YAW", "GIMBAL_CONTROL_MODE")
    mixed = Package.of(2, 5, with_timestamp=True, names=names)
    yaw = mixed.topics[1].uid.to_bytes(4, "little")
    flight = Flight(packages=[mixed])
    flight.aircraft.refusals = lambda r: (
        0x25 if r.opcode is Opcode.ADD_PACKAGE and yaw in r.value else None
    )
    flight.fly(50.0)
    assert [topic.name for topic in flight.table[2].topics] == ["GPS_DATE"]
    without = "without RTK_YAW, GIMBAL_CONTROL_MODE: the source of a topic is off"
    assert without in flight.session.message
    flight.aircraft.refusals = lambda _: None
    flight.fly(31.0)
    assert [topic.name for topic in flight.table[2].topics] == ["GPS_DATE", "RTK_YAW"]
    assert flight.aircraft.packages == flight.table


def test_what_cannot_be_asked_for_is_an_error_at_the_start():
    with pytest.raises(DjiError, match=r"host.broadcast_rates: 2.5 is not a rate code"):
        HostSession(DjiHostConfig(broadcast_rates=(2.5,) + (5.0,) * 15), PackageTable())

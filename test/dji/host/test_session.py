"""The host's side against an aircraft that answers as a script says: well, late, never, twice."""

from __future__ import annotations

import random

import pytest
from scripted_aircraft import RATES, Flight

from tirgeo_ros.core.config.dji import DjiHostConfig
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.host.session import HostSession, HostState
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.protocol.commands import (
    Activate,
    AddPackage,
    MatchVersion,
    SetRates,
    encode_code,
)
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, PackageTable

KEY = bytes(range(32))


def ready(flight):
    return flight.fly(60.0, HostState.READY)


def test_the_default_sends_nothing_whatever_comes():
    flight = Flight(DjiHostConfig())
    flight.fly(20.0)
    flight.session.restart()
    flight.fly(20.0)
    assert flight.sent == b""
    assert flight.session.state is HostState.LISTENING
    assert flight.session.message == "listening only: nothing is asked of the aircraft"
    assert flight.table == PackageTable()


def test_all_is_asked_for_in_order():
    flight = ready(Flight())
    assert flight.kinds == [
        *("GetVersion", "Activate", "SetRates", "MatchVersion", "ResetPackages"),
        *["AddPackage"] * 5,
    ]
    assert flight.aircraft.asked[1] == Activate(1234, (3, 2, 41, 13))
    assert flight.aircraft.rates == RATES
    assert sorted(flight.aircraft.packages) == flight.known == [0, 1, 2, 3, 4]
    assert flight.session.message == "PM820V3PRO with firmware 3.2.41.13; ready"
    assert flight.states == [
        *(HostState.ACTIVATING, HostState.SETTING_RATES, HostState.SUBSCRIBING, HostState.READY)
    ]


def test_a_lost_ack_is_asked_for_again_under_the_same_number():
    flight = Flight()
    lost = [True, False, True, True, False] + [False] * 50
    flight.aircraft.route = lambda ack: [] if lost.pop(0) else [(0.0, ack)]
    ready(flight)
    assert flight.kinds[:5] == ["GetVersion", "GetVersion", "Activate", "Activate", "Activate"]
    frames = FrameReader().feed(flight.sent)
    assert frames[0] == frames[1]._replace(offset=frames[0].offset)
    assert flight.session.diagnostics["host sent again"] == "3"


def test_acks_of_others_are_not_taken():
    flight = Flight(DjiHostConfig(app_id=5))
    own = flight.aircraft.ack

    def foreign(frame):  # right number, other session; then right session, other number
        own(frame)
        value = encode_code(Activate(0, (0, 0, 0, 0)), 0)
        number = frame.sequence
        return b"".join(
            encode_frame(value, session=session, sequence=sequence, is_ack=True)
            for session, sequence in [(3, number), (2, number + 1 & 0xFFFF), (0, number)]
        )

    flight.aircraft.ack = foreign
    flight.fly(3.0)
    assert flight.session.state is HostState.NO_ANSWER
    assert not flight.aircraft.activated


@pytest.mark.parametrize("seed", range(12))
def test_over_a_bad_line_it_gets_there(seed):
    chance = random.Random(seed)
    flight = Flight()

    def route(ack):
        return [(chance.uniform(0.0, 1.5), ack) for _ in range(chance.choice([0, 0, 1, 1, 2]))]

    flight.aircraft.route = route
    flight.fly(300.0, HostState.READY)
    assert flight.aircraft.activated
    assert flight.aircraft.rates == RATES
    assert {n: p.uids for n, p in flight.aircraft.packages.items()} == {
        p.id: tuple(topic.uid for topic in p.topics) for p in USUAL_PACKAGES
    }
    assert flight.table == PackageTable()


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
    [(3, "connect a phone or tablet with DJI GO"), (5, "no internet"), (1, "host.app_id")],
)
def test_a_refused_activation_is_told_and_tried_again_with_pauses(code, words):
    flight = Flight()
    flight.aircraft.refusals = lambda r: code if isinstance(r, Activate) else None
    flight.fly(100.0)
    assert flight.session.state is HostState.NOT_ACTIVATED
    assert words in flight.session.message
    assert flight.aircraft.rates == RATES  # these do not wait for it
    assert flight.kinds.count("Activate") < 20
    assert "AddPackage" not in flight.kinds
    flight.aircraft.refusals = lambda _: None  # somebody did what the message says
    flight.fly(31.0, HostState.READY)
    assert flight.known == [0, 1, 2, 3, 4]


def test_a_subscription_without_app_id_is_tried_where_it_is_activated_already():
    flight = Flight(DjiHostConfig(subscribe=True))
    flight.fly(2.0)
    assert flight.session.state is HostState.NOT_ACTIVATED
    assert "not activated: give host.app_id" in flight.session.message
    assert set(flight.kinds) == {"GetVersion"}
    flight.aircraft.activated = True
    flight.fly(31.0, HostState.READY)
    assert "Activate" not in flight.kinds


def test_refused_rates_are_told():
    flight = Flight()
    flight.aircraft.refusals = lambda r: 1 if isinstance(r, SetRates) else None
    flight.fly(5.0)
    assert flight.session.state is HostState.INCOMPLETE
    assert "broadcast rates: bad parameter: check host.broadcast_rates" in flight.session.message
    assert flight.known == [0, 1, 2, 3, 4]


@pytest.mark.parametrize("at", [MatchVersion, AddPackage])
def test_an_activation_that_is_lost_midway_is_asked_for_anew(at):
    flight = Flight()
    lost = []

    def refusals(request):
        if isinstance(request, at) and not lost:
            lost.append(request)
            flight.aircraft.switch_off_and_on()
            return 0x23
        return None

    flight.aircraft.refusals = refusals
    flight.fly(20.0, HostState.READY)
    assert flight.kinds.count("Activate") == 2
    assert sorted(flight.aircraft.packages) == flight.known == [0, 1, 2, 3, 4]


def test_an_aircraft_that_has_nothing_to_say_is_asked_less_and_less():
    flight = Flight(DjiHostConfig(app_id=5))
    flight.broadcasts = False
    flight.fly(400.0)
    assert 5 < flight.kinds.count("Activate") < 12  # after 3, 6, 12, 24, 48, 60, 60 s ...


def test_a_quick_reboot_is_noticed_by_the_pushes_that_stop():
    flight = ready(Flight())
    flight.aircraft.switch_off_and_on()  # the broadcast goes on
    flight.fly(5.0)
    flight.fly(2.0, HostState.READY)
    assert flight.aircraft.rates == RATES
    assert sorted(flight.aircraft.packages) == [0, 1, 2, 3, 4]


def test_the_link_opened_again():
    flight = ready(Flight())
    flight.aircraft.asked.clear()
    flight.session.restart()
    ready(flight)
    assert flight.kinds[:2] == ["GetVersion", "Activate"]
    assert flight.kinds[-1] == "AddPackage"
    frames = FrameReader().feed(flight.sent)
    assert len({frame.sequence for frame in frames}) == len(frames)


def test_encrypted_answers_need_the_key():
    flight = Flight()
    flight.aircraft.key = KEY
    flight.fly(5.0)
    assert flight.session.state is HostState.NO_ANSWER
    assert "answers are encrypted: set key to the application's" in flight.session.message
    with_key = Flight(key=KEY)
    with_key.aircraft.key = KEY
    ready(with_key)


@pytest.mark.parametrize(
    ("rates", "message"),
    [
        ((2.5,) + (5.0,) * 15, "host.broadcast_rates: 2.5 is no rate code"),
        ((8.0,) + (5.0,) * 15, "host.broadcast_rates: 8 is no rate code"),
        ((5.0,) * 3, "3 rate codes where 16 are due"),
    ],
)
def test_rates_that_are_no_codes_are_an_error_at_the_start(rates, message):
    with pytest.raises(DjiError, match=message):
        HostSession(DjiHostConfig(broadcast_rates=rates), PackageTable())

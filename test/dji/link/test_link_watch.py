"""What a person is told of the link, by what comes through it and by the port's state."""

from __future__ import annotations

import re
import time

import pytest

from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.link.serial_link import LinkLevel, LinkState, LinkWatch, SerialLink
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal

STEP_S = 0.05


class Scene:
    """Time goes on in steps; bytes and frames come as told."""

    def __init__(self, baud=921600):
        self.watch = LinkWatch("/dev/ttyUSB0", baud)
        self.now_s, self.bytes, self.frames = 1000.0, 0, 0
        self.told = []

    def pass_(self, seconds, *, state=LinkState.OPEN, message="", bytes_=0, frames=0):
        """``bytes_`` and ``frames`` come in each step."""
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.bytes += bytes_
            self.frames += frames
            report = self.watch.look(self.now_s, state, message, self.bytes, self.frames)
            if report is not None:
                self.told.append(report)
        return self.watch.report

    @property
    def conditions(self):
        return [report.condition for report in self.told]


def test_an_open_port_without_bytes_is_silent_after_two_seconds():
    scene = Scene()
    assert scene.pass_(1.9).condition == "waiting"
    report = scene.pass_(1.0)
    assert (report.condition, report.level) == ("silent", LinkLevel.WARN)
    assert re.search(
        "ttyUSB0: open but no bytes for 2 s.*the cable.*'API control' is ticked", report.message
    )
    assert report.since_s == pytest.approx(1000.0 + STEP_S + 2.0, abs=STEP_S)


@pytest.mark.parametrize(
    ("baud", "words"),
    [
        (921600, "at 921600 baud: .*usual are 230400, 115200, 1000000$"),
        (230400, "at 230400 baud: .*usual are 921600, 115200, 1000000$"),
        (57600, "at 57600 baud: .*usual are 921600, 230400, 115200, 1000000$"),
    ],
)
def test_bytes_without_frames_are_a_wrong_rate(baud, words):
    scene = Scene(baud)
    report = scene.pass_(2.5, bytes_=100)
    assert (report.condition, report.level) == ("wrong_baud", LinkLevel.ERROR)
    assert re.search(f"bytes come but no valid frame for 2 s {words}", report.message)
    assert scene.conditions == ["waiting", "wrong_baud"]


def test_an_aircraft_that_is_switched_off_is_silence_and_not_a_wrong_rate():
    scene = Scene()
    scene.pass_(3.0, bytes_=300, frames=1)
    scene.pass_(STEP_S, bytes_=120)  # a cut frame
    scene.pass_(5.0)
    assert scene.conditions == ["waiting", "receiving", "silent"]
    assert scene.watch.report.frames_per_s == 0.0
    assert scene.watch.report.bytes_per_s == 0.0


@pytest.mark.parametrize("state", list(LinkState))
def test_every_state_of_the_port_has_its_condition(state):
    report = LinkWatch("p", 1).look(0.0, state, "why", 0, 0)
    expected = "waiting" if state is LinkState.OPEN else state.value
    assert report.condition == expected
    assert report.level is not LinkLevel.OK


def test_what_came_before_the_cable_was_pulled_does_not_count_after_it():
    scene = Scene()
    scene.pass_(1.0, bytes_=300, frames=1)
    scene.pass_(0.5, state=LinkState.LOST)
    assert scene.pass_(1.0).condition == "waiting"
    assert scene.pass_(1.5).condition == "silent"


pytest.importorskip("serial")

BAUD = 230400
FRAME = encode_frame(bytes((2, 0, 0, 0)))


class Person:
    """Who reads what the watch says, while the aircraft sends 50 frames a second."""

    def __init__(self, path, cable):
        self.link = SerialLink(str(path), BAUD)
        self.watch = LinkWatch(str(path), BAUD)
        self.reader = FrameReader()
        self.cable = cable
        self.told = []

    def wait(self, seconds, *, sends=True, until=None):
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            if sends:
                self.cable.write(FRAME)
            self.reader.feed(self.link.read(0.02))
            counts = self.reader.counts
            report = self.watch.look(
                time.monotonic(),
                self.link.state,
                self.link.message,
                counts["bytes"],
                counts["frames"],
            )
            if report is not None:
                self.told.append(report.condition)
            if until is not None and self.watch.report.condition == until:
                return
        assert until is None, self.told


def test_from_no_device_to_receiving_and_back(tmp_path):
    path = tmp_path / "aircraft"
    with PseudoTerminal(path, BAUD) as cable:
        person = Person(path, cable)
        cable.pull()
        person.wait(0.2)
        cable.plug()
        person.wait(4.0, sends=False, until="silent")
        person.wait(1.0, until="receiving")
        cable.pull()
        person.wait(1.0, until="lost")
        person.wait(0.5)
        cable.plug()
        person.wait(2.0, until="receiving")
        person.link.close()
    assert person.told == [
        *("no_device", "waiting", "silent", "receiving", "lost", "waiting", "receiving")
    ]

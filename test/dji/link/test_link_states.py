"""Port, framing and watch together over a pseudo-terminal: what a person is told, in real time."""

from __future__ import annotations

import time

import pytest

from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.link.link_watch import LinkWatch
from tirgeo_ros.dji.link.serial_link import SerialLink
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal

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
                self.told.append(report.condition.value)
            if until is not None and self.watch.report.condition.value == until:
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

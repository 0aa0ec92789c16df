# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""The serial port over real pseudo-terminals, and its messages: pulled, refused, silent."""

from __future__ import annotations

import errno
import os
import re
import time

import pytest

from tirgeo_ros.core.types.finding import Severity
from tirgeo_ros.dji.link.framing import FrameReader, encode_frame
from tirgeo_ros.dji.link.serial_link import LinkState, LinkWatch, SerialLink, Totals
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal

STEP_S = 0.05


class Scene:
    """Watch a link over time in steps, with given numbers of bytes and frames."""

    def __init__(self, baud=921600):
        self.watch = LinkWatch("/dev/ttyUSB0", baud)
        self.now_s, self.bytes, self.frames = 1000.0, 0, 0
        self.reports = []

    def pass_(self, seconds, *, state=LinkState.OPEN, message="", bytes_=0, frames=0):
        """Let time pass; ``bytes_`` and ``frames`` are the numbers of each step."""
        for _ in range(round(seconds / STEP_S)):
            self.now_s += STEP_S
            self.bytes += bytes_
            self.frames += frames
            report = self.watch.look(state, message, Totals(self.now_s, self.bytes, self.frames))
            if report is not None:
                self.reports.append(report)
        return self.watch.report

    @property
    def conditions(self):
        return [report.condition for report in self.reports]


def test_an_open_port_without_bytes_is_silent_after_two_seconds():
    scene = Scene()
    assert scene.pass_(1.9).condition == "waiting"
    report = scene.pass_(1.0)
    assert (report.condition, report.level) == ("silent", Severity.CAUTION)
    assert re.search(
        "ttyUSB0: open but no bytes for 2 s.*the cable.*'API control' is ticked", report.message
    )


def test_bytes_without_frames_are_a_wrong_rate():
    words = "at 230400 baud: .*usual are 921600, 115200, 1000000$"
    scene = Scene(230400)
    report = scene.pass_(2.5, bytes_=100)
    assert (report.condition, report.level) == ("wrong_baud", Severity.STOP)
    assert re.search(f"bytes come but no valid frame for 2 s {words}", report.message)
    assert scene.conditions == ["waiting", "wrong_baud"]


def test_an_aircraft_that_is_switched_off_is_silent_and_has_no_wrong_rate():
    scene = Scene()
    scene.pass_(3.0, bytes_=300, frames=1)
    scene.pass_(STEP_S, bytes_=120)  # a cut frame
    scene.pass_(5.0)
    assert scene.conditions == ["waiting", "receiving", "silent"]


@pytest.mark.parametrize("state", list(LinkState))
def test_every_state_of_the_port_has_its_condition(state):
    report = LinkWatch("p", 1).look(state, "why", Totals(0.0, 0, 0))
    expected = "waiting" if state is LinkState.OPEN else state.value
    assert report.condition == expected
    assert report.level is not Severity.NOTE


def test_bytes_from_before_the_cable_was_pulled_do_not_count():
    scene = Scene()
    scene.pass_(1.0, bytes_=300, frames=1)
    scene.pass_(0.5, state=LinkState.LOST)
    assert scene.pass_(1.0).condition == "waiting"
    assert scene.pass_(1.5).condition == "silent"


pytest.importorskip("serial")

WATCHED_BAUD = 230400
FRAME = encode_frame(bytes((2, 0, 0, 0)))


def test_from_no_device_to_receiving_and_back(tmp_path):
    """The messages to a person; the aircraft sends always except at first."""
    path, reports = tmp_path / "aircraft", []
    with PseudoTerminal(path, WATCHED_BAUD) as cable:
        link, watch = SerialLink(str(path), WATCHED_BAUD), LinkWatch(str(path), WATCHED_BAUD)
        reader = FrameReader()
        cable.pull()

        def wait_for(condition, sends=True):
            end_s = time.monotonic() + 4.0
            while watch.report is None or watch.report.condition != condition:
                assert time.monotonic() < end_s, reports
                if sends:
                    cable.write(FRAME)
                reader.feed(link.read(0.02))
                counts = reader.counts["bytes"], reader.counts["frames"]
                report = watch.look(link.state, link.message, Totals(time.monotonic(), *counts))
                reports.extend([report.condition] if report else [])

        wait_for("no_device")
        cable.plug()
        wait_for("silent", sends=False)
        wait_for("receiving")
        cable.pull()
        wait_for("lost")
        cable.plug()
        wait_for("receiving")
        link.close()
    assert reports == [
        *("no_device", "waiting", "silent", "receiving", "lost", "waiting", "receiving")
    ]


BAUD = 921600
PATIENCE_S = 5.0  # a test gives up: nothing that is waited for takes a second


@pytest.fixture
def cable(tmp_path):
    with PseudoTerminal(tmp_path / "aircraft") as terminal:
        yield terminal


@pytest.fixture
def open_link():
    links = []

    def make(*arguments, **named):
        links.append(SerialLink(*arguments, **named))
        return links[-1]

    yield make
    for link in links:
        link.close()


def opened(link):
    end_s = time.monotonic() + PATIENCE_S
    while link.state is not LinkState.OPEN:
        assert time.monotonic() < end_s, link.message
        link.read(0.05)
    return link


def test_an_adapter_that_vanishes_is_noticed(tmp_path, open_link):
    # A dead adapter of USB reads as an end at once, for ever: so does a pipe without writer.
    class Pipe:
        def __init__(self):
            self.reader, writer = os.pipe()
            os.close(writer)

        def fileno(self):
            return self.reader

        def close(self):
            os.close(self.reader)

    port = tmp_path / "port"
    port.touch()
    openings = [Pipe()]

    def opener(path, baud):
        if openings:
            return openings.pop()
        raise FileNotFoundError(errno.ENOENT, "no such device", path)

    link = open_link(str(port), BAUD, opener)
    start, reads = time.monotonic(), 0
    while time.monotonic() - start < 0.5:
        assert link.read(0.05) == b""
        reads += 1
    assert link.state is LinkState.LOST
    assert "the device hung up" in link.message
    assert reads < 30  # it does not spin


@pytest.mark.parametrize(
    ("error", "state", "message"),
    [
        (PermissionError(errno.EACCES, "Permission denied"), "permission_denied", "group dialout"),
        (OSError(errno.EPERM, "Operation not permitted"), "permission_denied", "dialout"),
        (OSError(errno.EBUSY, "Device or resource busy"), "busy", "another program uses the port"),
        (OSError(errno.EAGAIN, "lock"), "busy", "another program uses the port"),
        (OSError(errno.ENOTTY, "it is a file"), "not_a_port", "not a serial port.*it is a file"),
        (OSError("Could not configure port"), "not_a_port", "Could not configure port"),
        (ValueError("refuses 12345 baud"), "baud_refused", "parameter baud .refuses 12345 baud"),
        (OSError(errno.ENXIO, "No such device"), "no_device", "plug the cable in"),
        (OSError(errno.EIO, "Input/output error"), "no_device", "plug the cable in"),
    ],
)
def test_errors_of_the_system_have_a_state_and_a_message(open_link, error, state, message):
    def opener(path, baud):
        raise error

    link = open_link("/dev/ttyX", BAUD, opener)
    assert link.read(0.0) == b""
    assert link.state is LinkState(state)
    assert re.search(f"^/dev/ttyX: .*{message}", link.message)
    assert "\n" not in link.message


@pytest.mark.parametrize("make", [lambda path: path.touch(), lambda path: path.mkdir()])
def test_a_file_or_folder_is_not_a_port(tmp_path, open_link, make):
    make(tmp_path / "capture.bin")
    link = open_link(str(tmp_path / "capture.bin"), BAUD)
    link.read(0.0)
    assert link.state is LinkState.NOT_A_PORT
    assert "this is not a serial port: set the parameter port" in link.message


def test_a_port_that_another_program_uses_is_busy_until_it_is_closed(cable, open_link):
    first = opened(open_link(str(cable.path), BAUD))
    second = open_link(str(cable.path), BAUD)
    second.read(0.0)
    assert second.state is LinkState.BUSY
    first.close()
    opened(second)


def test_every_byte_comes_through_raw(cable, open_link):
    # All 256 values: none is eaten or changed as by a terminal for people (^C, ^S, CR, NL).
    link = opened(open_link(str(cable.path), BAUD))
    sent = bytes(range(256)) * 40
    data, left = b"", sent
    end_s = time.monotonic() + PATIENCE_S
    while len(data) < len(sent):
        assert time.monotonic() < end_s, link.message
        left = left[cable.write(left) :] if left else left  # as much as there is room for
        data += link.read(0.05)
    assert data == sent

"""The port over real pseudo-terminals: cables pulled, ports refused, batches, silence."""

from __future__ import annotations

import errno
import os
import re
import threading
import time

import pytest

from tirgeo_ros.dji.link.serial_link import LinkState, SerialLink
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal

pytest.importorskip("serial")

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


def send(cable, data):
    end_s = time.monotonic() + PATIENCE_S
    while data:  # as much as there is room for
        assert time.monotonic() < end_s, "nobody takes it"
        data = data[cable.write(data) :]


def read_until(link, done):
    """What came until ``done(all)``, and how long it took in seconds."""
    start, data = time.monotonic(), b""
    while not done(data):
        assert time.monotonic() - start < PATIENCE_S, link.message
        data += link.read(0.05)
    return data, time.monotonic() - start


def opened(link):
    read_until(link, lambda _: link.state is LinkState.OPEN)
    return link


def test_an_adapter_that_vanishes_is_noticed(tmp_path, open_link):
    # A dead adapter of USB reads as an end at once, for ever: so does a pipe without writer.
    class Pipe:
        def __init__(self):
            self.reader, writer = os.pipe()
            os.close(writer)

        def fileno(self):
            return self.reader

        def write(self, _):
            raise OSError(errno.EIO, "gone")

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
    assert "it hung up" in link.message
    assert reads < 30  # it does not spin


def failing(*errors):
    """An opener that fails with each error in turn, the last one for ever."""
    left = list(errors)

    def opener(path, baud):
        raise left.pop(0) if len(left) > 1 else left[0]

    return opener


@pytest.mark.parametrize(
    ("error", "state", "message"),
    [
        (PermissionError(errno.EACCES, "Permission denied"), "permission_denied", "group dialout"),
        (OSError(errno.EPERM, "Operation not permitted"), "permission_denied", "dialout"),
        (OSError(errno.EBUSY, "Device or resource busy"), "busy", "another program has it"),
        (OSError(errno.EAGAIN, "lock"), "busy", "another program has it"),
        (OSError(errno.ENOTTY, "it is a file"), "not_a_port", "no serial port.*it is a file"),
        (OSError("Could not configure port"), "not_a_port", "Could not configure port"),
        (ValueError("refuses 12345 baud"), "baud_refused", "set baud .refuses 12345 baud"),
        (OSError(errno.ENXIO, "No such device"), "no_device", "plug the cable in"),
        (OSError(errno.EIO, "Input/output error"), "no_device", "plug the cable in"),
    ],
)
def test_what_the_system_says_in_words(open_link, error, state, message):
    link = open_link("/dev/ttyX", BAUD, failing(error))
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


def test_a_port_that_another_one_holds_is_busy_until_it_is_given_back(cable, open_link):
    first = opened(open_link(str(cable.path), BAUD))
    second = open_link(str(cable.path), BAUD)
    second.read(0.0)
    assert second.state is LinkState.BUSY
    first.close()
    opened(second)


def test_close_while_another_thread_reads(cable, open_link):
    link = opened(open_link(str(cable.path), BAUD))
    found = []
    thread = threading.Thread(target=lambda: found.append(link.read(0.5)))
    thread.start()
    time.sleep(0.05)
    link.close()
    thread.join(PATIENCE_S)
    assert found == [b""]


def test_every_byte_comes_through_raw(cable, open_link):
    # All 256 values: none is eaten or changed as by a terminal for people (^C, ^S, CR, NL).
    link = opened(open_link(str(cable.path), BAUD))
    sent = bytes(range(256)) * 40
    thread = threading.Thread(target=send, args=(cable, sent))
    thread.start()
    data, _ = read_until(link, lambda data: len(data) >= len(sent))
    thread.join()
    assert data == sent
    assert link.write(bytes(range(256)))
    assert cable.read() == bytes(range(256))

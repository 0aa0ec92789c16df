"""The port that is not there, opened as any port."""

from __future__ import annotations

import os
import termios

import pytest

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal


@pytest.fixture
def port(tmp_path):
    with PseudoTerminal(tmp_path / "tty") as made:
        yield made


def opened(port: PseudoTerminal) -> int:
    return os.open(port.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)


def test_bytes_go_both_ways_as_they_are(port):
    every = bytes(range(256))  # control characters included: nothing is echoed or translated
    host = opened(port)
    try:
        assert port.write(every) == 256
        assert os.read(host, 1000) == every
        os.write(host, every)
        assert port.read() == every
        assert port.read() == b""
    finally:
        os.close(host)
    assert port.dropped == 0


def test_a_reader_who_sleeps_stops_nobody(port):
    host = opened(port)
    sent = sum(port.write(bytes(1000)) for _ in range(100))
    assert 1000 <= sent < 100_000
    assert port.dropped == 100_000 - sent
    os.close(host)


def test_a_pulled_cable_hangs_up_and_a_new_one_has_the_same_name(port):
    host = opened(port)
    port.pull()
    assert not port.path.is_symlink()
    assert (port.is_open, port.write(b"x"), port.read()) == (False, 0, b"")
    assert os.read(host, 1) == b""  # the end of it
    os.close(host)
    port.plug()
    host = opened(port)
    port.write(b"again")
    assert os.read(host, 10) == b"again"
    os.close(host)


@pytest.mark.parametrize(("speed", "clean"), [(termios.B921600, True), (termios.B230400, False)])
def test_another_speed_reads_noise(tmp_path, speed, clean):
    with PseudoTerminal(tmp_path / "tty", baud=921600) as port:
        host = opened(port)
        attributes = termios.tcgetattr(host)
        attributes[4] = attributes[5] = speed
        termios.tcsetattr(host, termios.TCSANOW, attributes)
        port.write(b"\xaa" * 32)
        assert (os.read(host, 100) == b"\xaa" * 32) is clean
        os.close(host)


def test_a_link_of_a_run_that_was_killed_is_replaced(tmp_path):
    path = tmp_path / "tty"
    path.symlink_to("/nowhere")
    with PseudoTerminal(path) as port:
        os.close(opened(port))
    assert not path.is_symlink()


def test_a_path_that_is_taken_or_impossible_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DjiError, match=r"file: no pseudo-terminal can be made there: File exists"):
        PseudoTerminal(tmp_path / "file")
    with pytest.raises(DjiError, match=r"no/such: no pseudo-terminal can be made there: No such"):
        PseudoTerminal(tmp_path / "no" / "such")
    with pytest.raises(DjiError, match=r"123 is no speed of a serial port"):
        PseudoTerminal(tmp_path / "tty", baud=123)

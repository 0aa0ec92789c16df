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
    with pytest.raises(DjiError, match=r"123 is not a speed of a serial port"):
        PseudoTerminal(tmp_path / "tty", baud=123)

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
"""The frames of the simulated aircraft, and the simulated port."""

from __future__ import annotations

import math
import os
import termios
from dataclasses import replace

import numpy as np
import pytest

from tirgeo_ros.core.config import AircraftConfig, SimulatedAircraftConfig
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    ImuSample,
    PositionSample,
    Source,
)
from tirgeo_ros.dji.link.framing import FrameReader
from tirgeo_ros.dji.protocol.rtk_gps_imu_broadcast import Layout, decode_broadcast
from tirgeo_ros.dji.protocol.subscription import USUAL_PACKAGES, PackageTable, decode_push
from tirgeo_ros.dji.simulator.aircraft import Aircraft, frames_of
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal

MS = 1_000_000
START = 1_634_731_200_000_000_000  # 2021-10-20 12:00:00 UTC, 20:00:00 where its maker is
Q_NB = quat_from_euler(0.02, -0.05, 2.0)
FIX = np.diag([1e-4, 1e-4, 4e-4])


def imu(k: int, period_ms: int = 10, **values) -> tuple[int, ImuSample]:
    stamp = START + k * period_ms * MS
    fields = {"specific_force_b": np.array([0.3, -0.2, -9.80665]), "autopilot_q_nb": Q_NB}
    fields |= {"angular_rate_b": np.array([0.01, -0.02, 0.5])} | values
    return stamp, ImuSample(stamp, **fields)


def rtk(at_ms: int, status=FixStatus.FIXED, source=Source.RTK_POSITION) -> PositionSample:
    return PositionSample(
        START + at_ms * MS, source, status, math.radians(39.85), math.radians(116.7), 31.5, FIX
    )


def reports(samples):
    """Return the broadcasts that an aircraft makes of samples, sorted by arrival."""
    frames = list(
        frames_of(
            Aircraft(SimulatedAircraftConfig(), AircraftConfig()),
            sorted(samples, key=lambda pair: pair[0]),
        )
    )
    result = FrameReader().feed(b"".join(frame.data for frame in frames))
    assert [frame.sequence for frame in result] == [k & 0xFFFF for k in range(1, len(result) + 1)]
    assert all(frame.session == 0 for frame in result)
    broadcasts = [decode_broadcast(frame.value) for frame in result if frame.cmd_id == 0]
    assert all(text is not None and text.layout is Layout.MODERN for text in broadcasts)
    return broadcasts


def test_a_second_flight_switches_the_aircraft_on_again():
    text = reports([imu(k) for k in range(300)])
    assert text[-1].time.time_ms == 60_000 + 2990
    aircraft = Aircraft(SimulatedAircraftConfig(), AircraftConfig())
    back = [(START + 5_000 * MS + k * 10 * MS, imu(k)[1]) for k in range(3)]
    frames = list(frames_of(aircraft, [*(imu(k) for k in range(300)), *back]))
    result = FrameReader().feed(frames[-3].data)
    assert decode_broadcast(result[0].value).time.time_ms == 60_000


def test_a_package_is_pushed_at_its_rate_with_interpolated_values():
    aircraft = Aircraft(
        SimulatedAircraftConfig(clock_start_ms=1000, pushes=True), AircraftConfig()
    )
    samples = [
        imu(
            k,
            angular_rate_b=np.array([0.001 * k, 0.0, 0.0]),
            specific_force_b=np.array([0, 0, -9.8]),
        )
        for k in range(101)
    ]
    frames = list(frames_of(aircraft, samples))
    assert [f.time_ns for f in frames] == sorted(f.time_ns for f in frames)
    table = PackageTable(USUAL_PACKAGES)
    result = [(f, FrameReader().feed(f.data)[0]) for f in frames]
    pushes = [(f, decode_push(frame.value, table)) for f, frame in result if frame.cmd_id == 5]
    sync = [(f, push) for f, push in pushes if push.package.id == 3]
    assert len(sync) == 401  # a second of 400 Hz, both ends
    for k, (frame, push) in enumerate(sync):
        tick = push.values["HARD_SYNC"]
        assert frame.time_ns == START + k * 2_500_000
        assert (tick.time2p5ms, tick.time1ns, tick.reset_time2p5ms) == (400 + k, 0, k)
        assert tick.gyro_radps[0] == pytest.approx(0.001 * k / 4, abs=1e-8)
    # Package 1 contains the gimbal, which has no data: it is not pushed.
    assert {push.package.id for _, push in pushes} == {0, 2, 3, 4}


@pytest.mark.parametrize("rate_hz", [50, 100, 200, 400])
def test_parts_have_their_rate_with_any_imu(rate_hz):
    """50 Hz from the first frame on, at any rate of the IMU; otherwise a fix would be late."""
    step_ns = 1_000_000_000 // rate_hz
    samples = [(START + k * step_ns, replace(imu(0)[1], stamp_ns=START + k * step_ns))
               for k in range(rate_hz)]  # fmt: skip
    text = reports(samples)
    polled_ms = [1000 * k // rate_hz for k, part in enumerate(text) if part.rtk is not None]
    assert polled_ms == list(range(0, 1000, 20))


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


def test_a_symbolic_link_of_a_killed_run_is_replaced(tmp_path):
    path = tmp_path / "tty"
    path.symlink_to("/nowhere")
    with PseudoTerminal(path) as port:
        os.close(opened(port))
    assert not path.is_symlink()


def test_a_path_that_exists_or_is_impossible_is_named(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(DjiError, match=r"file: no pseudo-terminal can be made there: File exists"):
        PseudoTerminal(tmp_path / "file")
    with pytest.raises(DjiError, match=r"no/such: no pseudo-terminal can be made there: No such"):
        PseudoTerminal(tmp_path / "no" / "such")
    with pytest.raises(DjiError, match=r"123 baud is not a speed of a serial port"):
        PseudoTerminal(tmp_path / "tty", baud=123)

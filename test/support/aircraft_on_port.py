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
"""An aircraft on a pseudo-terminal for tests of what reads it: in real time, in a thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from pathlib import Path
from typing import final

import numpy as np

from tirgeo_ros.core.config import AircraftConfig, SimulatedAircraftConfig
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    HeadingSample,
    ImuSample,
    JointSample,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.dji.simulator.aircraft import Aircraft, Outgoing, frames_of
from tirgeo_ros.dji.simulator.pseudo_terminal import PseudoTerminal

MS = 1_000_000
LATITUDE_RAD, LONGITUDE_RAD, HEIGHT_M = 0.9, 0.1, 50.0
HEADING_RAD, PITCH_RAD = 0.7, -0.5


def hovering(duration_s: float, start_ns: int = 0):
    """(arrival, sample) of an aircraft that stands still in the air: IMU 100, RTK 5, gimbal 50 Hz.

    RTK climbs 1 mm an epoch, so that each is a new one; it arrives when it is measured.
    """
    q_nb = quat_from_euler(0.0, 0.0, HEADING_RAD)
    q_ng = quat_from_euler(0.0, PITCH_RAD, HEADING_RAD)
    covariance = np.diag([1e-4, 1e-4, 4e-4])
    for k in range(round(duration_s * 100)):
        stamp = start_ns + k * 10 * MS
        yield stamp, ImuSample(stamp, np.array([0, 0, -9.81]), np.zeros(3), q_nb)
        if k % 2 == 0:
            yield stamp, JointSample(stamp, 0.0, 0.0, PITCH_RAD)
            yield stamp, CameraAttitudeSample(stamp, q_ng)
        if k % 20 == 0:
            place = (LATITUDE_RAD, LONGITUDE_RAD, HEIGHT_M + 5e-5 * k)
            for source, status in (
                (Source.RTK_POSITION, FixStatus.FIXED),
                (Source.GPS_POSITION, FixStatus.SINGLE),
            ):
                yield stamp, PositionSample(stamp, source, status, *place, covariance)
            for source in (Source.RTK_VELOCITY, Source.GPS_VELOCITY):
                yield stamp, VelocitySample(stamp, source, np.array([0, 0, -1e-6 * k]), covariance)
            yield stamp, HeadingSample(stamp, HEADING_RAD, 1e-4)


@final
class AircraftOnPort:
    """Writes frames at their times to whoever reads the port. A context manager.

    ``frames`` may be any bytes with their times (ns, from any start); the first is due once
    somebody has the port open. By default a hovering aircraft for ten minutes. ``baud``: as for
    PseudoTerminal.
    """

    def __init__(
        self,
        path: Path,
        frames: Iterable[Outgoing | tuple[int, bytes]] | None = None,
        baud: int | None = None,
    ) -> None:
        self.terminal = PseudoTerminal(path, baud)
        self.begun = threading.Event()
        self._frames = (
            frames
            if frames is not None
            else frames_of(Aircraft(SimulatedAircraftConfig(), AircraftConfig()), hovering(600))
        )
        self._guard = threading.Lock()  # nobody pulls the cable amid a frame
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._fly, daemon=True)

    def pull(self) -> None:
        """Pull the cable; what would be said meanwhile is lost."""
        with self._guard:
            self.terminal.pull()

    def plug(self) -> None:
        """Plug it in again."""
        with self._guard:
            self.terminal.plug()

    def _fly(self) -> None:
        while not self.terminal.is_open:
            if self._stop.wait(0.01):
                return
        self.begun.set()
        begin_s, first_ns = time.monotonic(), None
        for time_ns, data in self._frames:
            first_ns = time_ns if first_ns is None else first_ns
            due_s = begin_s + (time_ns - first_ns) * 1e-9
            if self._stop.wait(max(0.0, due_s - time.monotonic())):
                return
            self._say(data)

    def _say(self, data: bytes) -> None:
        with self._guard:
            self.terminal.write(data)

    def __enter__(self) -> AircraftOnPort:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join(10.0)
        self.terminal.pull()

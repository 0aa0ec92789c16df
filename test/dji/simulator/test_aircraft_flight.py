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
"""The sample flight through the serial link: bytes on a wire in place of a bag's messages.

Samples of the bag -> the aircraft's frames -> a line of 921600 baud with a late reader -> frames
-> readings -> samples -> the filter and the gimbal. The bag's samples are used for comparison.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, replace

import numpy as np
import pytest

from tirgeo_ros import read_camera
from tirgeo_ros.core.config import (
    BagPlayerConfig,
    DjiConfig,
    EkfConfig,
    GimbalConfig,
    OverlayConfig,
)
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.dji.clocks.aircraft_clock import AircraftClock
from tirgeo_ros.dji.interpret.interpreter import Interpreter
from tirgeo_ros.dji.link.framing import FrameReader
from tirgeo_ros.dji.protocol.subscription import PackageTable
from tirgeo_ros.dji.simulator.aircraft import Aircraft, frames_of
from tirgeo_ros.dji.sources.serial import Clocks, Telemetry
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import SENSED_SAMPLES
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.evaluate.experiment import load_experiment
from tirgeo_ros.tools.evaluate.result import (
    body_errors,
    ground_errors,
    load_truth,
    locate_observations,
)
from tirgeo_ros.tools.replay.registration import Registration

BYTE_NS = 10 * 1_000_000_000 // 921_600


class Line:
    """Simulate a wire and a reader, both with delays; no byte is read too early."""

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng(seed)
        self._free_ns = self._read_ns = 0

    def read_ns(self, sent_ns: int, length: int) -> int:
        """Return when the last byte of a frame is read: 0.5 ms late in the mean, at times 20."""
        self._free_ns = max(self._free_ns, sent_ns) + length * BYTE_NS
        late_ns = self._rng.exponential(0.5e6) + 20e6 * (self._rng.random() < 0.01)
        self._read_ns = max(self._read_ns, self._free_ns + round(late_ns))
        return self._read_ns


#: The project's figure: heading and ground error of the serial run against those of the bag run.
AS_GOOD = 1.25
#: The first clicks of the sample flight are 10 s after its start.
SETTLED_S = 10.0


@dataclass(frozen=True)
class Errors:
    heading_deg: float
    ground_m: dict[str, float]  # by composition
    located: int


class Flight:
    """Hold the sample flight, its parameters, its truth and its observations."""

    def __init__(self, folder):
        params = ParameterFile(folder / "params.yaml")
        self.dji = params.config("dji_node", DjiConfig)
        player = params.config("bag_player", BagPlayerConfig)
        self.aircraft, self.places = player.simulated_aircraft, player.aircraft
        self._ekf = params.config("ekf_node", EkfConfig)
        self._gimbal = params.config("gimbal_node", GimbalConfig)
        self._overlay = params.config("overlay_node", OverlayConfig)
        self._truth = load_truth(folder / "truth.mcap")
        points = (folder / "survey.geojson", folder / "observations.csv")
        self._experiment = load_experiment(*points)
        self._camera = read_camera(folder / "flight.mcap")
        cdr, bag = Cdr(), BagReader(folder / "flight.mcap")
        self.samples = [
            (
                item.log_time_ns,
                SENSED_SAMPLES[item.topic[1:]](cdr.deserialize(item.data, item.typename)),
            )
            for item in bag.messages([f"/{topic}" for topic in SENSED_SAMPLES])
        ]

    def received(self, **changes):
        """Return the samples that dji_node makes of the aircraft's bytes, and its interpreter."""
        aircraft = Aircraft(replace(self.aircraft, **changes), places=self.places)
        clock, reader, line = self.dji.clock, FrameReader(), Line(seed=7)
        clocks = Clocks(
            AircraftClock(clock), AircraftClock(clock), AircraftClock(clock, 2_500_000)
        )
        telemetry, interpreter = Telemetry(clocks, PackageTable()), Interpreter(self.dji)
        samples = []
        for sent_ns, data in frames_of(aircraft, self.samples):
            read_ns = line.read_ns(sent_ns, len(data))
            for frame in reader.feed(data):
                for reading in telemetry.read(frame, read_ns):
                    samples += interpreter.take(reading)
        return samples + interpreter.flush(), interpreter

    def errors(self, samples) -> Errors:
        samples, cameras = list(samples), {}
        for composition in ("paper", "encoders"):
            gimbal = replace(self._gimbal, composition=composition)
            registration = Registration(self._ekf, gimbal)
            outcome = [registration.take(sample) for sample in samples]
            cameras[composition] = PoseBuffer(1e9)
            for pose in (pose for entry in outcome for pose in entry.cameras):
                cameras[composition].add(pose)
        bodies = [entry.body for entry in outcome if entry.body is not None]
        body = body_errors(bodies, self._truth, SETTLED_S)
        ground = {
            composition: locate_observations(
                poses,
                registration.navigation.plane,
                self._camera,
                self._experiment,
                self._overlay.ground_height_m,
                self._overlay,
            )[0]
            for composition, poses in cameras.items()
        }
        return Errors(
            math.degrees(body.heading_rad),
            {name: ground_errors(located).rmse_m for name, located in ground.items()},
            min(len(located) for located in ground.values()),
        )


@pytest.fixture(scope="module")
def flight(sample):
    return Flight(sample)


@pytest.fixture(scope="module")
def bag(flight):
    return flight.errors([outcome for _, outcome in flight.samples])


@pytest.fixture(scope="module")
def by_joints(flight):
    return flight.received()


@pytest.mark.slow
def test_heading_and_ground_are_as_good_as_the_bags(flight, bag, by_joints):
    serial = flight.errors(by_joints[0])
    # Its bytes come later: the filter may miss one click.
    assert bag.located - 1 <= serial.located <= bag.located
    assert bag.located >= 20
    assert serial.heading_deg <= AS_GOOD * bag.heading_deg
    # The sent attitude is composed of the encoders; the reported attitude is as good.
    assert serial.ground_m["encoders"] <= AS_GOOD * bag.ground_m["encoders"]
    assert serial.ground_m["paper"] <= AS_GOOD * bag.ground_m["paper"]


def test_each_measurement_comes_once(flight, by_joints):
    """The receivers are polled at 50 Hz and measure 5 and 10 times a second."""

    def number(samples):
        return Counter((type(s), getattr(s, "source", None)) for s in samples)

    samples, interpreter = by_joints
    assert interpreter.warnings == []
    assert number(samples) == number(outcome for _, outcome in flight.samples)


def imu_stamps(samples):
    return np.array([s.stamp_ns for s in samples if isinstance(s, ImuSample)])


def test_stamps_are_the_measurements_own(flight, by_joints):
    """Late by the smallest delay of wire and reader, early by at most half a millisecond.

    75 bytes take 0.81 ms at 921600 baud; the fastest of some thousand reads adds nothing.
    """
    expected = imu_stamps([outcome for _, outcome in flight.samples])
    settled = (imu_stamps(by_joints[0]) - expected)[500:] / 1e6
    assert settled.min() > -0.5
    assert np.median(settled) == pytest.approx(0.8, abs=0.3)
    assert settled.max() < 2.0


def test_a_clock_that_drifts_and_wraps_changes_nothing(flight, by_joints):
    samples, _ = flight.received(clock_start_ms=2**32 - 10_000, clock_drift_ppm=50.0)
    # A millisecond of the counter is truncated, and 50 ppm of a 20 s window is one more.
    assert np.abs(imu_stamps(samples) - imu_stamps(by_joints[0]))[500:].max() < 2e6

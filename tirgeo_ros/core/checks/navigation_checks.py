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
"""Check the filter's inputs and their parameters.

Samples are taken as they arrive, before the filter's own checks reject any.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable, Collection, Sequence
from dataclasses import replace

import numpy as np

from tirgeo_ros.core.checks.finding_table import finding
from tirgeo_ros.core.checks.heading_checks import HeadingChecks
from tirgeo_ros.core.checks.inertial_checks import ImuBlocks, ImuChecks, VibrationChecks
from tirgeo_ros.core.checks.lever_arm_checks import LeverChecks
from tirgeo_ros.core.checks.stream_checks import (
    IMU,
    StampChecks,
    Stream,
    longest_step_s,
    stream_findings,
)
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.streams.stamps import Spacing
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.finding import Finding, Severity, sorted_findings
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
    SetHeading,
    Source,
    VelocitySample,
)

#: Fixes no further apart in time than this are compared, one pair in each such interval.
_NEAR_NS = 500_000_000
_KEPT, _LEAST_PAIRS = 60, 12
#: A constant difference beyond this many sigmas and metres is not a GPS error.
_SIGMAS, _LEAST_M = 3.0, 8.0
LARGEST_UNDULATION_M = 110.0
_ELSEWHERE_M = 1e4
_SWAPPED_RAD = 0.01

# Velocities and positions of one receiver.
_STEP_NS, _LONGEST_NS = 1_000_000_000, 4_000_000_000
_LEAST_STEPS = 4  # intervals
#: Least rms speed, well above that of position errors of some decimetres.
_LEAST_M_S, _LEAST_CLIMB_M_S = 1.0, 0.4
_SURE = 0.92  # correlation of climbs with a wrong sign
#: Share of the squares that remains under a wrong and under a right explanation.
_WRONG, _RIGHT = 0.5, 0.15
#: Factors of speeds in units other than m/s. A ratio of speeds within 8 % of a factor (_BESIDE, as
#: a logarithm) is that unit: noise that leaves the share _RIGHT changes the ratio by as much.
_UNITS = {"km/h": 3.6, "knots": 1.944, "mph": 2.237, "ft/s": 3.281, "cm/s": 100.0, "mm/s": 1000.0}
_BESIDE = -0.5 * math.log(1 - _RIGHT)
#: Matrices from the message's north and east to the true ones; the first one is the identity.
_EXCHANGES = [
    np.array((first, second)) @ axes
    for axes in (np.eye(2), np.eye(2)[::-1])
    for first, second in itertools.product(((1, 0), (-1, 0)), ((0, 1), (0, -1)))
]

# All checks together.
#: A clock that goes back by more starts another recording: all checks are reset.
_BACK_NS = 10_000_000_000
#: Checks of the body's attitude; those that then wrongly blame the camera; those of the ground.
_ATTITUDE = ("imu_tilt", "force_", "gyro_", "heading_")
_OF_CAMERA = ("boresight_by_motion", "picture_motion")
_OF_GROUND = ("below_ground", "height_at_rest", "ground_by_motion")


class NavigationChecks:
    """Take the filter's inputs in their order of arrival.

    ``explicit`` are the parameters that were set (``aircraft.rtk_antenna_m``), None if not known.
    Gaps of the IMU become a note ``gap_counts_s`` after the last: in flight they are over then, in
    a log they always count. ``pause`` is called between the checks, which take some milliseconds.
    """

    def __init__(
        self,
        config: EkfConfig,
        explicit: Collection[str] | None,
        gap_counts_s: float = math.inf,
        pause: Callable[[], object] = lambda: None,
    ) -> None:
        self._explicit, self._gap_counts_s, self._pause = explicit, gap_counts_s, pause
        self.configure(config)

    def configure(self, config: EkfConfig) -> None:
        """Take other parameters, and begin again: all evidence was about the former ones."""
        self._config = config
        self._streams: dict[str, Stream] = {}
        self._first_ns = self._arrived_ns = 0
        self._blocks = ImuBlocks(config.aircraft.rotation_bi)
        self._imu, self._heading = ImuChecks(config.aircraft.rotation_bi), HeadingChecks(config)
        self._vibration = VibrationChecks(config.imu)
        self._positions, self._stamps = PositionChecks(config), StampChecks(config)
        self._velocities = {
            Source.RTK_VELOCITY: VelocityChecks("rtk/vel", "rtk/fix"),
            Source.GPS_VELOCITY: VelocityChecks("gps/vel", "gps/fix"),
        }
        self._levers = LeverChecks(config, self._explicit)
        self._plane: TangentPlane | None = None
        self._inertial = True  # whether imu/data has more than attitudes

    def take(self, topic: str, sample: NavigationInput, arrival_ns: int) -> None:
        """Take a sample of a topic (``rtk/fix``), as it arrived; ignore a heading set by hand."""
        if isinstance(sample, SetHeading):
            return
        if arrival_ns < self._arrived_ns - _BACK_NS:
            self.configure(self._config)
        self._first_ns, self._arrived_ns = self._first_ns or arrival_ns, arrival_ns
        if topic not in self._streams:
            self._streams[topic] = Stream(longest_step_s(topic, self._config))
        stream = self._streams[topic]
        stream.add(sample, arrival_ns)
        if isinstance(sample, ImuSample):
            self._inertial = not sample.is_attitude_alone
            self._vibration.add(sample)
            block = self._blocks.add(sample)
            if block is not None:
                for collector in (self._imu, self._heading, self._levers.fit):
                    collector.block(block)
            return
        if IMU in self._streams:
            self._stamps.take(topic, stream, self._streams[IMU])
        self._aid(sample)

    def _aid(self, sample: NavigationInput) -> None:
        if isinstance(sample, HeadingSample):
            self._heading.heading(sample)
            if not fault_of(sample):
                heading = np.array(sample.heading_rad)
                self._levers.fit.take(sample.source, sample.stamp_ns, heading)
        elif isinstance(sample, PositionSample):
            self._position(sample)
        elif isinstance(sample, VelocitySample) and not fault_of(sample):
            self._velocities[sample.source].velocity(sample)
            if sample.source is Source.RTK_VELOCITY:
                self._heading.velocity(sample)
                self._levers.fit.take(sample.source, sample.stamp_ns, sample.velocity_n)

    def findings(self) -> list[Finding]:
        """Return the findings from all samples so far, the most severe first."""
        imu = self._imu.findings()
        self._pause()
        turned = any("gyro" in each.check or "axes" in each.check for each in imu)
        waited_ns = self._arrived_ns - self._first_ns
        findings = [
            *imu,
            # Wrong gyroscopes would make headings seem wrong.
            *([] if turned else self._heading.findings()),
            *self._positions.findings(),
            *(each for checks in self._velocities.values() for each in checks.findings()),
            *self._stamps.findings(),
            *stream_findings(
                self._streams,
                self._config,
                waited_ns,
                self._gap_counts_s,
                inertial=self._inertial,
            ),
            *([] if imu else self._vibration.findings()),  # its unit would be wrong too
        ]
        self._pause()
        if all(each.severity < Severity.STOP for each in findings):  # the fit trusts all inputs
            findings += self._levers.findings(self._streams)
        return sorted_findings(findings)

    def _position(self, sample: PositionSample) -> None:
        self._positions.position(sample)
        if sample.status is FixStatus.NONE or fault_of(sample):
            return
        place = sample.latitude_rad, sample.longitude_rad, sample.height_m
        self._plane = self._plane or TangentPlane(*place)  # at the first position
        position_n = self._plane.ned_from_geodetic(*place)
        is_rtk = sample.source is Source.RTK_POSITION
        velocity = Source.RTK_VELOCITY if is_rtk else Source.GPS_VELOCITY
        self._velocities[velocity].position(sample.stamp_ns, position_n)
        if is_rtk and sample.status is FixStatus.FIXED:
            self._levers.fit.take(sample.source, sample.stamp_ns, position_n)


def nearest_causes(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings without those that are consequences of others.

    While the body's attitude is wrong, findings on the camera's direction are left out. Heights
    above sea level in rtk/fix make the ground seem wrong: height_datum becomes as severe as that.
    """
    stops = [each.check for each in findings if each.severity is Severity.STOP]
    is_attitude_wrong = any(check.startswith(_ATTITUDE) for check in stops)
    ground = max((f.severity for f in findings if f.check in _OF_GROUND), default=Severity.NOTE)
    return [
        replace(each, severity=max(each.severity, ground))
        if each.check == "height_datum"
        else each
        for each in findings
        if not (is_attitude_wrong and each.check in _OF_CAMERA)
    ]


class PositionChecks:
    """Compare the positions of both receivers."""

    def __init__(self, config: EkfConfig) -> None:
        self._sigma_m = np.array(config.gps.position_sigma_m)
        self._newest: dict[Source, PositionSample] = {}
        # GPS minus RTK, NED, m, and its sigma, m: (6,)
        self._apart: deque[Array] = deque(maxlen=_KEPT)
        self._spacing = Spacing(_NEAR_NS)

    def position(self, sample: PositionSample) -> None:
        """Take a position as it arrived, also one with latitude and longitude swapped."""
        place = sample.latitude_rad, sample.longitude_rad, sample.height_m
        if sample.status is FixStatus.NONE or not all(map(math.isfinite, place)):
            return
        self._newest[sample.source] = sample
        rtk = self._newest.get(Source.RTK_POSITION)
        gps = self._newest.get(Source.GPS_POSITION)
        if rtk is None or gps is None or abs(rtk.stamp_ns - gps.stamp_ns) > _NEAR_NS:
            return
        if not self._spacing.take(sample.stamp_ns):
            return
        plane = TangentPlane(rtk.latitude_rad, rtk.longitude_rad, rtk.height_m)
        apart_n = plane.ned_from_geodetic(gps.latitude_rad, gps.longitude_rad, gps.height_m)
        variances = gps.covariance_n.diagonal()
        sigma = self._sigma_m
        if variances.min() > 0:
            sigma = np.sqrt(variances + np.maximum(rtk.covariance_n.diagonal(), 0.0))
        if np.isfinite(sigma).all():
            self._apart.append(np.append(apart_n, sigma))

    def findings(self) -> list[Finding]:
        """Return findings where they differ during the whole time by more than GPS errors."""
        if len(self._apart) < _LEAST_PAIRS:
            return []
        apart, sigma = np.hsplit(np.array(self._apart), 2)
        limit = np.maximum(_SIGMAS * sigma.mean(axis=0), _LEAST_M)
        north, east, down = np.median(apart, axis=0).tolist()
        if math.hypot(north, east) > _ELSEWHERE_M:
            rtk, gps = self._newest[Source.RTK_POSITION], self._newest[Source.GPS_POSITION]
            crossed = rtk.latitude_rad - gps.longitude_rad, rtk.longitude_rad - gps.latitude_rad
            case = "swapped" if max(map(abs, crossed)) < _SWAPPED_RAD else ""
            apart_km = math.hypot(north, east) / 1e3
            return [finding("position_elsewhere", case, apart_km=apart_km)]
        findings = []
        if np.percentile(np.abs(apart[:, 2]), 10) > limit[2]:
            off, sigma_m = f"{-down:+.1f} m above rtk/fix", sigma[:, 2].mean()
            case = "geoid" if abs(down) < LARGEST_UNDULATION_M else ""
            findings.append(finding("height_datum", case, off=off, sigma_m=sigma_m))
        if np.percentile(np.linalg.norm(apart[:, :2], axis=1), 10) > math.hypot(*limit[:2]):
            off = f"{north:+.0f} m north and {east:+.0f} m east of rtk/fix"
            findings.append(finding("position_datum", off=off, sigma_m=sigma[:, :2].mean()))
        return findings


class VelocityChecks:
    """Compare one receiver's velocities with its positions (NED m of any plane)."""

    def __init__(self, topic: str, positions: str) -> None:
        self._topics = {"topic": topic, "positions": positions}
        self._begin: tuple[int, Array] | None = None  # stamp and position of the interval's start
        self._velocities: deque[tuple[int, Array]] = deque(maxlen=400)
        # of each interval: its mean velocity from the positions, and as sent
        self._pairs: deque[tuple[Array, Array]] = deque(maxlen=_KEPT)

    def velocity(self, sample: VelocitySample) -> None:
        """Take a velocity as it arrived."""
        self._velocities.append((sample.stamp_ns, sample.velocity_n))

    def position(self, stamp_ns: int, position_n: Array) -> None:
        """Take a position (3,), NED, m."""
        begin_ns, begin_n = self._begin or (stamp_ns, position_n)
        if 0 <= stamp_ns - begin_ns < _STEP_NS and self._begin:
            return
        self._begin = stamp_ns, position_n
        inside = [v for t, v in self._velocities if begin_ns <= t <= stamp_ns]
        if len(inside) >= 2 and 0 < stamp_ns - begin_ns < _LONGEST_NS:
            way_n = (position_n - begin_n) / ((stamp_ns - begin_ns) * 1e-9)
            self._pairs.append((way_n, np.mean(inside, axis=0)))

    def findings(self) -> list[Finding]:
        """Return the fault of the horizontal axes, of the unit, or of the sign of climbs."""
        if len(self._pairs) < _LEAST_STEPS:
            return []
        ways, own = map(np.array, zip(*self._pairs, strict=True))
        fault = self._horizontal(ways[:, :2], own[:, :2]) or self._vertical(ways[:, 2], own[:, 2])
        return [fault] if fault else []

    def _vertical(self, ways: Array, own: Array) -> Finding | None:
        """Compare mean velocities (N,), m/s, down, from positions and as sent."""
        true_m_s, own_m_s = (math.sqrt((down**2).mean()) for down in (ways, own))
        slow = min(true_m_s, own_m_s) < _LEAST_CLIMB_M_S
        if slow or float((ways * own).mean()) > -_SURE * true_m_s * own_m_s:
            return None
        return finding("{topic}_up", **self._topics)

    def _horizontal(self, ways: Array, own: Array) -> Finding | None:
        """Compare mean velocities (N, 2), m/s, north and east, from positions and as sent."""
        true_m_s, own_m_s = (math.sqrt((speed**2).sum(axis=1).mean()) for speed in (ways, own))
        if max(true_m_s, own_m_s) < _LEAST_M_S or true_m_s <= 0:
            return None
        if own_m_s <= 0:
            return finding("{topic}_zero", **self._topics, speed=true_m_s)
        across = ways.T @ own / (len(ways) * true_m_s * own_m_s)
        likeness = np.array([np.sum(across * matrix) for matrix in _EXCHANGES])
        unexplained = 1 - np.maximum(likeness, 0) ** 2  # share of the squares, with the best scale
        best = int(np.argmin(unexplained))
        if unexplained[0] > _WRONG and unexplained[best] < _RIGHT:
            north, east = (
                f"{'-' if min(row) < 0 else ''}{('north', 'east')[int(np.argmax(np.abs(row)))]}"
                for row in _EXCHANGES[best]
            )
            axes = {"north": north, "east": east, "best": likeness[best], "present": likeness[0]}
            return finding("{topic}_axes:exchanged", **self._topics, **axes)
        # Noise changes speeds and directions alike; wrong axes change directions only.
        apart = np.linalg.norm(ways, axis=1) - np.linalg.norm(own, axis=1)
        if unexplained[best] > _WRONG and float(np.mean(apart**2)) < _RIGHT * true_m_s * own_m_s:
            return finding("{topic}_axes:body", **self._topics)
        return self._of_unit(true_m_s, own_m_s) if unexplained[best] < _RIGHT else None

    def _of_unit(self, true_m_s: float, own_m_s: float) -> Finding | None:
        """Return a finding if the ratio of two rms speeds of one motion is that of a unit."""
        off = abs(math.log(own_m_s / true_m_s))
        unit, factor = min(_UNITS.items(), key=lambda item: abs(off - math.log(item[1])))
        if not abs(off - math.log(factor)) < _BESIDE:
            return None
        numbers = {"own": own_m_s, "speed": true_m_s, "factor": factor}
        return finding("{topic}_unit", **self._topics, **numbers, unit=unit)

"""Check the filter's inputs and their parameters.

Samples are taken as they arrive, before the filter's own checks reject any.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from tirgeo_ros.core.checks.heading_checks import HeadingChecks
from tirgeo_ros.core.checks.imu_checks import ImuBlocks, ImuChecks
from tirgeo_ros.core.checks.lever_arm_checks import LeverChecks
from tirgeo_ros.core.checks.position_checks import PositionChecks
from tirgeo_ros.core.checks.stamp_checks import StampChecks
from tirgeo_ros.core.checks.stream_checks import IMU, Stream, longest_step_s, stream_findings
from tirgeo_ros.core.checks.velocity_checks import VelocityChecks
from tirgeo_ros.core.config import EkfConfig, ImuConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.ins.vibration_noise import mean_powers
from tirgeo_ros.core.navigation.timeline.imu_clipping import Clipping
from tirgeo_ros.core.streams.sanity_checks import fault_of
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

#: A clock that goes back by more starts another recording: all checks are reset.
_BACK_NS = 10_000_000_000
#: The vibration of one second in five is measured.
_LOOK_NS, _EVERY_NS = 1_000_000_000, 5_000_000_000
_LEAST_NUMBER = 3
#: Ratio of measured to configured noise density; they are in its model with larger covariances.
_STRONG = 10.0
#: More clipped samples than one knock gives, and the share of samples that harms the filter.
_LEAST_CLIPPED, _MOST_CLIPPED = 5, 1e-4


#: Checks that blame what makes the body's attitude, and those that then blame the camera for it.
_ATTITUDE = ("imu_tilt", "force_", "gyro_", "heading_")
_OF_CAMERA = ("boresight_by_motion", "picture_motion")
_OF_GROUND = ("below_ground", "height_at_rest", "ground_by_motion")


def nearest_causes(found: Sequence[Finding]) -> list[Finding]:
    """Return findings, those that follow from others left out or after these.

    While the body's attitude is wrong, the camera's direction is not blamed. Heights above sea
    level in rtk/fix make the ground seem wrong: the datum is as severe as that.
    """
    wrong = any(one.severity is Severity.STOP and one.check.startswith(_ATTITUDE) for one in found)
    ground = max((one.severity for one in found if one.check in _OF_GROUND), default=Severity.NOTE)
    return [
        replace(one, severity=max(one.severity, ground)) if one.check == "height_datum" else one
        for one in found
        if not (wrong and one.check in _OF_CAMERA)
    ]


class NavigationChecks:
    """Take the filter's inputs in their order of arrival.

    ``given`` are the parameters that were set explicitly (``aircraft.rtk_antenna_m``), None if
    not known. ``gap_counts_s`` after the last gap of the IMU its gaps are a note: in flight they
    are over, in a log they count for good.
    """

    def __init__(
        self,
        config: EkfConfig,
        given: Collection[str] | None,
        gap_counts_s: float = math.inf,
    ) -> None:
        self._given, self._gap_counts_s = given, gap_counts_s
        self.configure(config)

    def configure(self, config: EkfConfig) -> None:
        """Take other parameters, and begin again: the evidence was against the former ones."""
        self._config = config
        self._begin(config)

    def _begin(self, config: EkfConfig) -> None:
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
        self._levers = LeverChecks(config, self._given)
        self._plane: TangentPlane | None = None

    def take(self, topic: str, sample: NavigationInput, arrival_ns: int) -> None:
        """Take a sample of a topic (``rtk/fix``), as it arrived; a set heading is no stream."""
        if isinstance(sample, SetHeading):
            return
        if arrival_ns < self._arrived_ns - _BACK_NS:
            self._begin(self._config)
        self._first_ns, self._arrived_ns = self._first_ns or arrival_ns, arrival_ns
        if topic not in self._streams:
            self._streams[topic] = Stream(longest_step_s(topic, self._config))
        stream = self._streams[topic]
        stream.add(sample, arrival_ns)
        if isinstance(sample, ImuSample):
            self._vibration.add(sample)
            block = self._blocks.add(sample)
            if block is not None:
                for check in (self._imu, self._heading, self._levers):
                    check.block(block)
            return
        if IMU in self._streams:
            self._stamps.take(topic, stream, self._streams[IMU])
        self._aid(sample)

    def _aid(self, sample: NavigationInput) -> None:
        if isinstance(sample, HeadingSample):
            self._heading.heading(sample)
            if not fault_of(sample):
                self._levers.heading(sample.stamp_ns, sample.heading_rad)
        elif isinstance(sample, PositionSample):
            self._position(sample)
        elif isinstance(sample, VelocitySample) and not fault_of(sample):
            self._velocities[sample.source].velocity(sample)
            if sample.source is Source.RTK_VELOCITY:
                self._heading.velocity(sample)
                self._levers.velocity(sample.stamp_ns, sample.velocity_n)

    def findings(self) -> list[Finding]:
        """Return the findings from all samples so far, the most severe first."""
        imu = self._imu.findings()
        turned = any("gyro" in one.check or "axes" in one.check for one in imu)
        found = [
            *imu,
            # Headings are compared with the gyroscopes.
            *([] if turned else self._heading.findings()),
            *self._positions.findings(),
            *(one for check in self._velocities.values() for one in check.findings()),
            *self._stamps.findings(),
            *stream_findings(
                self._streams,
                self._config,
                self._arrived_ns - self._first_ns,
                self._gap_counts_s,
            ),
            *([] if imu else self._vibration.findings()),  # its unit would be wrong too
        ]
        if not any(one.severity is Severity.STOP for one in found):  # the fit trusts all inputs
            found += self._levers.findings(self._streams)
        return sorted_findings(found)

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
            self._levers.position(sample.stamp_ns, position_n)


class VibrationChecks:
    """Check every IMU sample for clipping, and one second in five for vibration."""

    def __init__(self, config: ImuConfig) -> None:
        self._known = np.array((*config.angle_random_walk, *config.velocity_random_walk))
        self._clipping = Clipping()
        self._count = 0
        self._samples: list[ImuSample] = []
        self._begin_ns = 0
        # of the measured seconds, six each, for an hour
        self._powers: deque[tuple[float, ...]] = deque(maxlen=720)

    def add(self, sample: ImuSample) -> None:
        """Take the next sample, as it arrived; an invalid one is ignored."""
        if fault_of(sample):
            return
        self._count += 1
        self._clipping.add(sample)
        since_ns = sample.stamp_ns - self._begin_ns
        if not 0 <= since_ns < _EVERY_NS:
            self._begin_ns, self._samples = sample.stamp_ns, [sample]
        elif since_ns < _LOOK_NS:
            self._samples.append(sample)
        elif len(self._samples) > 2:
            self._powers.append(mean_powers(self._samples))
            self._samples = []

    def findings(self) -> list[Finding]:
        """Return the findings on vibration and on clipping."""
        found = []
        if len(self._powers) >= _LEAST_NUMBER:
            measured = np.sqrt(np.mean(self._powers, axis=0))
            ratios = np.divide(measured, self._known, out=np.zeros(6), where=self._known > 0)
            if ratios.max() > _STRONG:
                evidence = (
                    f"vibration is {ratios[:3].max():.0f} times the gyroscopes' configured noise "
                    f"and {ratios[3:].max():.0f} times the accelerometers'"
                )
                where = "ekf_node imu.angle_random_walk, imu.velocity_random_walk"
                mend = "damp the IMU's mount; measure the noise with tirgeo calibrate allan"
                found.append(Finding("vibration", Severity.NOTE, evidence, where, mend))
        counts = self._clipping.counts
        if sum(counts.values()) >= max(_LEAST_CLIPPED, _MOST_CLIPPED * self._count):
            listed = ", ".join(f"{name} {number}" for name, number in counts.items())
            evidence = f"imu/data reaches the end of its range: {listed} of {self._count} samples"
            mend = "damp the IMU's mount or choose a larger range; balance the rotors"
            found.append(Finding("imu_clipping", Severity.CAUTION, evidence, "imu/data", mend))
        return found

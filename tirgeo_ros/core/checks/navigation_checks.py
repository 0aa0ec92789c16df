"""Check the filter's inputs and their parameters.

Samples are taken as they arrive, before the filter's own checks reject any.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace

from tirgeo_ros.core.checks.heading_checks import HeadingChecks
from tirgeo_ros.core.checks.inertial_checks import ImuBlocks, ImuChecks, VibrationChecks
from tirgeo_ros.core.checks.lever_arm_checks import LeverChecks
from tirgeo_ros.core.checks.receiver_checks import PositionChecks, VelocityChecks
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
#: Checks that blame what makes the body's attitude, and those that then blame the camera for it.
_ATTITUDE = ("imu_tilt", "force_", "gyro_", "heading_")
_OF_CAMERA = ("boresight_by_motion", "picture_motion")
_OF_GROUND = ("below_ground", "height_at_rest", "ground_by_motion")


def nearest_causes(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings without those that are consequences of others.

    While the body's attitude is wrong, the camera's direction is not blamed. Heights above sea
    level in rtk/fix make the ground seem wrong: the datum is as severe as that.
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


class NavigationChecks:
    """Take the filter's inputs in their order of arrival.

    ``explicit`` are the parameters that were set (``aircraft.rtk_antenna_m``), None if not known.
    ``gap_counts_s`` after the last gap of the IMU its gaps are a note: in flight they
    are over, in a log they count for good.
    """

    def __init__(
        self,
        config: EkfConfig,
        explicit: Collection[str] | None,
        gap_counts_s: float = math.inf,
    ) -> None:
        self._explicit, self._gap_counts_s = explicit, gap_counts_s
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

    def take(self, topic: str, sample: NavigationInput, arrival_ns: int) -> None:
        """Take a sample of a topic (``rtk/fix``), as it arrived; a set heading is no stream."""
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
                self._levers.fit.heading(sample.stamp_ns, sample.heading_rad)
        elif isinstance(sample, PositionSample):
            self._position(sample)
        elif isinstance(sample, VelocitySample) and not fault_of(sample):
            self._velocities[sample.source].velocity(sample)
            if sample.source is Source.RTK_VELOCITY:
                self._heading.velocity(sample)
                self._levers.fit.velocity(sample.stamp_ns, sample.velocity_n)

    def findings(self) -> list[Finding]:
        """Return the findings from all samples so far, the most severe first."""
        imu = self._imu.findings()
        turned = any("gyro" in each.check or "axes" in each.check for each in imu)
        findings = [
            *imu,
            # Headings are compared with the gyroscopes.
            *([] if turned else self._heading.findings()),
            *self._positions.findings(),
            *(each for checks in self._velocities.values() for each in checks.findings()),
            *self._stamps.findings(),
            *stream_findings(
                self._streams,
                self._config,
                self._arrived_ns - self._first_ns,
                self._gap_counts_s,
            ),
            *([] if imu else self._vibration.findings()),  # its unit would be wrong too
        ]
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
            self._levers.fit.position(sample.stamp_ns, position_n)

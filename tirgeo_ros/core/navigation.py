"""The one door to the estimators: any sample in, a verdict out, and a solution when one is due.

``ekf_node`` and ``tirgeo process`` both drive this class, so they cannot differ.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace

from tirgeo_ros.core.aiding.fusion import Aiding, source_of
from tirgeo_ros.core.alignment import Aligner, Alignment
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.ekf import Ekf
from tirgeo_ros.core.errors import ConfigError
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.passthrough import Passthrough
from tirgeo_ros.core.rate import RateLimit
from tirgeo_ros.core.refusals import RefusalWatch
from tirgeo_ros.core.samples import (
    FilterState,
    FixStatus,
    HeadingSample,
    ImuSample,
    NavigationInput,
    NavigationStatus,
    NavSolution,
    Outcome,
    PositionSample,
    Source,
    Verdict,
)
from tirgeo_ros.core.validity import LARGEST_HEIGHT_M, fault_of, usable_attitude

#: An IMU stamp that goes back further is another clock or another run of a bag, not disorder.
_CLOCK_JUMP_NS = 1_000_000_000
#: A receiver that has been silent for longer has no status.
_STATUS_AGE_NS = 2_000_000_000
_IMU_USED = Verdict(Source.IMU, Outcome.USED)
_GPS = (Source.GPS_POSITION, Source.GPS_VELOCITY)
_RTK = (Source.IMU, Source.RTK_POSITION, Source.RTK_VELOCITY)
#: What each method takes.
METHOD_SOURCES: Mapping[str, tuple[Source, ...]] = {
    "raw": (Source.IMU, *_GPS),
    "rtk": _RTK,
    "ekf": _RTK,
    "ekf_heading": (*_RTK, Source.RTK_HEADING),
}


@dataclass(frozen=True, slots=True)
class Step:
    """What one sample led to; ``solution`` is there when it is due to be published."""

    verdict: Verdict
    solution: NavSolution | None = None


class Navigation:
    """The chosen method, fed in the order of arrival.

    Raises ConfigError for an origin that is nowhere on earth.
    """

    def __init__(self, config: EkfConfig) -> None:
        self._config = config
        self._filtering = config.method in {"ekf", "ekf_heading"}
        self._use_heading = config.method == "ekf_heading"
        gps = config.method == "raw"
        self._position_source = Source.GPS_POSITION if gps else Source.RTK_POSITION
        self._rtk_delay_ns = round(config.rtk.delay_s * 1e9)
        self._counts: Counter[tuple[str, str]] = Counter()
        self._test_ratios: dict[str, float] = {}
        self._plane = _configured_plane(config)
        self._begin()

    def _begin(self) -> None:
        """Forget the state; the map's origin and the counts stay."""
        self._ekf: Ekf | None = None
        self._aligner = Aligner(self._config, use_heading=self._use_heading)
        self._passthrough = Passthrough(self._config, self._position_source)
        self._refusals = RefusalWatch()
        self._imu_ns: int | None = None
        self._rate = RateLimit(self._config.publish_rate_hz)
        self._heading_sigma_rad = math.nan
        self._rtk_status = FixStatus.NONE
        self._rtk_status_ns = 0

    @property
    def plane(self) -> TangentPlane | None:
        """The plane of ``map``: as configured, or at the first accepted position."""
        return self._plane

    @property
    def rtk_status(self) -> FixStatus:
        """What the RTK receiver last said of its fix; NONE once it is silent."""
        silent = (self._imu_ns or 0) - self._rtk_status_ns > _STATUS_AGE_NS
        return FixStatus.NONE if silent else self._rtk_status

    def reset(self) -> None:
        """Start again from alignment. The origin of ``map`` stays where it is."""
        self._begin()

    def process(self, sample: NavigationInput) -> Step:
        """Take one sample. Whatever is in it, the state stays finite."""
        fault = fault_of(sample)
        if fault:
            source = Source.IMU if isinstance(sample, ImuSample) else source_of(sample)
            step = Step(Verdict(source, Outcome.INVALID, fault))
        elif isinstance(sample, ImuSample):
            step = self._process_imu(sample)
        else:
            step = self._process_aiding(sample)
        self._count(step.verdict)
        return step

    def status(self) -> NavigationStatus:
        """Where the estimator stands."""
        state, reason = self._state()
        running = state is FilterState.RUNNING
        return NavigationStatus(
            self._config.method,
            state,
            reason,
            self.rtk_status,
            self._heading_sigma_rad if running else math.nan,
            dict(self._counts),
            dict(self._test_ratios),
        )

    def _state(self) -> tuple[FilterState, str]:
        if self._filtering:
            if self._ekf is not None:
                return FilterState.RUNNING, ""
            moving = self._imu_ns is not None and self.rtk_status > FixStatus.NONE
            return (FilterState.ALIGNING if moving else FilterState.WAITING), self._aligner.reason
        reason = self._passthrough.reason
        return (FilterState.WAITING if reason else FilterState.RUNNING), reason

    def _process_imu(self, sample: ImuSample) -> Step:
        outcome, reason = self._time_check(sample.stamp_ns)
        if outcome is Outcome.OUT_OF_ORDER:
            return Step(Verdict(Source.IMU, outcome, reason))
        if outcome is not Outcome.USED:
            self._begin()
        self._imu_ns = sample.stamp_ns
        if self._ekf is not None:
            self._ekf.add_imu(sample)
            for verdict in self._ekf.take_resolved():
                self._count(self._judged(verdict, sample.stamp_ns))
        elif self._filtering:
            self._aligner.add(sample)
            outcome = Outcome.WAITING if outcome is Outcome.USED else outcome
        else:
            self._passthrough.add_imu(sample)
            if outcome is Outcome.USED and not usable_attitude(sample.autopilot_q_nb):
                outcome, reason = Outcome.INVALID, "no orientation"
        used = outcome is Outcome.USED
        verdict = _IMU_USED if used else Verdict(Source.IMU, outcome, reason)
        return Step(verdict, self._due_solution(sample.stamp_ns))

    def _time_check(self, stamp_ns: int) -> tuple[Outcome, str]:
        if self._imu_ns is None:
            return Outcome.USED, ""
        ahead_ns = stamp_ns - self._imu_ns
        if ahead_ns < -_CLOCK_JUMP_NS:
            return Outcome.TIME_JUMP, f"imu/data went back by {-ahead_ns * 1e-9:.3f} s"
        if ahead_ns <= 0:
            return Outcome.OUT_OF_ORDER, "stamp not later than the one before"
        if ahead_ns > self._config.max_imu_gap_s * 1e9 and self._filtering:
            return Outcome.GAP, f"no imu/data for {ahead_ns * 1e-9:.3f} s"
        return Outcome.USED, ""

    def _process_aiding(self, sample: Aiding) -> Step:
        if self._rtk_delay_ns and source_of(sample) not in _GPS:
            sample = replace(sample, stamp_ns=sample.stamp_ns - self._rtk_delay_ns)
        if isinstance(sample, PositionSample) and sample.source is Source.RTK_POSITION:
            self._rtk_status, self._rtk_status_ns = sample.status, sample.stamp_ns
        refused = self._refusal(sample)
        if refused is not None:
            return Step(refused)
        if not self._filtering:
            verdict = self._passthrough.add_aiding(sample)
        elif self._ekf is not None:
            verdict = self._ekf.add_aiding(sample)
        else:
            verdict = Verdict(source_of(sample), Outcome.WAITING, "not aligned yet")
            self._start(self._aligner.add(sample))
        self._settle_plane(sample, verdict)
        return Step(self._judged(verdict, sample.stamp_ns))

    def _judged(self, verdict: Verdict, stamp_ns: int) -> Verdict:
        """The verdict; where a source has been refused for long, the filter begins again."""
        if not self._refusals.hopeless(verdict, stamp_ns):
            return verdict
        self._begin()
        reason = "refused for 2 s: the filter starts again"
        return replace(verdict, outcome=Outcome.RESTART, reason=reason)

    def _refusal(self, sample: Aiding) -> Verdict | None:
        """A verdict on samples that the method or the receiver's own word rules out."""
        source = source_of(sample)
        if source not in METHOD_SOURCES[self._config.method]:
            return Verdict(source, Outcome.UNUSED)
        if isinstance(sample, HeadingSample):
            fixed = self.rtk_status is FixStatus.FIXED
            return None if fixed else Verdict(source, Outcome.NOT_FIXED, "rtk/fix is not fixed")
        if isinstance(sample, PositionSample) and sample.status < self._least_status(source):
            return Verdict(source, Outcome.NOT_FIXED, f"status {sample.status.name.lower()}")
        return None

    def _least_status(self, source: Source) -> FixStatus:
        return FixStatus.FLOAT if source is Source.RTK_POSITION else FixStatus.SINGLE

    def _settle_plane(self, sample: Aiding, verdict: Verdict) -> None:
        if self._plane is not None or not isinstance(sample, PositionSample):
            return
        if sample.source is self._position_source and verdict.outcome in {
            Outcome.USED,
            Outcome.WAITING,
        }:
            self._plane = TangentPlane(sample.latitude_rad, sample.longitude_rad, sample.height_m)

    def _start(self, alignment: Alignment | None) -> None:
        if alignment is None:
            return
        self._ekf = Ekf(self._config, alignment)
        for imu in alignment.imu[1:]:
            self._ekf.add_imu(imu)
        for sample in alignment.later:
            self._count(self._ekf.add_aiding(sample))  # type: ignore[arg-type]

    def _due_solution(self, stamp_ns: int) -> NavSolution | None:
        """A solution, at ``publish_rate_hz`` at the most."""
        if not self._rate.due(stamp_ns):
            return None
        solution = self._ekf.solution() if self._ekf else None
        if not self._filtering:
            solution = self._passthrough.solution()
        if solution is not None:
            self._heading_sigma_rad = math.sqrt(solution.covariance[5, 5])
        return solution

    def _count(self, verdict: Verdict) -> None:
        self._counts[verdict.source.value, verdict.outcome.value] += 1
        if not math.isnan(verdict.test_ratio):
            self._test_ratios[verdict.source.value] = verdict.test_ratio


def _configured_plane(config: EkfConfig) -> TangentPlane | None:
    if not config.origin_lat_lon_h:
        return None
    latitude_deg, longitude_deg, height_m = config.origin_lat_lon_h
    if abs(latitude_deg) > 90 or abs(longitude_deg) > 180:
        raise ConfigError(
            f"parameter origin_lat_lon_h: {latitude_deg:g}, {longitude_deg:g} deg is no latitude "
            "and longitude"
        )
    if abs(height_m) >= LARGEST_HEIGHT_M:
        raise ConfigError(f"parameter origin_lat_lon_h: {height_m:g} m is no height on earth")
    return TangentPlane(math.radians(latitude_deg), math.radians(longitude_deg), height_m)

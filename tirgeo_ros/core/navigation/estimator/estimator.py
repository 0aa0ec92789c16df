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
"""Run the chosen estimator: take any sample, return a verdict, and a solution when one is due.

``ekf_node`` and ``tirgeo process`` both drive this class, so their results cannot differ.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.aid import Aiding
from tirgeo_ros.core.navigation.aiding.aid_status import AID_SOURCES
from tirgeo_ros.core.navigation.aiding.fusion import AIDS, METHOD_SOURCES, Delays
from tirgeo_ros.core.navigation.aiding.rest import RestTest
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.navigation.estimator.filter_status import FilterHealth, VerdictLog
from tirgeo_ros.core.navigation.estimator.start_up import StartUp
from tirgeo_ros.core.navigation.estimator.unfiltered_solution import UnfilteredSolution
from tirgeo_ros.core.navigation.ins.propagation import densities
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.navigation.timeline.aid_stamps import AidClocks, DuplicateDetector, Same
from tirgeo_ros.core.navigation.timeline.ekf import Ekf
from tirgeo_ros.core.navigation.timeline.imu_checks import Clipping, ImuClock, in_body_axes
from tirgeo_ros.core.streams.sanity_checks import ATTITUDE_ALONE, LARGEST_HEIGHT_M, fault_of
from tirgeo_ros.core.streams.stamps import RateLimit
from tirgeo_ros.core.types.errors import ConfigError
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    ImuSample,
    NavigationInput,
    PositionSample,
    Source,
)
from tirgeo_ros.core.types.poses import NavSolution
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus, Outcome, Verdict

#: Interval between two checks of the filter's health.
_WATCH_NS = 100_000_000
#: An attitude that is late by less is out of order; more is another clock, or a bag that restarts.
_DISORDER_NS = 1_000_000_000
_IMU_USED = Verdict(Source.IMU, Outcome.USED)
_IMU_KEY = (Source.IMU, Outcome.USED)
#: Where a source's mean NIS is larger, its errors may pass for a delay of the IMU.
_DELAY_NIS = 2.0
_LATE = (
    "imu/data: stamps are {size_ms:.1f} ms {way} than the parameters say (sigma {sigma_ms:.1f} "
    "ms): set imu.delay_s to {delay_s:.4f}"
)


class Step(NamedTuple):
    """Hold the verdict on one sample, and the solution if one is due to be published."""

    verdict: Verdict
    solution: NavSolution | None = None


class Navigation:
    """Run the configured method on samples in the order of their arrival.

    ``on_verdict`` is called with every verdict except those on used IMU samples. A sample that was
    held has a second verdict. ``plane`` is that of ``map``: as configured, or at the first
    accepted position. Raises ConfigError for an origin that is not on earth.
    """

    def __init__(
        self, config: EkfConfig, on_verdict: Callable[[Verdict], None] | None = None
    ) -> None:
        self._config = config
        self._log = VerdictLog(on_verdict)
        self._filtering = config.method in {"ekf", "ekf_heading"}
        gps = config.method == "raw"
        self._position_source = Source.GPS_POSITION if gps else Source.RTK_POSITION
        self._least_status = FixStatus.SINGLE if gps else FixStatus.FLOAT  # for the origin
        self._delays = Delays.from_config(config)
        self._rotation_bi = config.aircraft.rotation_bi
        self._health = FilterHealth(config)
        self._clipping = Clipping()
        self._resets: Counter[Source] = Counter()  # of all filters before the current one
        self._last_reset = ""
        self.plane = configured_plane(config)
        self._ekf: Ekf | None = None
        #: Grows whenever the state or the number of resets may have changed.
        self.revision = 0
        self.reset()

    def reset(self) -> None:
        """Start again from alignment. The origin of ``map`` stays where it is."""
        self._imu_clock = ImuClock(self._config.max_imu_gap_s)
        self._entered: tuple[FilterState, int] = (FilterState.WAITING, 0)
        #: What the newest attitude without rates lacks for a solution; None with an IMU.
        self._attitude_lacks: str | None = None
        self._begin("", None, None)

    def _begin(self, why: str, cause: Outcome | None, prior: Biases | None) -> None:
        """Discard the state and align, with a prior of the IMU's biases."""
        self._resets, self._last_reset = self._reset_counts()
        self._ekf = None
        self._why_again, self._began_again = why, cause if self._filtering else None
        self._start_up = StartUp(self._config, prior)
        self._rest = RestTest(self._config.imu)
        self._passthrough = UnfilteredSolution(self._config, self._position_source)
        self._repeats = DuplicateDetector()
        self._rate = RateLimit(self._config.publish_rate_hz)
        self._log.begin()
        self._health.rtk = FixStatus.NONE, 0
        self._newest: NavSolution | None = None
        self._clocks = AidClocks(self._config, self._imu_clock.newest_ns)
        self._in_imu = [aid(self._config) for aid in AIDS.values() if aid.in_imu]
        self._watched_ns = 0

    def configure(self, config: EkfConfig) -> None:
        """Use new parameters from the next sample on; only live ones may differ from the old ones.

        A running filter keeps its state. If a late measurement makes it compute the last
        ``max_delay_s`` again, the new parameters hold for them. An alignment begins again.
        """
        if config.publish_rate_hz != self._config.publish_rate_hz:
            self._rate = RateLimit(config.publish_rate_hz)
        if config.imu != self._config.imu:
            self._rest = RestTest(config.imu)
        taken_s, self._config = config.imu.delay_s - self._config.imu.delay_s, config
        self._delays = Delays.from_config(config)
        self._imu_clock.configure(config.max_imu_gap_s)
        for part in (self._health, self._clocks, self._passthrough):
            part.configure(config)
        self._in_imu = [aid(config) for aid in AIDS.values() if aid.in_imu]
        if self._ekf is not None:
            self._ekf.configure(config)
            if taken_s:
                self._ekf.take_delay(taken_s)
        else:
            self._start_up = StartUp(config, self._start_up.prior)

    def process(self, sample: NavigationInput) -> Step:
        """Take one sample, valid or not; return its verdict, and a solution if one is due."""
        fault, has_begun = fault_of(sample), self._ekf is not None
        alone = fault is ATTITUDE_ALONE
        if fault and (self._filtering or not alone):
            self._attitude_lacks = fault if alone else self._attitude_lacks
            step = Step(Verdict(sample.source, Outcome.INVALID, fault))
        elif isinstance(sample, ImuSample):
            step = self._process_attitude(sample) if alone else self._process_imu(sample)
            if step.verdict is _IMU_USED:  # nearly always
                self._log.counts[_IMU_KEY] += 1
                return step
        else:
            step = Step(self._process_aiding(sample), self._placed())
        self._count(step.verdict)
        if not has_begun or self._clocks.silence_ns:  # else the next IMU sample shows it
            self._enter(self._state()[0])
        return step

    def status(self) -> NavigationStatus:
        """Return the estimator's state and its diagnostics."""
        state, reason = self._state()
        resets, last_reset = self._reset_counts()
        now_ns, newest = self._clocks.now_ns, self._newest
        aids = self._ekf.aids if self._ekf else None
        refuted = self._health.refuted(aids) if aids else ()
        variance_rad2 = newest.covariance[5, 5] if newest and state.navigating else math.nan
        sigma_rad = math.nan if variance_rad2 < 0 else math.sqrt(variance_rad2)
        nis = self._log.nis(now_ns)
        largest_nis = self._log.largest_nis
        delay_s, delay_sigma_s = math.nan, math.nan
        if self._ekf and largest_nis < _DELAY_NIS:
            delay_s, delay_sigma_s = self._ekf.imu_delay_s()
        status = NavigationStatus(
            self._config.method,
            state,
            reason,
            self._health.rtk_status(now_ns),
            sigma_rad,
            {(a.value, b.value): number for (a, b), number in self._log.counts.items()},
            {source.value: ratio for source, ratio in self._log.test_ratios.items()},
            (now_ns - self._entered[1]) * 1e-9,
            {source.value: number for source, number in resets.items()},
            last_reset,
            dict(self._clipping.counts),
            (*self._clipping.warnings(now_ns), *self._log.warnings(now_ns), *refuted),
            nis,
            self._ekf.process_noise if self._ekf else "",
            densities(self._ekf.vibration) if self._ekf else (),
            self._began_again,
            self._config.imu.delay_s + delay_s,
            delay_sigma_s * math.sqrt(largest_nis),
            aids.gps_sigmas if aids else 0.0,
        )
        if late := status.late_imu(self._config.imu.delay_s):
            return replace(status, warnings=(*status.warnings, _LATE.format(**late)))
        return status

    @property
    def biases(self) -> Biases | None:
        """Return the IMU's biases as the filter has them now; None before it runs."""
        return self._ekf.biases() if self._ekf else None

    def state_and_resets(self) -> tuple[FilterState, int]:
        """Return the state and the number of resets, at a tenth of the cost of ``status``."""
        state, _ = self._state()
        of_this = sum(self._ekf.aids.resets) if self._ekf else 0
        return state, self._resets.total() + of_this

    def _reset_counts(self) -> tuple[Counter[Source], str]:
        """Return the number of resets by source, over all filters so far, and the newest reset."""
        if self._ekf is None:
            return self._resets, self._last_reset
        aids = self._ekf.aids
        counts = Counter(dict(zip(AID_SOURCES, aids.resets, strict=True)))
        last = str(aids.last_reset) if aids.last_reset else self._last_reset
        return self._resets + counts, last  # the sum drops counts of zero

    def _enter(self, state: FilterState) -> None:
        now_ns = self._clocks.now_ns
        if state is not self._entered[0] or now_ns < self._entered[1]:
            self._entered = (state, now_ns)

    def _state(self) -> tuple[FilterState, str]:
        clocks, offsets = self._clocks, self._clocks.offsets
        of_attitude = self._attitude_lacks
        if clocks.imu_ns is not None and clocks.silence_ns and of_attitude is None:
            return FilterState.WAITING, f"no imu/data for {clocks.silence_ns * 1e-9:.1f} s"
        if not self._filtering:
            reason = self._passthrough.reason if of_attitude is None else of_attitude
            return (FilterState.WAITING if reason else FilterState.RUNNING), reason
        if self._ekf is not None:
            aids, newest_ns = self._ekf.aids, self._ekf.newest_ns
            state, reason = self._health.state(aids, newest_ns, self._log.unused)
            return state, f"{reason}; {offsets}" if reason and offsets else reason
        if clocks.imu_ns is None and of_attitude:
            return FilterState.WAITING, of_attitude
        lacks = offsets or self._start_up.aligner.reason
        reason = "; ".join(filter(None, (self._why_again, lacks)))
        if self._began_again is Outcome.RESTART:
            return FilterState.LOST, reason
        begun = clocks.imu_ns is not None and clocks.aid_ns
        return (FilterState.ALIGNING if begun else FilterState.WAITING), reason

    def _process_imu(self, sample: ImuSample) -> Step:
        if self._delays.imu_ns:
            sample = replace(sample, stamp_ns=sample.stamp_ns - self._delays.imu_ns)
        self._clipping.add(sample)  # in the sensor's own axes
        sample = in_body_axes(sample, self._rotation_bi)
        checked = self._imu_clock.check(sample)
        if not checked.use:
            return Step(Verdict(Source.IMU, checked.outcome, checked.reason))
        begins = checked.begins and (self._filtering or checked.outcome is Outcome.TIME_JUMP)
        if begins:
            self._begin(checked.reason, checked.outcome, self.biases)
        self._clocks.take_imu(sample.stamp_ns)
        for accepted in checked.use:
            outcome, reason = self._take_imu(accepted)
        if begins:
            outcome, reason = checked.outcome, checked.reason
        solution = self._due_solution(sample.stamp_ns)
        if outcome is Outcome.USED:
            return tuple.__new__(Step, (_IMU_USED, solution))
        return Step(Verdict(Source.IMU, outcome, reason), solution)

    def _take_imu(self, sample: ImuSample) -> tuple[Outcome, str]:
        """Take a checked sample that continues the time line."""
        rest = self._rest.add(sample) if self._filtering else None
        if self._ekf is not None:
            clipped = self._clipping.newest_ns and self._clipping.active(sample.stamp_ns)
            for verdict in self._ekf.add_imu(sample, clipped=bool(clipped)):
                self._count(verdict)
            if rest is not None:
                self._count(self._ekf.add_aiding(rest))
            if sample.stamp_ns - self._watched_ns >= _WATCH_NS:
                self._watch(self._ekf, sample)
            return Outcome.USED, ""
        if self._filtering:
            self._align(sample)
            return Outcome.WAITING, ""
        self.revision += 1
        self._attitude_lacks = None
        return self._passthrough.add_imu(sample)

    def _process_attitude(self, sample: ImuSample) -> Step:
        """Take an attitude without rates, at any interval: it has a solution of its own."""
        stamp_ns, newest_ns = sample.stamp_ns - self._delays.imu_ns, self._clocks.imu_ns
        if newest_ns is not None and 0 <= newest_ns - stamp_ns < _DISORDER_NS:
            reason = "stamp not later than the previous one"
            return Step(Verdict(Source.IMU, Outcome.OUT_OF_ORDER, reason))
        self._clocks.take_imu(stamp_ns)
        self._passthrough.add_imu(replace(sample, stamp_ns=stamp_ns))
        return Step(_IMU_USED, self._attitude_solution())

    def _placed(self) -> NavSolution | None:
        """Return the solution of an attitude alone whose position arrived only just now."""
        is_late = self._attitude_lacks and self._clocks.imu_ns == self._clocks.aid_ns
        return self._attitude_solution() if is_late and not self._filtering else None

    def _attitude_solution(self) -> NavSolution | None:
        """Return the solution at the newest attitude alone, at whatever rate, or None."""
        self._attitude_lacks = self._passthrough.reason
        solution = self._passthrough.solution()
        self._newest = solution or self._newest
        self.revision += 1
        self._enter(self._state()[0])
        return solution

    def _process_aiding(self, sample: Aiding) -> Verdict:
        source = sample.source
        delay_ns = self._delays.aid_ns.get(source, 0)
        if delay_ns:
            sample = replace(sample, stamp_ns=sample.stamp_ns - delay_ns)
        self._clocks.take_aid(source, sample.stamp_ns)
        if source not in METHOD_SOURCES[self._config.method]:
            return Verdict(source, Outcome.UNUSED)
        if isinstance(sample, PositionSample):
            self._health.take_position(sample)
        same = self._repeats.compared(sample)
        if same is Same.MEASUREMENT:
            return Verdict(source, Outcome.REPEATED, "the same value as the previous sample")
        self._rest.watch(sample)
        if not self._filtering:
            verdict = self._passthrough.add_aiding(sample)
        elif self._ekf is not None:
            verdict = self._ekf.add_aiding(sample, stale=same is Same.VALUE)
        elif refused := self._start_up.refused(sample):
            verdict = refused
        else:
            self._align(sample)
            verdict = Verdict(source, Outcome.WAITING, "not aligned yet")
        self._clocks.judge(verdict, sample.stamp_ns)
        accepted = verdict.outcome in {Outcome.USED, Outcome.WAITING}
        if self.plane is None and accepted and source is self._position_source:
            assert isinstance(sample, PositionSample)
            if sample.status >= self._least_status:
                self.plane = _plane_at(sample)
        return verdict

    def _align(self, sample: NavigationInput) -> None:
        """Give a sample to the alignment; once that succeeds, run the filter."""
        verdicts = self._start_up.add(sample)
        self._ekf = self._start_up.ekf
        if self._ekf is not None and self._start_up.first_state is not None:
            self._why_again, self._began_again = "", None
            self.plane = self.plane or _plane_at(self._start_up.first_state)
            rest = self._rest.known(self._ekf.newest_ns)
            verdicts += [self._ekf.add_aiding(rest)] if rest else []
        for verdict in verdicts:
            self._count(verdict)

    def _watch(self, ekf: Ekf, sample: ImuSample) -> None:
        """Use aids in the IMU's message, check the filter's health, and restart it if lost."""
        self._watched_ns = ekf.newest_ns
        self.revision += 1
        for aid in self._in_imu:
            aiding = aid.of_imu(sample, ekf.estimate().covariance)
            if aiding is not None:
                self._count(ekf.add_aiding(aiding))
        estimate = ekf.estimate()
        covariance, aids = estimate.covariance, estimate.aids
        self._enter(self._health.state(aids, ekf.newest_ns, self._log.unused)[0])
        why = self._health.lost(aids, covariance)
        if why:
            spoiled = self._health.spoiled(aids, covariance)
            self._begin(why, Outcome.RESTART, None if spoiled else ekf.biases())
            self._enter(FilterState.LOST)
            self._count(Verdict(Source.IMU, Outcome.RESTART, why))

    def is_due(self, stamp_ns: int) -> bool:
        """Return whether a solution is due at the stamp (ns) of an IMU sample that comes next."""
        return self._rate.is_due(stamp_ns - self._delays.imu_ns)

    def _due_solution(self, stamp_ns: int) -> NavSolution | None:
        """Return a solution, at most ``publish_rate_hz`` times a second, else None."""
        if not self._rate.due(stamp_ns):
            return None
        source = self._ekf if self._filtering else self._passthrough
        solution = source.solution() if source else None
        self._newest = solution or self._newest
        return solution

    def _count(self, verdict: Verdict) -> None:
        self.revision += 1
        self._log.add(verdict, self._clocks.imu_ns or self._clocks.aid_ns)


def configured_plane(config: EkfConfig) -> TangentPlane | None:
    """Return the plane of ``map`` if its origin is a parameter; ConfigError if not on earth."""
    if not config.origin_lat_lon_h:
        return None
    lat, lon, height_m = config.origin_lat_lon_h
    wrong = "" if abs(height_m) < LARGEST_HEIGHT_M else f"{height_m:g} m is no height"
    if abs(lat) > 90 or abs(lon) > 180:
        wrong = f"{lat:g}, {lon:g} deg is not a latitude and longitude"
    if wrong:
        raise ConfigError(f"parameter origin_lat_lon_h: {wrong} on earth")
    return TangentPlane(math.radians(lat), math.radians(lon), height_m)


def _plane_at(place: NavState | PositionSample) -> TangentPlane:
    return TangentPlane(place.latitude_rad, place.longitude_rad, place.height_m)

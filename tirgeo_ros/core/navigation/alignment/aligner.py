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
"""Find the filter's initial state, at rest or in flight, from the measurements available.

A window of some seconds is fitted as a whole (``batch_least_squares``). Tilt comes from the
accelerometers corrected by the change of velocity, heading from two antennas or from the
autopilot. While the measurements contradict each other the alignment waits; after a long
contradiction it tries the next best sources.
"""

from __future__ import annotations

import bisect
import math
import operator
from collections import defaultdict, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import quat_from_matrix
from tirgeo_ros.core.navigation.alignment.batch_least_squares import Biases
from tirgeo_ros.core.navigation.alignment.turn_on_bias import TurnOnBiases
from tirgeo_ros.core.navigation.alignment.window_estimate import (
    CONTRADICTION,
    HEADING_STAGES,
    MOTION_STAGE,
    FittedWindow,
    Measured,
    NotAlignedError,
    Recurrence,
    differences,
    furthest,
)
from tirgeo_ros.core.navigation.ins.propagation import Powers
from tirgeo_ros.core.navigation.ins.strapdown import NavState
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
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

_LEAST_INSTANTS = 3  # two always fit, and would hide a wrong one
_LEAST_POSITIONS = 2
_LEAST_HEADINGS = 3
#: Bound on the measurements kept per second: five sources at 100 Hz.
_MOST_HZ = 500
_MOST_IMU_HZ = 1000
_SET = SetHeading, Source.SET_HEADING
#: Longer windows to try if ``alignment.duration_s`` is shorter and gives no result.
_LONGER_S = (2.5, 6.0)
_LARGEST_AGE_NS = 2_000_000_000  # largest age of the window's end
_RETRY_NS = 500_000_000  # pause between two costly trials
#: Pause between trials while only motion is missing: share of the time so far, and its limit.
_WAIT_SHARE, _LONGEST_RETRY_NS = 0.1, 2_000_000_000
#: Pairs of velocity and position source, best first. Errors of ordinary GPS positions change
#: slowly, so their differences give a velocity, though only over the longest window.
_SOURCES = (
    (Source.RTK_VELOCITY, Source.RTK_POSITION),
    (None, Source.RTK_POSITION),
    (Source.GPS_VELOCITY, Source.RTK_POSITION),
    (Source.RTK_VELOCITY, Source.GPS_POSITION),
    (Source.GPS_VELOCITY, Source.GPS_POSITION),
    (None, Source.GPS_POSITION),
)
_T = TypeVar("_T", bound=NavigationInput)


class AlignmentSamples:
    """Hold the samples of the last ``keep_s``; an IMU that repeats one reading is ``frozen``."""

    def __init__(self, keep_s: float, largest_gap_s: float) -> None:
        self._keep_ns = round(keep_s * 1e9)
        self._gap_ns = round(largest_gap_s * 1e9)
        self._imu: deque[ImuSample] = deque(maxlen=math.ceil(keep_s * _MOST_IMU_HZ))
        self._aiding: deque[NavigationInput] = deque(maxlen=math.ceil(keep_s * _MOST_HZ))
        self._first_ns = 0
        self._changed_ns = 0  # stamp of the last reading that differed from the one before
        self.frozen = False

    @property
    def ready(self) -> bool:
        """Return whether there are two IMU samples, so at least one interval."""
        return len(self._imu) > 1

    @property
    def newest_ns(self) -> int:
        """Return the stamp of the newest IMU sample."""
        return self._imu[-1].stamp_ns

    @property
    def imu_s(self) -> float:
        """Return the time since the very first IMU sample, s."""
        return (self.newest_ns - self._first_ns) * 1e-9 if self._imu else 0.0

    def add(self, sample: NavigationInput) -> None:
        """Take one sample."""
        if isinstance(sample, ImuSample):
            self._add_imu(sample)
        else:
            self._aiding.append(sample)
        newest = self._imu[-1].stamp_ns if self._imu else sample.stamp_ns
        for queue in (self._imu, self._aiding):
            while queue and queue[0].stamp_ns < newest - self._keep_ns:
                queue.popleft()

    def _add_imu(self, sample: ImuSample) -> None:
        before = self._imu[-1] if self._imu else None
        if before is None:
            self._first_ns = self._changed_ns = sample.stamp_ns
        elif (
            before.specific_force_b.tolist() != sample.specific_force_b.tolist()
            or before.angular_rate_b.tolist() != sample.angular_rate_b.tolist()
        ):
            self._changed_ns = sample.stamp_ns
        # Readings that have never changed come from a test bench without noise. Those of a live
        # sensor have changed at least once.
        was_alive = self._changed_ns > self._first_ns
        self.frozen = was_alive and sample.stamp_ns - self._changed_ns > self._gap_ns
        if self.frozen or (before and sample.stamp_ns - before.stamp_ns > self._gap_ns):
            self._imu.clear()
        self._imu.append(sample)

    def positions(self, source: Source) -> list[PositionSample]:
        """Return a source's positions with a good fix, by stamp; none if the newest one is bad."""
        least = FixStatus.FLOAT if source is Source.RTK_POSITION else FixStatus.SINGLE
        positions = self.reached(PositionSample, source)
        if not positions or positions[-1].status < least:
            return []
        return [s for s in positions if s.status >= least]

    def rtk_status(self, stamp_ns: int) -> FixStatus | None:
        """Return the fix status of the newest RTK position up to a stamp."""
        positions = self.reached(PositionSample, Source.RTK_POSITION)
        before = [s.status for s in positions if s.stamp_ns <= stamp_ns]
        return before[-1] if before else None

    def headings(self, first_ns: int, last_ns: int, settled_s: float) -> list[HeadingSample]:
        """Return the headings between two stamps, by stamp, with RTK fixed for ``settled_s``."""
        fixes = self.reached(PositionSample, Source.RTK_POSITION)

        def fixed_around(stamp_ns: int) -> bool:
            begin_ns = stamp_ns - round(settled_s * 1e9)
            before = [s for s in fixes if begin_ns <= s.stamp_ns < stamp_ns]
            # A fix of the same instant may come later: the first one from then on decides, too.
            after = [s for s in fixes if s.stamp_ns >= stamp_ns][:1]
            return bool(after) and all(s.status is FixStatus.FIXED for s in (*before, *after))

        headings = self.reached(HeadingSample, Source.RTK_HEADING)
        inside = [s for s in headings if first_ns <= s.stamp_ns <= last_ns]
        return [s for s in inside if fixed_around(s.stamp_ns)]

    def imu_over(self, first_ns: int, last_ns: int) -> list[ImuSample]:
        """Return the IMU samples of an interval, with one before and one after if available."""
        imu, stamp_of = list(self._imu), operator.attrgetter("stamp_ns")
        begin = max(bisect.bisect_right(imu, first_ns, key=stamp_of) - 1, 0)
        return imu[begin : bisect.bisect_left(imu, last_ns, key=stamp_of) + 1]

    def rest(self, stamp_ns: int) -> tuple[tuple[ImuSample, ...], tuple[NavigationInput, ...]]:
        """Return the newest IMU sample up to a stamp, all later ones, and later measurements."""
        before = [s for s in self._imu if s.stamp_ns <= stamp_ns][-1:]
        after = [s for s in self._imu if s.stamp_ns > stamp_ns]
        return (*before, *after), tuple(s for s in self._aiding if s.stamp_ns > stamp_ns)

    def reached(self, kind: type[_T], source: Source) -> list[_T]:
        """Return the measurements of a source within the IMU record, by stamp."""
        oldest, newest = self._imu[0].stamp_ns, self._imu[-1].stamp_ns
        measured = [s for s in self._aiding if isinstance(s, kind) and s.source is source]
        single = {s.stamp_ns: s for s in measured if oldest <= s.stamp_ns <= newest}
        return [single[stamp_ns] for stamp_ns in sorted(single)]


def span(
    samples: Sequence[PositionSample | VelocitySample], length_ns: int
) -> tuple[int, int] | None:
    """Return first and last stamp of at least three samples that span ``length_ns``, or None."""
    stamps = [s.stamp_ns for s in samples]
    if not stamps:
        return None
    first = max((t for t in stamps if t <= stamps[-1] - length_ns), default=None)
    enough = first is not None and sum(t >= first for t in stamps) >= _LEAST_INSTANTS
    return (first, stamps[-1]) if first is not None and enough else None


@dataclass(frozen=True, slots=True)
class Alignment:
    """Hold the state to start the filter from: the IMU's at ``stamp_ns``."""

    stamp_ns: int
    state: NavState
    covariance: Array  # (15, 15)
    imu: tuple[ImuSample, ...]  # the newest sample up to the stamp and all after it
    later: tuple[NavigationInput, ...]  # measurements after the stamp
    sources: frozenset[Source]  # of the measurements used
    rtk_status: FixStatus | None  # of the newest RTK position up to the stamp
    vibration: Powers  # noise densities of the IMU in the window
    vibration_s: float  # length of the window


class _Plan(NamedTuple):
    """Hold a choice of sources. Without a velocity source the positions give the velocity."""

    velocity: Source | None
    position: Source
    heading: Source  # of two antennas, set by a person, or the autopilot's


class Aligner:
    """Collect samples until they give a state; ``reason`` says what is missing.

    Samples must arrive in the order of their stamps (``start_up``); those older than
    ``keep_s`` are dropped. ``prior`` holds the IMU's biases as an earlier run of the filter
    estimated them.
    """

    def __init__(
        self, config: EkfConfig, *, use_heading: bool, prior: Biases | None = None
    ) -> None:
        self._config = config
        self._use_heading = use_heading
        self._turn_on = TurnOnBiases(config, prior)
        duration_s = config.alignment.duration_s
        self._lengths_s = (duration_s, *(x for x in _LONGER_S if x > duration_s))
        self.keep_s = self._lengths_s[-1] + config.max_delay_s + 1.0
        self._samples = AlignmentSamples(self.keep_s, config.max_imu_gap_s)
        self._next_ns = 0
        self._lasting: tuple[int, NotAlignedError | None] = (0, None)  # the newest lasting doubt
        self._doubts: defaultdict[str, Recurrence] = defaultdict(Recurrence)
        antennas = "rtk/heading or " if use_heading else ""
        self._needs_heading = (
            f"needs {antennas}an orientation in imu/data that follows the gyroscopes, or "
            "~/set_heading: velocity gives no heading while hovering"
        )
        self.reason = "needs imu/data"
        #: Whether only a heading is missing, so that ``~/set_heading`` would help.
        self.lacks_heading = False

    def add(self, sample: NavigationInput) -> Alignment | None:
        """Take one valid sample; return the alignment once it is possible."""
        samples = self._samples
        samples.add(sample)
        if samples.frozen:
            self.reason = "imu/data is frozen: it repeats the same reading"
        elif not samples.ready:
            self.reason = "needs imu/data"
        elif not isinstance(sample, ImuSample):
            return self._try() if samples.newest_ns >= self._next_ns else None
        elif self.reason == "needs imu/data":
            self.reason = self._needs_velocity(_SOURCES[0][0])
        return None

    @property
    def _waited(self) -> bool:
        return self._samples.imu_s >= self._config.alignment.wait_s

    def _try(self) -> Alignment | None:
        """Try the best sources; once ``wait_s`` has passed, try all of them, best first."""
        lacks: list[NotAlignedError] = []
        self.lacks_heading = contradicted = False
        now_ns = self._samples.newest_ns
        retry_ns = now_ns + _RETRY_NS
        if self._waited:
            self._next_ns = retry_ns
        for plan in self._plans():
            outcome = self._outcome(plan)
            if isinstance(outcome, Alignment):
                return outcome
            if outcome.stage < CONTRADICTION:
                lacks.append(outcome)
            if outcome.stage < MOTION_STAGE:
                continue
            self._next_ns = retry_ns
            if outcome.stage == MOTION_STAGE:
                longer_ns = round(_WAIT_SHARE * self._samples.imu_s * 1e9)
                self._next_ns = max(retry_ns, now_ns + min(longer_ns, _LONGEST_RETRY_NS))
                break  # no other sources are better
            contradicted = True
            # In a turn wrong headings contradict the motion too: report the doubt on the antennas.
            doubt = outcome if outcome.lasting else self._lately_doubted()
            self.reason = str(doubt or outcome)
            if doubt:
                self._lasting = now_ns, doubt
            if doubt or self._still_doubted("samples"):
                return None
        if lacks:
            lack = furthest(lacks)
            self.lacks_heading = lack.stage in HEADING_STAGES
            # Report a contradiction of better sources, not what worse sources lack.
            self.reason = self.reason if contradicted and lack.stage < MOTION_STAGE else str(lack)
        return None

    def _plans(self) -> list[_Plan]:
        kinds = [Source.RTK_HEADING] if self._use_heading else []
        kinds += [Source.SET_HEADING] if self._samples.reached(*_SET) else []
        plans = [_Plan(v, p, h) for v, p in _SOURCES for h in (*kinds, Source.AUTOPILOT_HEADING)]
        if not self._waited:
            return plans[: max(len(kinds), 1)]
        # While the antennas are in doubt, the autopilot's heading does not replace theirs.
        antennas = [plan for plan in plans if plan.heading is Source.RTK_HEADING]
        return antennas if self._lately_doubted() else plans

    def _lately_doubted(self) -> NotAlignedError | None:
        """Return the newest lasting doubt (antennas against autopilot) up to ``wait_s`` old."""
        stamp_ns, doubt = self._lasting
        passed_ns = self._samples.newest_ns - stamp_ns
        return doubt if passed_ns < self._config.alignment.wait_s * 1e9 else None

    def _outcome(self, plan: _Plan) -> Alignment | NotAlignedError:
        """Return the result of the shortest window that gives one, or why none does."""
        widened = self._turn_on.widened
        final_stage = MOTION_STAGE if widened else CONTRADICTION
        errors: list[NotAlignedError] = []
        # With a widened prior the longest window comes first: a shorter one shows less motion.
        for length_s in sorted(self._lengths_s, reverse=widened):
            try:
                return self._align(plan, length_s)
            except NotAlignedError as error:  # noqa: PERF203 a few windows
                errors.append(error)
                if error.stage == final_stage:
                    return error
        return furthest(errors)

    def _still_doubted(self, what: str) -> bool:
        """Record a doubt; return False once it has recurred for ``wait_s``."""
        lasted_s = self._doubts[what].again_s(self._samples.newest_ns)
        return lasted_s < self._config.alignment.wait_s

    def _align(self, plan: _Plan, length_s: float) -> Alignment:
        """Return the alignment of one window; raises NotAlignedError."""
        positions, velocities = self._motion(plan, length_s)
        stamps = [s.stamp_ns for track in (positions, velocities) for s in track]
        first, last = min(stamps), max(stamps)
        imu = self._samples.imu_over(first, last)
        readings = self._headings(plan, first, last, imu)
        measured = Measured(imu, positions, velocities, readings, self._needs_heading)
        fitted = self._turn_on.fit(measured, self._samples.newest_ns)
        doubted = self._lately_doubted()
        if fitted.hint_nb is not None:
            # A small difference is accepted once it has lasted: the autopilot may err.
            autopilot = self._config.autopilot
            for what, doubt in differences(fitted.fit, fitted.hint_nb, autopilot).items():
                if what == "heading" and plan.heading is Source.SET_HEADING:
                    continue  # a person sets a heading because the autopilot's is wrong
                if doubt.lasting or self._still_doubted(what):
                    raise doubt
        elif plan.heading is Source.RTK_HEADING and doubted is not None:
            raise doubted  # nothing has removed the doubt since
        sources = {positions[-1].source, *(s.source for s in velocities)}
        if plan.heading is not Source.AUTOPILOT_HEADING:
            sources.add(plan.heading)
        return self._start(measured, fitted, frozenset(sources))

    def _headings(
        self, plan: _Plan, first: int, last: int, imu: Sequence[ImuSample]
    ) -> Sequence[HeadingSample | SetHeading]:
        """Return headings between two stamps, none of the autopilot; raises NotAlignedError."""
        if plan.heading is Source.RTK_HEADING:
            settled_s = self._config.heading.start_after_s
            readings = self._samples.headings(first, last, settled_s)
            if len(readings) < _LEAST_HEADINGS:
                raise NotAlignedError("needs rtk/heading with rtk/fix fixed", 2)
            return readings
        headings = self._samples.reached(*_SET) if plan.heading is Source.SET_HEADING else []
        headings = [s for s in headings if first <= s.stamp_ns <= last][-1:]
        by_autopilot = plan.heading is Source.AUTOPILOT_HEADING
        has_attitude = any(usable_attitude(s.autopilot_q_nb) for s in imu)
        if not (headings or (by_autopilot and has_attitude)):
            raise NotAlignedError(self._needs_heading, 3)
        return headings

    def _motion(
        self, plan: _Plan, length_s: float
    ) -> tuple[list[PositionSample], list[VelocitySample]]:
        """Return positions and velocities of the window; raises NotAlignedError."""
        positions = self._samples.positions(plan.position)
        velocities = self._samples.reached(VelocitySample, plan.velocity) if plan.velocity else []
        reach = span(velocities if plan.velocity else positions, round(length_s * 1e9))
        if reach is None or reach[1] < self._samples.newest_ns - _LARGEST_AGE_NS:
            raise NotAlignedError(self._needs_velocity(plan.velocity), 0)
        first, last = reach
        positions = [s for s in positions if first <= s.stamp_ns <= last]
        if len(positions) < _LEAST_POSITIONS:
            other = " or gps/fix" if self._waited else ""
            raise NotAlignedError(f"needs rtk/fix{other}", 1)
        return positions, [s for s in velocities if first <= s.stamp_ns <= last]

    def _needs_velocity(self, source: Source | None) -> str:
        topic = source.topic if source else "rtk/fix or gps/fix"
        return f"needs {topic} over {self._config.alignment.duration_s:g} s"

    def _start(
        self, measured: Measured, fitted: FittedWindow, sources: frozenset[Source]
    ) -> Alignment:
        fit, stamp_ns = fitted.fit, measured.last_ns
        lat, lon, height_m = map(float, measured.plane.geodetic_from_ned(fit.position_n))
        q_nb = tuple(quat_from_matrix(fit.rotation_nb).tolist())
        velocity_n, (gyro_b, accel_b) = fit.velocity_n.tolist(), fit.biases.reshape(2, 3)
        biases_b = tuple(gyro_b.tolist()), tuple(accel_b.tolist())
        state = NavState(q_nb, tuple(velocity_n), lat, lon, height_m, *biases_b)
        imu, later = self._samples.rest(stamp_ns)
        used = sources, self._samples.rtk_status(stamp_ns)
        vibration = fitted.vibration, float(fitted.window.before_s[0])
        return Alignment(stamp_ns, state, fit.covariance, imu, later, *used, *vibration)

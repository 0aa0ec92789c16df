"""Find the filter's initial state, at rest or in flight, from the measurements that are there.

A window of some seconds is fitted as a whole (``batch_least_squares``). Tilt comes from the
accelerometers corrected by the change of velocity, heading from two antennas or from the
autopilot. While the measurements contradict each other the alignment waits; after a long
contradiction it tries the next best ones.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import quat_from_matrix
from tirgeo_ros.core.navigation.alignment.consistency_checks import (
    CONTRADICTION,
    HEADING_STAGES,
    MOTION_STAGE,
    NotAlignedError,
    Recurrence,
    differences,
    furthest,
)
from tirgeo_ros.core.navigation.alignment.imu_preintegration import Biases
from tirgeo_ros.core.navigation.alignment.sample_buffer import AlignmentSamples, span
from tirgeo_ros.core.navigation.alignment.window_estimate import Fitted, Measured
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.navigation.turn_on_bias import TurnOnBiases
from tirgeo_ros.core.navigation.vibration_noise import STILL, Powers
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

__all__ = ["Aligner", "Alignment", "Biases"]

#: Longer windows to try, where ``alignment.duration_s`` is shorter and gives no result.
_LONGER_S = (2.5, 6.0)
_LEAST_POSITIONS = 2
_LEAST_HEADINGS = 3
_LARGEST_AGE_NS = 2_000_000_000  # of the window's end
_RETRY_NS = 500_000_000  # between two costly trials
#: While only motion is missing: this share of the time so far, within the pause before and this.
_WAIT_SHARE, _LONGEST_RETRY_NS = 0.1, 2_000_000_000


@dataclass(frozen=True, slots=True)
class Alignment:
    """Hold a state to start the filter from: that of the IMU at ``stamp_ns``."""

    stamp_ns: int
    state: NavState
    covariance: Array  # (15, 15)
    imu: tuple[ImuSample, ...]  # the newest sample up to the stamp and all after it
    later: tuple[NavigationInput, ...]  # measurements after the stamp
    sources: frozenset[Source]  # of the measurements used
    rtk_status: FixStatus | None  # of the newest RTK position up to the stamp
    vibration: Powers = STILL  # noise densities of the IMU in the window
    vibration_s: float = 0.0  # length of the window


class _Plan(NamedTuple):
    """Hold a choice of sources. Without a velocity source the positions give the velocity."""

    velocity: Source | None
    position: Source
    heading: Source  # of two antennas, set by a person, or the autopilot's

    @property
    def antennas(self) -> bool:
        """Return whether the heading is that of rtk/heading."""
        return self.heading is Source.RTK_HEADING


#: Best first. Errors of ordinary GPS positions change slowly, so their differences give a
#: velocity, though only over the longest window.
_SOURCES = (
    (Source.RTK_VELOCITY, Source.RTK_POSITION),
    (None, Source.RTK_POSITION),
    (Source.GPS_VELOCITY, Source.RTK_POSITION),
    (Source.RTK_VELOCITY, Source.GPS_POSITION),
    (Source.GPS_VELOCITY, Source.GPS_POSITION),
    (None, Source.GPS_POSITION),
)


class Aligner:
    """Collect samples until a state can be found; ``reason`` says what is missing.

    Samples must arrive in the order of their stamps (``start_up``); those older than
    ``keep_s`` are dropped. ``prior`` is what an earlier run of the filter knew of the IMU's
    biases.
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
        self.reason = "needs imu/data"
        #: Whether nothing but a heading is missing: one that is set would do.
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
            # In a turn wrong headings contradict the motion too; report the antennas.
            doubt = outcome if outcome.lasting else self._lately_doubted()
            self.reason = str(doubt or outcome)
            if doubt:
                self._lasting = now_ns, doubt
            if doubt or self._still_doubted("samples"):
                return None
        if lacks:
            lack = furthest(lacks)
            self.lacks_heading = lack.stage in HEADING_STAGES
            # What better sources contradict is to mend, not what lesser ones lack.
            self.reason = self.reason if contradicted and lack.stage < MOTION_STAGE else str(lack)
        return None

    def _plans(self) -> list[_Plan]:
        kinds = [Source.RTK_HEADING] if self._use_heading else []
        kinds += [Source.SET_HEADING] if self._samples.set_headings() else []
        plans = [_Plan(v, p, h) for v, p in _SOURCES for h in (*kinds, Source.AUTOPILOT_HEADING)]
        if not self._waited:
            return plans[: max(len(kinds), 1)]
        # While antennas are in doubt, they are not replaced by the autopilot's heading.
        return [plan for plan in plans if plan.antennas] if self._lately_doubted() else plans

    def _lately_doubted(self) -> NotAlignedError | None:
        """Return a lasting doubt (antennas against autopilot) for ``wait_s``, then None."""
        stamp_ns, doubt = self._lasting
        passed_ns = self._samples.newest_ns - stamp_ns
        return doubt if passed_ns < self._config.alignment.wait_s * 1e9 else None

    def _outcome(self, plan: _Plan) -> Alignment | NotAlignedError:
        """Return the result of one of the windows, or why none gives one.

        It is the shortest window that has all it needs. Where the biases are far beyond their
        prior it is the longest that fits: a shorter one shows less motion.
        """
        widened = self._turn_on.widened
        last_word = MOTION_STAGE if widened else CONTRADICTION
        errors: list[NotAlignedError] = []
        for length_s in sorted(self._lengths_s, reverse=widened):
            try:
                return self._align(plan, length_s)
            except NotAlignedError as error:  # noqa: PERF203 a few windows
                errors.append(error)
                if error.stage == last_word:
                    return error
        return furthest(errors)

    def _still_doubted(self, what: str) -> bool:
        """Note a doubt; return False once it has recurred for ``wait_s``."""
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
        found = self._turn_on.fitted(measured, self._samples.newest_ns)
        doubted = self._lately_doubted()
        if found.hint_nb is not None:
            # A small difference is accepted once it has lasted: the autopilot may err.
            autopilot = self._config.autopilot
            for what, doubt in differences(found.fit, found.hint_nb, autopilot).items():
                if what == "heading" and plan.heading is Source.SET_HEADING:
                    continue  # a person says it because the autopilot is wrong
                if doubt.lasting or self._still_doubted(what):
                    raise doubt
        elif plan.antennas and doubted is not None:
            raise doubted  # nothing has contradicted the doubt since
        sources = {positions[-1].source, *(s.source for s in velocities)}
        if plan.heading is not Source.AUTOPILOT_HEADING:
            sources.add(plan.heading)
        return self._start(measured, found, frozenset(sources))

    def _headings(
        self, plan: _Plan, first: int, last: int, imu: Sequence[ImuSample]
    ) -> Sequence[HeadingSample | SetHeading]:
        """Return the headings between two stamps, none for the autopilot's.

        Raises NotAlignedError where those of the plan are missing.
        """
        if plan.antennas:
            settled_s = self._config.heading.start_after_s
            readings = self._samples.headings(first, last, settled_s)
            if len(readings) < _LEAST_HEADINGS:
                raise NotAlignedError("needs rtk/heading with rtk/fix fixed", 2)
            return readings
        told = self._samples.set_headings() if plan.heading is Source.SET_HEADING else []
        told = [s for s in told if first <= s.stamp_ns <= last][-1:]
        by_autopilot = plan.heading is Source.AUTOPILOT_HEADING
        if not told and not (by_autopilot and any(usable_attitude(s.autopilot_q_nb) for s in imu)):
            raise NotAlignedError(self._needs_heading, 3)
        return told

    def _motion(
        self, plan: _Plan, length_s: float
    ) -> tuple[list[PositionSample], list[VelocitySample]]:
        """Return positions and velocities of the window; raises NotAlignedError."""
        positions = self._samples.positions(plan.position)
        velocities = self._samples.velocities(plan.velocity) if plan.velocity else []
        found = span(velocities if plan.velocity else positions, round(length_s * 1e9))
        if found is None or found[1] < self._samples.newest_ns - _LARGEST_AGE_NS:
            raise NotAlignedError(self._needs_velocity(plan.velocity), 0)
        first, last = found
        positions = [s for s in positions if first <= s.stamp_ns <= last]
        if len(positions) < _LEAST_POSITIONS:
            other = " or gps/fix" if self._waited else ""
            raise NotAlignedError(f"needs rtk/fix{other}", 1)
        return positions, [s for s in velocities if first <= s.stamp_ns <= last]

    def _needs_velocity(self, source: Source | None) -> str:
        topic = source.topic if source else "rtk/fix or gps/fix"
        return f"needs {topic} over {self._config.alignment.duration_s:g} s"

    @property
    def _needs_heading(self) -> str:
        antennas = "rtk/heading or " if self._use_heading else ""
        return (
            f"needs {antennas}an orientation in imu/data that follows the gyroscopes, or "
            "~/set_heading: velocity tells no heading while hovering"
        )

    def _start(self, measured: Measured, fitted: Fitted, sources: frozenset[Source]) -> Alignment:
        found, stamp_ns = fitted.fit, measured.last_ns
        lat, lon, height_m = map(float, measured.plane.geodetic_from_ned(found.position_n))
        q_nb = tuple(quat_from_matrix(found.rotation_nb).tolist())
        velocity_n, (gyro_b, accel_b) = found.velocity_n.tolist(), found.biases.reshape(2, 3)
        biases_b = tuple(gyro_b.tolist()), tuple(accel_b.tolist())
        nothing = (0.0, 0.0, 0.0)
        state = NavState(q_nb, tuple(velocity_n), lat, lon, height_m, *biases_b, nothing)
        return Alignment(
            stamp_ns,
            state,
            found.covariance,
            *self._samples.rest(stamp_ns),
            sources,
            self._samples.rtk_status(stamp_ns),
            fitted.vibration,
            float(fitted.window.before_s[0]),
        )

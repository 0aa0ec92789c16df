"""Find the filter's initial state, at rest or in flight, from the measurements that are there.

A window of some seconds is fitted as a whole (``batch_least_squares``). Tilt comes from the
accelerometers corrected by the change of velocity, heading from two antennas or from the
autopilot. The alignment waits while the measurements contradict each other. Only after a long
contradiction does it try the next best measurements.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import quat_from_matrix
from tirgeo_ros.core.navigation.alignment.batch_least_squares import WindowFit
from tirgeo_ros.core.navigation.alignment.consistency_checks import (
    InconsistentError,
    InsufficientError,
    checked,
    differences,
    furthest,
)
from tirgeo_ros.core.navigation.alignment.imu_preintegration import Biases
from tirgeo_ros.core.navigation.alignment.sample_buffer import AlignmentSamples, span
from tirgeo_ros.core.navigation.alignment.window_estimate import Fitted, Measured
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.navigation.turn_on_bias import MOTION_STAGE, TurnOnBiases
from tirgeo_ros.core.navigation.vibration_noise import STILL, Powers
from tirgeo_ros.core.streams.sanity_checks import usable_attitude
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
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
_DOUBT_ENDS_NS = 1_000_000_000
#: Biases are accepted after this time; one wrong measurement leaves the second window sooner.
_SURE_S = 2.6
_SHORTER_S = 0.1


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
    antennas: bool  # the heading is that of rtk/heading, else the autopilot's


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

    Samples must arrive in the order of their stamps (``measurement_order``); those older than
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
        self._suspected_ns: int | None = None
        self._lasting: tuple[int, InconsistentError | None] = (0, None)  # the newest lasting doubt
        self._doubts: dict[str, tuple[int, int]] = {}  # first and latest stamp of each
        self.reason = "needs imu/data"

    def add(self, sample: NavigationInput) -> Alignment | None:
        """Take one valid sample; return the alignment once it is possible."""
        self._samples.add(sample)
        if isinstance(sample, ImuSample):
            if self._samples.frozen:
                self.reason = "imu/data is frozen: the same reading again and again"
            elif self.reason == "needs imu/data":
                self.reason = self._needs_velocity(_SOURCES[0][0])
            return None
        if not self._samples.ready:
            if not self._samples.frozen:
                self.reason = "needs imu/data"
            return None
        return self._try() if self._samples.newest_ns >= self._next_ns else None

    @property
    def _waited(self) -> bool:
        return self._samples.imu_s >= self._config.alignment.wait_s

    def _try(self) -> Alignment | None:
        """Try the best sources; once ``wait_s`` has passed, try all of them, best first."""
        lacks: list[InsufficientError] = []
        if self._waited:
            self._next_ns = self._samples.newest_ns + _RETRY_NS
        for plan in self._plans():
            outcome = self._outcome(plan)
            if isinstance(outcome, Alignment):
                return outcome
            doubt = self._lately_doubted()
            if (
                doubt is not None
                and not isinstance(outcome, InsufficientError)
                and not outcome.lasting
            ):
                # In a turn wrong headings contradict the motion too; report the antennas.
                outcome = doubt
            if isinstance(outcome, InsufficientError):
                lacks.append(outcome)
                if outcome.stage < MOTION_STAGE:
                    continue
                self._next_ns = self._samples.newest_ns + _RETRY_NS
                break  # no other sources are better
            self.reason = str(outcome)
            self._next_ns = self._samples.newest_ns + _RETRY_NS
            if outcome.lasting:
                self._lasting = self._samples.newest_ns, outcome
            if outcome.lasting or self._still_doubted("samples"):
                return None
        if lacks:
            self.reason = str(furthest(lacks))
        return None

    def _plans(self) -> list[_Plan]:
        kinds = (True, False) if self._use_heading else (False,)
        plans = [_Plan(v, p, antennas) for v, p in _SOURCES for antennas in kinds]
        if not self._waited:
            return plans[:1]
        # While antennas are in doubt, they are not replaced by the autopilot's heading.
        return [plan for plan in plans if plan.antennas] if self._lately_doubted() else plans

    def _lately_doubted(self) -> InconsistentError | None:
        """Return a lasting doubt (antennas against autopilot) for ``wait_s``, then None."""
        stamp_ns, doubt = self._lasting
        passed_ns = self._samples.newest_ns - stamp_ns
        return doubt if passed_ns < self._config.alignment.wait_s * 1e9 else None

    def _outcome(self, plan: _Plan) -> Alignment | InsufficientError | InconsistentError:
        """Return the result of the shortest window that has all it needs, or why none has."""
        if self._turn_on.widened:
            return self._longest_outcome(plan)
        lacks: list[InsufficientError] = []
        for length_s in self._lengths_s:
            outcome = self._outcome_over(plan, length_s)
            if not isinstance(outcome, InsufficientError):
                return outcome
            lacks.append(outcome)
        return furthest(lacks)

    def _longest_outcome(self, plan: _Plan) -> Alignment | InsufficientError | InconsistentError:
        """Return the result of the longest window that is complete and fits, or why none does."""
        lacks: list[InsufficientError] = []
        doubts: list[InconsistentError] = []
        for length_s in reversed(self._lengths_s):
            outcome = self._outcome_over(plan, length_s)
            if isinstance(outcome, Alignment):
                return outcome
            if isinstance(outcome, InconsistentError):
                doubts.append(outcome)
                continue
            lacks.append(outcome)
            if outcome.stage >= MOTION_STAGE:
                return outcome  # a shorter window shows less motion
        return doubts[0] if doubts else furthest(lacks)

    def _outcome_over(
        self, plan: _Plan, length_s: float
    ) -> Alignment | InsufficientError | InconsistentError:
        try:
            return self._align(plan, length_s)
        except (InsufficientError, InconsistentError) as error:
            return error

    def _still_doubted(self, what: str) -> bool:
        """Note a doubt; return False once it has recurred for ``wait_s``."""
        return self._doubted_s(what) < self._config.alignment.wait_s

    def _doubted_s(self, what: str) -> float:
        """Note a doubt; return for how long (s) it has recurred."""
        now = self._samples.newest_ns
        since, latest = self._doubts.get(what, (now, now))
        if now - latest > _DOUBT_ENDS_NS:
            since = now
        self._doubts[what] = (since, now)
        return (now - since) * 1e-9

    def _align(self, plan: _Plan, length_s: float) -> Alignment:
        """Return the alignment of one window; raises LackingError or DoubtError."""
        positions, velocities = self._motion(plan, length_s)
        stamps = [s.stamp_ns for s in positions] + [s.stamp_ns for s in velocities]
        first, last = min(stamps), max(stamps)
        imu = self._samples.imu_over(first, last)
        readings = self._antenna_headings(first, last) if plan.antennas else []
        if not plan.antennas and not any(usable_attitude(s.autopilot_q_nb) for s in imu):
            raise InsufficientError(self._needs_heading, 3)
        measured = Measured(imu, positions, velocities, readings, self._needs_heading)
        found = self._fitted(measured)
        doubted = self._lately_doubted()
        if found.hint_nb is not None:
            self._compare(found.fit, found.hint_nb)
        elif plan.antennas and doubted is not None:
            raise doubted  # nothing has contradicted the doubt since
        sources = {positions[-1].source, *(s.source for s in velocities)}
        if plan.antennas:
            sources.add(Source.RTK_HEADING)
        return self._start(measured, found, frozenset(sources))

    def _fitted(self, measured: Measured) -> Fitted:
        """Return the fit of a window, with the prior of the biases or, if need be, a wider one."""
        known = self._turn_on
        found = known.fitted(measured)
        if known.widened:
            return found
        if self._turned(found) or not known.contradicted(found):
            checked(found.fit, found.seen)
            self._look_longer(known, found)
            return found
        loose = known.loosely(measured)
        if loose is None:  # biases are not the cause, or not the only one
            checked(found.fit, found.seen)
            raise InconsistentError("imu/data does not fit the motion measured")
        if self._doubted_s("biases") < _SURE_S:  # a wrong measurement may look like biases
            checked(found.fit, found.seen)
            self._suspected_ns = self._samples.newest_ns
            raise InconsistentError(known.told(found, loose))
        known.widen(found, loose)
        return known.fitted(measured)

    def _motion(
        self, plan: _Plan, length_s: float
    ) -> tuple[list[PositionSample], list[VelocitySample]]:
        """Return positions and velocities of the window; raises LackingError."""
        positions = self._samples.positions(plan.position)
        velocities = self._samples.velocities(plan.velocity) if plan.velocity else []
        found = span(velocities if plan.velocity else positions, round(length_s * 1e9))
        if found is None or found[1] < self._samples.newest_ns - _LARGEST_AGE_NS:
            raise InsufficientError(self._needs_velocity(plan.velocity), 0)
        first, last = found
        positions = [s for s in positions if first <= s.stamp_ns <= last]
        if len(positions) < _LEAST_POSITIONS:
            other = " or gps/fix" if self._waited else ""
            raise InsufficientError(f"needs rtk/fix{other}", 1)
        return positions, [s for s in velocities if first <= s.stamp_ns <= last]

    def _needs_velocity(self, source: Source | None) -> str:
        topic = source.topic if source else "rtk/fix or gps/fix"
        return f"needs {topic} over {self._config.alignment.duration_s:g} s"

    def _antenna_headings(self, first_ns: int, last_ns: int) -> list[HeadingSample]:
        settled_s = self._config.heading.start_after_s
        found = self._samples.headings(first_ns, last_ns, settled_s)
        if len(found) < _LEAST_HEADINGS:
            raise InsufficientError("needs rtk/heading with rtk/fix fixed", 2)
        return found

    def _turned(self, found: Fitted) -> bool:
        """Return whether the heading contradicts the autopilot's.

        With a wrong heading the accelerations do not fit either, so that biases are not the cause.
        """
        hint_nb, autopilot = found.hint_nb, self._config.autopilot
        return hint_nb is not None and "heading" in differences(found.fit, hint_nb, autopilot)

    def _look_longer(self, known: TurnOnBiases, found: Fitted) -> None:
        """Raise LackingError for a longer window, where a short one lately raised a suspicion."""
        now = self._samples.newest_ns
        if known.suspected(found):
            self._suspected_ns = now
        lately = self._suspected_ns is not None and now - self._suspected_ns < _SURE_S * 1e9
        if lately and found.window.before_s[0] < _LONGER_S[0] - _SHORTER_S:
            raise InsufficientError("imu/data: looks longer for its biases", 4)

    @property
    def _needs_heading(self) -> str:
        antennas = "rtk/heading or " if self._use_heading else ""
        return (
            f"needs {antennas}an orientation in imu/data that follows the gyroscopes: velocity "
            "tells no heading while hovering"
        )

    def _compare(self, found: WindowFit, hint_nb: Array) -> None:
        """Raise a doubt where the fit differs from the autopilot's attitude.

        A small difference is accepted once it has lasted for ``wait_s``, for the autopilot may
        err.
        """
        for what, doubt in differences(found, hint_nb, self._config.autopilot).items():
            if doubt.lasting or self._still_doubted(what):
                raise doubt

    def _start(self, measured: Measured, fitted: Fitted, sources: frozenset[Source]) -> Alignment:
        found, stamp_ns = fitted.fit, measured.last_ns
        latitude, longitude, height = measured.plane.geodetic_from_ned(found.position_n)
        gyro_b, accel_b = found.biases[:3].tolist(), found.biases[3:].tolist()
        state = NavState(
            tuple(quat_from_matrix(found.rotation_nb).tolist()),
            tuple(found.velocity_n.tolist()),
            float(latitude),
            float(longitude),
            float(height),
            tuple(gyro_b),
            tuple(accel_b),
            (0.0, 0.0, 0.0),
        )
        rest = self._samples.rest(stamp_ns)
        rtk_status = self._samples.rtk_status(stamp_ns)
        return Alignment(
            stamp_ns,
            state,
            found.covariance,
            *rest,
            sources,
            rtk_status,
            fitted.vibration,
            float(fitted.window.before_s[0]),
        )

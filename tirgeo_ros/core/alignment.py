"""The first state, at rest or in flight, from what there is.

A window of some seconds is fitted whole (``window_fit``): tilt comes from the accelerometers
corrected by the change of velocity, heading from two antennas or from the autopilot. What does
not fit together is waited out; only what stays so for long is passed over for the next best.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.alignment_checks import (
    DoubtError,
    LackingError,
    agreeing,
    checked,
    differences,
    furthest,
)
from tirgeo_ros.core.alignment_data import (
    autopilot_attitude,
    autopilot_observation,
    heading_observations,
    position_observation,
    topic_of,
    velocity_observation,
)
from tirgeo_ros.core.alignment_samples import AlignmentSamples, span
from tirgeo_ros.core.attitude import quat_from_matrix
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.geodesy import TangentPlane, gravity_down
from tirgeo_ros.core.inertial_window import Biases, integrate
from tirgeo_ros.core.samples import (
    Array,
    FixStatus,
    HeadingSample,
    ImuSample,
    NavigationInput,
    PositionSample,
    Source,
    VelocitySample,
)
from tirgeo_ros.core.strapdown import NavState
from tirgeo_ros.core.validity import usable_attitude
from tirgeo_ros.core.window_fit import Fit, Observation, fit

__all__ = ["Aligner", "Alignment", "Biases"]

#: A window that does not do is made this long, where ``alignment.duration_s`` is shorter.
_LONGER_S = (2.5, 6.0)
_LEAST_POSITIONS = 2
_LEAST_HEADINGS = 3
_LARGEST_AGE_NS = 2_000_000_000  # of the window's end
_RETRY_NS = 500_000_000  # of what costs more than a look at the samples
_DOUBT_ENDS_NS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Alignment:
    """A state to start from: the IMU's, at ``stamp_ns``."""

    stamp_ns: int
    state: NavState
    covariance: Array  # (15, 15)
    imu: tuple[ImuSample, ...]  # the newest sample up to the stamp and all after it
    later: tuple[NavigationInput, ...]  # measurements after the stamp, in order of arrival
    sources: frozenset[Source]  # of the measurements in it
    rtk_status: FixStatus | None  # of the newest RTK position up to the stamp


class _Plan(NamedTuple):
    """What to start from. Without a velocity source the positions tell velocity."""

    velocity: Source | None
    position: Source
    antennas: bool  # the heading is that of rtk/heading, else the autopilot's


#: Best first. The errors of ordinary GPS's positions move slowly: their differences tell a
#: velocity, if only over the longest window.
_SOURCES = (
    (Source.RTK_VELOCITY, Source.RTK_POSITION),
    (None, Source.RTK_POSITION),
    (Source.GPS_VELOCITY, Source.RTK_POSITION),
    (Source.RTK_VELOCITY, Source.GPS_POSITION),
    (Source.GPS_VELOCITY, Source.GPS_POSITION),
    (None, Source.GPS_POSITION),
)


class Aligner:
    """Collects samples until a state can be found; ``reason`` says what is missing.

    ``prior`` is what an earlier run of the filter knew of the IMU's biases.
    """

    def __init__(
        self, config: EkfConfig, *, use_heading: bool, prior: Biases | None = None
    ) -> None:
        self._config = config
        self._use_heading = use_heading
        self._biases = prior or _unknown_biases(config)
        duration_s = config.alignment.duration_s
        self._lengths_s = (duration_s, *(x for x in _LONGER_S if x > duration_s))
        keep_s = self._lengths_s[-1] + config.max_delay_s + 1.0
        self._samples = AlignmentSamples(keep_s, config.max_imu_gap_s)
        self._next_ns = 0
        self._doubts: dict[str, tuple[int, int]] = {}  # first and latest stamp of each
        self.reason = "needs imu/data"

    def add(self, sample: NavigationInput) -> Alignment | None:
        """Take one valid sample; gives the alignment once it is possible."""
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
        """Try the best, and once that has been waited for long enough, all, best first."""
        lacks: list[LackingError] = []
        if self._waited:
            self._next_ns = self._samples.newest_ns + _RETRY_NS
        for plan in self._plans():
            outcome = self._outcome(plan)
            if isinstance(outcome, Alignment):
                return outcome
            if isinstance(outcome, LackingError):
                lacks.append(outcome)
                continue
            self.reason = str(outcome)
            self._next_ns = self._samples.newest_ns + _RETRY_NS
            if self._still_doubted("samples"):
                return None
        if lacks:
            self.reason = str(furthest(lacks))
        return None

    def _plans(self) -> list[_Plan]:
        kinds = (True, False) if self._use_heading else (False,)
        plans = [_Plan(v, p, antennas) for v, p in _SOURCES for antennas in kinds]
        return plans if self._waited else plans[:1]

    def _outcome(self, plan: _Plan) -> Alignment | LackingError | DoubtError:
        """What the shortest window gives that has all it needs, or why none has."""
        lacks: list[LackingError] = []
        for length_s in self._lengths_s:
            outcome = self._outcome_over(plan, length_s)
            if not isinstance(outcome, LackingError):
                return outcome
            lacks.append(outcome)
        return furthest(lacks)

    def _outcome_over(self, plan: _Plan, length_s: float) -> Alignment | LackingError | DoubtError:
        try:
            return self._align(plan, length_s)
        except (LackingError, DoubtError) as error:
            return error

    def _still_doubted(self, what: str) -> bool:
        """Note a doubt; false once it has come again and again for ``wait_s``."""
        now = self._samples.newest_ns
        since, latest = self._doubts.get(what, (now, now))
        if now - latest > _DOUBT_ENDS_NS:
            since = now
        self._doubts[what] = (since, now)
        return now - since < self._config.alignment.wait_s * 1e9

    def _align(self, plan: _Plan, length_s: float) -> Alignment:
        """Raises LackingError or DoubtError."""
        positions, velocities = self._motion(plan, length_s)
        stamps = [s.stamp_ns for s in positions] + [s.stamp_ns for s in velocities]
        first, last = min(stamps), max(stamps)
        imu = self._samples.imu_over(first, last)
        readings = self._antenna_headings(first, last) if plan.antennas else []
        if not plan.antennas and not any(usable_attitude(s.autopilot_q_nb) for s in imu):
            raise self._no_heading()
        window = integrate(imu, [*stamps, *(s.stamp_ns for s in readings)], self._biases)
        hint_nb = autopilot_attitude(window, imu)
        if plan.antennas:
            headings = heading_observations(readings, self._config.heading)
        else:
            headings = self._autopilot_heading(hint_nb, last)
        headings, start_nb = agreeing(window, headings)
        plane = _plane_at(positions[-1])
        gravity = gravity_down(plane.latitude_rad, plane.height_m)
        seen = [position_observation(s, plane, self._config) for s in positions]
        seen += [velocity_observation(s, self._config) for s in velocities]
        seen += headings
        found = fit(window, seen, start_nb, gravity, self._biases, self._config.imu)
        found = checked(found, seen)
        if hint_nb is not None:
            self._compare(found, hint_nb)
        sources = {positions[-1].source, *(s.source for s in velocities)}
        if plan.antennas:
            sources.add(Source.RTK_HEADING)
        return self._start(last, plane, found, frozenset(sources))

    def _motion(
        self, plan: _Plan, length_s: float
    ) -> tuple[list[PositionSample], list[VelocitySample]]:
        """Positions and velocities of the window."""
        positions = self._samples.positions(plan.position)
        velocities = self._samples.velocities(plan.velocity) if plan.velocity else []
        found = span(velocities if plan.velocity else positions, round(length_s * 1e9))
        if found is None or found[1] < self._samples.newest_ns - _LARGEST_AGE_NS:
            raise LackingError(self._needs_velocity(plan.velocity), 0)
        first, last = found
        positions = [s for s in positions if first <= s.stamp_ns <= last]
        if len(positions) < _LEAST_POSITIONS:
            other = " or gps/fix" if self._waited else ""
            raise LackingError(f"needs rtk/fix{other}", 1)
        return positions, [s for s in velocities if first <= s.stamp_ns <= last]

    def _needs_velocity(self, source: Source | None) -> str:
        topic = topic_of(source) if source else "rtk/fix or gps/fix"
        return f"needs {topic} over {self._config.alignment.duration_s:g} s"

    def _antenna_headings(self, first_ns: int, last_ns: int) -> list[HeadingSample]:
        settled_s = self._config.heading.start_after_s
        found = self._samples.headings(first_ns, last_ns, settled_s)
        if len(found) < _LEAST_HEADINGS:
            raise LackingError("needs rtk/heading with rtk/fix fixed", 2)
        return found

    def _autopilot_heading(self, hint_nb: Array | None, last_ns: int) -> list[Observation]:
        if hint_nb is None:
            raise self._no_heading()
        return [autopilot_observation(hint_nb, last_ns, self._config.autopilot)]

    def _no_heading(self) -> LackingError:
        antennas = "rtk/heading or " if self._use_heading else ""
        return LackingError(
            f"needs {antennas}an orientation in imu/data that follows the gyroscopes: velocity "
            "tells no heading while hovering",
            3,
        )

    def _compare(self, found: Fit, hint_nb: Array) -> None:
        """Doubt what differs from the autopilot's attitude; not for ever, it may be wrong."""
        for what, text in differences(found, hint_nb, self._config.autopilot).items():
            if self._still_doubted(what):
                raise DoubtError(text)

    def _start(
        self, stamp_ns: int, plane: TangentPlane, found: Fit, sources: frozenset[Source]
    ) -> Alignment:
        latitude, longitude, height = plane.geodetic_from_ned(found.position_n)
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
        return Alignment(stamp_ns, state, found.covariance, *rest, sources, rtk_status)


def _plane_at(sample: PositionSample) -> TangentPlane:
    return TangentPlane(sample.latitude_rad, sample.longitude_rad, sample.height_m)


def _unknown_biases(config: EkfConfig) -> Biases:
    """Before any flight: the turn-on bias and what varies about it."""
    imu = config.imu
    gyro = imu.gyro_turn_on_bias**2 + np.square(imu.gyro_bias_instability)
    accel = imu.accel_turn_on_bias**2 + np.square(imu.accel_bias_instability)
    return Biases((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), np.diag([*gyro, *accel]))

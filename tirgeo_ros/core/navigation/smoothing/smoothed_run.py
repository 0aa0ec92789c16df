"""Hold the smoothed solutions of one run of the filter."""

from __future__ import annotations

import bisect

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.ins_error_model import ANTENNA, feedback, has_antenna
from tirgeo_ros.core.navigation.published_solution import SolutionMaker, unsure_by
from tirgeo_ros.core.navigation.smoothing.backward_pass import smooth
from tirgeo_ros.core.navigation.smoothing.flight_record import MOVED, FlightRecord
from tirgeo_ros.core.navigation.strapdown import NavState, Vector
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.poses import NavSolution

_ZERO: Vector = (0.0, 0.0, 0.0)


class SmoothedRun:
    """Make the smoothed solution at any IMU sample of a run; smooths the record in place."""

    def __init__(self, config: EkfConfig, record: FlightRecord) -> None:
        self._form = SolutionMaker(config)
        self._has_antenna = has_antenna(record.states)
        self._square, self._errors = record.square, smooth(record)
        # Not the record itself: its transitions and measurements are needed no more.
        self._covariances, self._kinds = record.covariances, record.kinds
        self._steps_s, self._epochs = record.steps_s, record.epochs
        self._stamps_ns, self._marks = record.stamps_ns, record.marks

    def at(self, stamp_ns: int) -> NavSolution:
        """Return the solution at an IMU sample's stamp. Raise KeyError where there is none."""
        place = bisect.bisect_left(self._stamps_ns, stamp_ns)
        if place == len(self._stamps_ns) or self._stamps_ns[place] != stamp_ns:
            raise KeyError(stamp_ns)
        numbers = self._epochs[place].tolist()
        error, covariance = self._error(self._marks[place], numbers[0])
        vectors = [tuple(numbers[at : at + 3]) for at in range(5, len(numbers), 3)]
        velocity_n, (latitude, longitude, height), gyro, accel, *rest = vectors
        rate_b, white_b, antenna_b, step = rest
        before = NavState(
            tuple(numbers[1:5]), velocity_n, latitude, longitude, height, gyro, accel, _ZERO
        )
        if self._has_antenna:
            antenna_b = tuple((error[ANTENNA] + antenna_b).tolist())
        state = feedback(before, error)
        made = self._form.made(stamp_ns, state, covariance, rate_b, white_b, antenna_b)
        return unsure_by(made, step if any(step) else ())

    def _error(self, mark: int, lag_s: float) -> tuple[Array, Array]:
        """Return the smoothed error (n,) and its covariance (n, n), ``lag_s`` after a change.

        Between the ends of a step of the covariance both are interpolated linearly.
        """
        error, lower = self._errors[mark], self._covariances[mark]
        later = mark + 1
        if lag_s and later < len(self._kinds) and self._kinds[later] == MOVED:
            share = lag_s / self._steps_s[later]
            error = error + share * (self._errors[later] - error)
            lower = lower + share * (self._covariances[later] - lower)
        return error, lower.take(self._square)

"""Make the published solution of a filter's state and covariance."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.navigation.ins_error_model import (
    ATTITUDE,
    POSITION,
    VELOCITY,
    has_antenna,
    states_of,
)
from tirgeo_ros.core.navigation.solution_at_antenna import at_antenna
from tirgeo_ros.core.navigation.strapdown import NavState
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.poses import NavSolution

_ROWS = np.r_[POSITION, ATTITUDE, VELOCITY]


class SolutionMaker:
    """Make solutions in the form that the parameters ask for."""

    def __init__(self, config: EkfConfig) -> None:
        states = states_of(config)
        self._at_antenna = has_antenna(states) and not config.aircraft.rtk_lever_b.any()
        # Flat indices of the solution's covariance (9, 9) in the filter's covariance.
        self._entries = states * _ROWS[:, None] + _ROWS

    def made(
        self,
        stamp_ns: int,
        state: NavState,
        covariance: Array,
        rate_b: Vector,
        white_b: Vector,
        antenna_b: Vector,
    ) -> NavSolution:
        """Return the solution of a state and the covariance (n, n) of its error.

        ``rate_b`` is the angular rate as read (rad/s), ``white_b`` the variances of its white
        noise, ``antenna_b`` the estimated part of the RTK antenna's place (m).
        """
        bias, (x, y, z), item = state.gyro_bias_b, white_b, covariance.item
        turning_b = rate_b[0] - bias[0], rate_b[1] - bias[1], rate_b[2] - bias[2]
        vectors = np.array((*state.velocity_n, *state.q_nb, *turning_b))
        found = (
            stamp_ns,
            state.latitude_rad,
            state.longitude_rad,
            state.height_m,
            vectors[:3],
            vectors[3:7],
            vectors[7:],
            (x + item(9, 9), y + item(10, 10), z + item(11, 11)),
            covariance.take(self._entries),
        )
        solution: NavSolution = tuple.__new__(NavSolution, found)  # half of NavSolution(...)
        return at_antenna(solution, covariance, antenna_b) if self._at_antenna else solution


def unsure_by(solution: NavSolution, step: tuple[float, ...]) -> NavSolution:
    """Return a solution as uncertain as an RTK step (m, NED) that is not accepted yet is large."""
    if step:
        solution.covariance[:3, :3] += np.outer(step, step)
    return solution

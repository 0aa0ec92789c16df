"""Convert an alignment to the filter's initial state, covariance and aid records."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.frames.rotations import rotation_of
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.aiding.state_estimate import StateEstimate
from tirgeo_ros.core.navigation.alignment.aligner import Alignment
from tirgeo_ros.core.navigation.ins.ins_error_model import (
    ANTENNA,
    GPS_ERROR,
    POSITION,
    STATES,
    has_antenna,
    heading_error,
    states_of,
)
from tirgeo_ros.core.navigation.ins.strapdown import matrix, rotate
from tirgeo_ros.core.types.arrays import Array, Vector
from tirgeo_ros.core.types.measurements import Source


def initial_estimate(config: EkfConfig, alignment: Alignment) -> StateEstimate:
    """Return the filter's first estimate, in which the aids of the alignment count as used.

    The receivers' slow errors begin at zero with their configured standard deviations. Where the
    alignment used a receiver, its slow error is correlated with the state.
    """
    states = states_of(config)
    covariance = np.zeros((states, states))
    covariance[:STATES, :STATES] = alignment.covariance
    covariance[GPS_ERROR, GPS_ERROR] = np.diag(np.square(config.gps.position_sigma_m))
    if has_antenna(states):
        _add_antenna(config, alignment, covariance)
    if heading_error(states) is not None:
        _add_heading_error(config, alignment, covariance)
    aids = AidStatus(Receivers(alignment.stamp_ns))
    for source in alignment.sources:
        aids = aids.with_track(source, AidTrack(alignment.stamp_ns))
    if alignment.rtk_status is not None:
        aids = aids.with_status(alignment.rtk_status, alignment.stamp_ns, 0)
    if Source.GPS_POSITION in alignment.sources:
        # The position came from the GPS: its error (truth - estimate) is the GPS's error, negated.
        gps_m2 = covariance[GPS_ERROR, GPS_ERROR]
        covariance[POSITION, GPS_ERROR] = covariance[GPS_ERROR, POSITION] = -gps_m2
        noise_m2 = config.gps.position_noise_m**2
        least = np.diag(gps_m2) + noise_m2
        position = covariance[POSITION, POSITION]
        np.fill_diagonal(position, np.maximum(np.diag(position), least))
    return StateEstimate(alignment.state, covariance, aids)


def _add_antenna(config: EkfConfig, alignment: Alignment, covariance: Array) -> None:
    """Add the lever arm's error to ``covariance`` in place, and to a position taken through it."""
    effect = np.zeros((len(covariance), 3))
    effect[ANTENNA] = np.eye(3)
    if Source.RTK_POSITION in alignment.sources:
        effect[POSITION] = -matrix(rotation_of(alignment.state.q_nb))
    covariance += effect @ np.diag(config.aircraft.rtk_lever_sigma_b**2) @ effect.T


def _add_heading_error(config: EkfConfig, alignment: Alignment, covariance: Array) -> None:
    """Add the slow error of the headings to ``covariance``, in place.

    A heading taken from them has that error too, negated. It also turns the lever arm, and so
    moves the position that was taken through it: ``R_true l = R l + phi x R l``.
    """
    effect = np.zeros(len(covariance))
    effect[-1] = -1.0
    if Source.RTK_HEADING in alignment.sources:
        rtk = Source.RTK_POSITION in alignment.sources
        antenna_b = config.aircraft.antenna_b(Source.RTK_POSITION if rtk else Source.GPS_POSITION)
        lever_b: Vector = tuple(antenna_b.tolist())
        north, east, _ = rotate(rotation_of(alignment.state.q_nb), lever_b)
        effect[2], effect[POSITION] = 1.0, (east, -north, 0.0)
    covariance += math.radians(config.heading.bias_sigma_deg) ** 2 * np.outer(effect, effect)

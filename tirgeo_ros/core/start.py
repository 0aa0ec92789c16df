"""From an alignment to what the filter believes first."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.aiding.belief import Belief
from tirgeo_ros.core.aiding.control import Control, Receivers, Track
from tirgeo_ros.core.alignment import Alignment
from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.error_state import GPS_ERROR, HEADING_ERROR, POSITION, STATES, states_of
from tirgeo_ros.core.samples import Source


def first_belief(config: EkfConfig, alignment: Alignment) -> Belief:
    """The alignment, with the receivers' slow errors unknown, and what it used as used."""
    states = states_of(config)
    covariance = np.zeros((states, states))
    covariance[:STATES, :STATES] = alignment.covariance
    covariance[GPS_ERROR, GPS_ERROR] = np.diag(np.square(config.gps.position_sigma_m))
    if states > HEADING_ERROR:
        covariance[HEADING_ERROR, HEADING_ERROR] = math.radians(config.heading.bias_sigma_deg) ** 2
        if Source.RTK_HEADING in alignment.sources:  # so the alignment's heading has that error
            variance = covariance[HEADING_ERROR, HEADING_ERROR]
            covariance[2, 2] += variance
            covariance[2, HEADING_ERROR] = covariance[HEADING_ERROR, 2] = -variance
    control = Control(Receivers(alignment.stamp_ns))
    for source in alignment.sources:
        control = control.with_track(source, Track(alignment.stamp_ns))
    if alignment.rtk_status is not None:
        control = control.heard(alignment.rtk_status, alignment.stamp_ns, 0)
    if Source.GPS_POSITION in alignment.sources:
        # The GPS's slow error is the position's: truth - estimate is what the GPS is off, negated.
        known = covariance[GPS_ERROR, GPS_ERROR]
        covariance[POSITION, GPS_ERROR] = covariance[GPS_ERROR, POSITION] = -known
        noise_m2 = config.gps.position_noise_m**2
        least = np.diag(known) + noise_m2
        position = covariance[POSITION, POSITION]
        np.fill_diagonal(position, np.maximum(np.diag(position), least))
    return Belief(alignment.state, covariance, control)

"""Alignments on simulated flights, for tests."""

from __future__ import annotations

import math

import numpy as np
from flights import navigation_samples

from tirgeo_ros.core.frames.rotations import quat_conjugate, quat_multiply, rotvec_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.alignment.aligner import Aligner

WAIT_S = 5.0  # alignment.wait_s


def samples_from(flown, start_s=0.0, without=(), length_s=14.0):
    first = flown.truth.stamp_ns[0] + round(start_s * 1e9)
    kept = (s for s in navigation_samples(flown) if s.source not in without)
    return [s for s in kept if first <= s.stamp_ns < first + length_s * 1e9]


def spoilt(samples, kind, change, from_s=0.0, to_s=math.inf):
    """Samples of a source changed between two times from the first."""
    first = samples[0].stamp_ns
    return [
        change(s) if s.source is kind and from_s <= (s.stamp_ns - first) * 1e-9 <= to_s else s
        for s in samples
    ]


def aligned(samples, config, *, use_heading=True, prior=None):
    aligner = Aligner(config, use_heading=use_heading, prior=prior)
    for sample in samples:
        found = aligner.add(sample)
        if found is not None:
            return found, aligner
    return None, aligner


def error(flown, found):
    """(15,) truth minus estimate."""
    truth = flown.truth
    i = truth.stamp_ns.index(found.stamp_ns)
    state = found.state
    here = TangentPlane(state.latitude_rad, state.longitude_rad, state.height_m)
    attitude = quat_multiply(truth.q_nb[i], quat_conjugate(np.array(state.q_nb)))
    return np.concatenate(
        [
            rotvec_from_quat(attitude),
            truth.velocity_n[i] - state.velocity_n,
            here.ned_from_geodetic(
                truth.latitude_rad[i], truth.longitude_rad[i], truth.height_m[i]
            ),
            truth.gyro_bias_b[i] - state.gyro_bias_b,
            truth.accel_bias_b[i] - state.accel_bias_b,
        ]
    )


def assert_right(flown, found, limit=4.5):
    """No state further off than 4.5 sigma: one in 10 000 of 15 states would be."""
    assert found is not None
    ratio = error(flown, found) / np.sqrt(np.diag(found.covariance))
    assert np.abs(ratio).max() < limit


def duration_s(samples, found):
    return (found.stamp_ns - samples[0].stamp_ns) * 1e-9

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
"""Alignments on simulated flights, for tests."""

from __future__ import annotations

import math

import numpy as np
from flights import navigation_samples
from motions import difference

from tirgeo_ros.core.navigation.alignment.aligner import Aligner
from tirgeo_ros.core.navigation.ins.strapdown import NavState

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
    place = truth.latitude_rad[i], truth.longitude_rad[i], truth.height_m[i]
    biases = truth.gyro_bias_b[i], truth.accel_bias_b[i]
    true = NavState(truth.q_nb[i], truth.velocity_n[i], *place, *biases, (0.0, 0.0, 0.0))
    return difference(true, found.state)


def assert_right(flown, found, limit=4.5):
    """No state further off than 4.5 sigma: one in 10 000 of 15 states would be."""
    assert found is not None
    ratio = error(flown, found) / np.sqrt(np.diag(found.covariance))
    assert np.abs(ratio).max() < limit


def duration_s(samples, found):
    return (found.stamp_ns - samples[0].stamp_ns) * 1e-9

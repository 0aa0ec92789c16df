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
"""Times, states, estimates and samples, for tests of the filter and its aids."""

from __future__ import annotations

import numpy as np

from tirgeo_ros.core.config import EkfConfig
from tirgeo_ros.core.config.schema import config_from
from tirgeo_ros.core.frames.rotations import quat_from_euler, rotation_of
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.navigation.aiding.aid import StateEstimate
from tirgeo_ros.core.navigation.aiding.aid_status import AidStatus, AidTrack, Receivers
from tirgeo_ros.core.navigation.ins.error_states import ANTENNA
from tirgeo_ros.core.navigation.ins.strapdown import NavState, matrix
from tirgeo_ros.core.types.measurements import (
    FixStatus,
    HeadingSample,
    PositionSample,
    Source,
    VelocitySample,
)

SECOND_NS = 1_000_000_000
TIMEOUT_NS = SECOND_NS
NOW_NS = 5 * SECOND_NS
ZERO = (0.0, 0.0, 0.0)
HOME = (0.695, 2.04, 31.5)
LEVEL = NavState((1.0, 0.0, 0.0, 0.0), ZERO, *HOME, ZERO, ZERO, ZERO)
RTK = (Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
#: Both antennas stand here, FLU and FRD.
ANTENNA_M, LEVER_B = (0.3, 0.4, 0.5), np.array([0.3, -0.4, -0.5])
_KNOWN = {"aircraft.rtk_antenna_sigma_m": ZERO}


def ns(seconds: float) -> int:
    return 1000 * SECOND_NS + round(seconds * SECOND_NS)


def ekf_config(**values) -> EkfConfig:
    """Parameters with ``__`` for the point; the antenna's place is known."""
    return config_from(EkfConfig, _KNOWN | {k.replace("__", "."): v for k, v in values.items()})


MEASURED = ekf_config()


def armed_config(**values) -> EkfConfig:
    """The same with both antennas at ``ANTENNA_M``."""
    places = {"aircraft__rtk_antenna_m": ANTENNA_M, "aircraft__gps_antenna_m": ANTENNA_M}
    return ekf_config(**(places | values))


def state_of(roll: float, pitch: float, yaw: float) -> NavState:
    """A state in slow flight, in this attitude (rad)."""
    q = tuple(quat_from_euler(roll, pitch, yaw).tolist())
    return NavState(q, (3.0, -1.0, 0.2), *HOME, *[ZERO] * 3)


def estimate_of(state: NavState, states: int = ANTENNA.start, covariance=None) -> StateEstimate:
    """RTK fixed and its position, velocity and heading used just now, for long."""
    aids = AidStatus(Receivers(NOW_NS)).with_status(FixStatus.FIXED, 0, NOW_NS)
    aids = aids.with_status(FixStatus.FIXED, NOW_NS, NOW_NS)
    for source in RTK:
        aids = aids.with_track(source, AidTrack(NOW_NS, NOW_NS))
    return StateEstimate(state, np.eye(states) if covariance is None else covariance, aids)


def used_at(uses: dict[Source, int], status: FixStatus | None = None) -> AidStatus:
    """The records of aids that were used at these stamps, the newest with a fix status."""
    newest_ns = max(uses.values(), default=NOW_NS)
    aids = AidStatus(Receivers(newest_ns))
    if status is not None:
        aids = aids.with_status(status, newest_ns, TIMEOUT_NS)
    for source, stamp_ns in uses.items():
        aids = aids.with_track(source, AidTrack(stamp_ns))
    return aids


def heard(aids: AidStatus, t_s: float, status=FixStatus.FIXED) -> AidStatus:
    return aids.with_status(status, ns(t_s), TIMEOUT_NS)


def fix(t_s, shift_n=ZERO, source=Source.RTK_POSITION, status=FixStatus.FIXED, noise=None):
    """A position that far from home, NED m; RTK's noise is 1, 1, 2 cm, of GPS none is told."""
    lat, lon, height = map(float, TangentPlane(*HOME).geodetic_from_ned(np.array(shift_n)))
    if noise is None:
        noise = (1e-4, 1e-4, 4e-4) if source is Source.RTK_POSITION else ZERO
    return PositionSample(ns(t_s), source, status, lat, lon, height, np.diag(noise).astype(float))


def antenna_fix(state: NavState, shift_n, source=Source.RTK_POSITION) -> PositionSample:
    """The antenna's true place for a state, moved by some metres, with a sigma of 1 m."""
    plane = TangentPlane(state.latitude_rad, state.longitude_rad, state.height_m)
    place = matrix(rotation_of(state.q_nb)) @ LEVER_B + shift_n
    lat, lon, height = map(float, plane.geodetic_from_ned(place))
    return PositionSample(NOW_NS, source, FixStatus.FIXED, lat, lon, height, np.eye(3))


def velocity(t_s, v_n=ZERO, source=Source.RTK_VELOCITY, variance=4e-4) -> VelocitySample:
    return VelocitySample(ns(t_s), source, np.array(v_n, float), variance * np.eye(3))


def heading(t_s: float, degrees: float = 0.0) -> HeadingSample:
    return HeadingSample(ns(t_s), np.radians(degrees), np.radians(0.6) ** 2)


def assert_covariance(covariance):
    """Symmetric, and positive but for rounding."""
    np.testing.assert_array_equal(covariance, covariance.T)
    scales = np.sqrt(np.diag(covariance))
    assert np.linalg.eigvalsh(covariance / np.outer(scales, scales))[0] > -1e-12

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
"""Filter a flight given as tables: the work of ``tirgeo process`` without a bag."""

from __future__ import annotations

import warnings
from array import array
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tirgeo_ros.core.checks.inertial_checks import imu_findings
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.streams.stamps import Arrivals, exposure_ns
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import PoseError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import QUIET, Outcome
from tirgeo_ros.library.projecting import PicturePose
from tirgeo_ros.library.tables import Table, arrived, is_frame
from tirgeo_ros.tools.replay.flight import FlightPoses, pose_at
from tirgeo_ros.tools.replay.node_configs import Config, NodeConfigs, load_config
from tirgeo_ros.tools.replay.registration import GIMBAL_TOPICS, METHOD_TOPICS, Registered, Sample

_NED = ("north", "east", "down")
#: Ends of geodetic place, position, velocity, attitude, rate and covariance in a row of numbers.
_ENDS = (3, 6, 9, 13, 16, 97)
#: Topic -> the argument of its table, in the order of the arguments.
_ARGUMENTS = {
    "imu/data": "imu",
    "rtk/fix": "rtk_fix",
    "rtk/vel": "rtk_velocity",
    "rtk/heading": "heading",
    "gps/fix": "gps_fix",
    "gps/vel": "gps_velocity",
    "baro/pressure": "pressure",
    "ekf_node/set_heading": "set_heading",
    "gimbal/joint_states": "joints",
    "gimbal/attitude": "camera_attitude",
}
_WHY_NOT: Mapping[object, str] = {
    Miss.EMPTY: "the flight has none; give filter_flight joints or camera_attitude",
    Miss.TOO_OLD: "that is before the first",
    Miss.GAP: "the poses on both sides are too far apart",
}


@dataclass(frozen=True, eq=False)
class FilteredFlight:
    """Hold what ``filter_flight`` estimated: n rows, one for each published solution."""

    stamp_ns: IntArray
    """(n,) time of the IMU sample, ns."""
    latitude_rad: Array
    """(n,) geodetic latitude of the IMU, rad."""
    longitude_rad: Array
    """(n,) longitude of the IMU, rad."""
    height_m: Array
    """(n,) height of the IMU above the WGS84 ellipsoid, m."""
    position_n: Array
    """(n, 3) position of the IMU in ``plane``: north, east, down, m."""
    velocity_n: Array
    """(n, 3) velocity north, east, down at the aircraft, m/s."""
    q_nb: Array
    """(n, 4) attitude, quaternion w, x, y, z: body (FRD) to north, east, down at the aircraft."""
    rpy_rad: Array
    """(n, 3) the attitude as roll, pitch and heading (0 = true north, clockwise), rad."""
    angular_rate_b: Array
    """(n, 3) angular rate about forward, right, down, its bias removed, rad/s."""
    covariance: Array
    """(n, 9, 9) of position (m2), attitude error phi (rad2), velocity (m2/s2): NED each."""
    method: str
    """The method: ``raw``, ``rtk``, ``ekf`` or ``ekf_heading``."""
    state: str
    """The filter's state at the end: ``waiting``, ``aligning``, ``running``, ..."""
    reason: str
    """Why it is not running, or an empty string."""
    verdicts: Mapping[str, Mapping[str, int]]
    """Source -> outcome -> number of samples: ``verdicts["rtk_position"]["used"]``."""
    warnings: tuple[str, ...]
    """Faults of the sensors that did not stop the navigation, a line each."""
    plane: TangentPlane | None
    """The tangent plane of ``position_n`` and of the camera's poses; None if it has no origin."""
    table: Any
    """``FilteredFlight.columns`` as a data frame if the IMU's table was one, else as a dict."""
    video_latency_s: float
    """Stamp of a picture minus its time of exposure, s, of the parameters."""
    _cameras: PoseBuffer[CameraPose] = field(repr=False)

    def __len__(self) -> int:
        """Return the number of solutions."""
        return len(self.stamp_ns)

    @property
    def sigma(self) -> Array:
        """Return (n, 9) the standard deviations of ``covariance``: m, rad, m/s.

        Entry 5 is that of the heading.
        """
        return np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    def columns(self) -> dict[str, Array | IntArray]:
        """Return the solutions as columns (n,), with their units in the names."""
        columns: dict[str, Array | IntArray] = {
            "stamp_ns": self.stamp_ns,
            "latitude_rad": self.latitude_rad,
            "longitude_rad": self.longitude_rad,
            "height_m": self.height_m,
        }
        sigma = self.sigma
        for names, values in (
            ([f"{axis}_m" for axis in _NED], self.position_n),
            ([f"velocity_{axis}_m_s" for axis in _NED], self.velocity_n),
            ([f"body_q{part}" for part in "wxyz"], self.q_nb),
            (["roll_rad", "pitch_rad", "heading_rad"], self.rpy_rad),
            ([f"sigma_{axis}_m" for axis in _NED], sigma[:, :3]),
            (["sigma_phi_north_rad", "sigma_phi_east_rad", "sigma_heading_rad"], sigma[:, 3:6]),
            ([f"sigma_velocity_{axis}_m_s" for axis in _NED], sigma[:, 6:]),
        ):
            columns |= dict(zip(names, values.T, strict=True))
        return columns

    def picture_pose(self, stamp_ns: int) -> PicturePose:
        """Return the camera's pose at the exposure of the picture with this stamp, ns.

        The exposure is ``video_latency_s`` before the stamp. Raises PoseError if the camera's pose
        at the exposure is not known.
        """
        try:
            exposed_ns = exposure_ns(int(stamp_ns), self.video_latency_s)
        except (TypeError, ValueError, OverflowError):
            raise PoseError(f"stamp_ns: must be a number of ns, is {stamp_ns!r}") from None
        motion = pose_at(self._cameras, exposed_ns)
        if motion is None or self.plane is None:
            late = f"that is after the last, at {self._cameras.newest_ns} ns"
            why = _WHY_NOT.get(self._cameras.at(exposed_ns), late)
            raise PoseError(f"no camera pose at {exposed_ns} ns: {why}")
        return PicturePose(int(stamp_ns), motion[0], self.plane, motion[1])


def filter_flight(
    imu: Table,
    *,
    rtk_fix: Table | None = None,
    rtk_velocity: Table | None = None,
    heading: Table | None = None,
    gps_fix: Table | None = None,
    gps_velocity: Table | None = None,
    pressure: Table | None = None,
    set_heading: Table | None = None,
    joints: Table | None = None,
    camera_attitude: Table | None = None,
    smooth: bool = False,
    config: Config = None,
) -> FilteredFlight:
    """Filter a flight: estimate the aircraft's poses, and with the gimbal's angles the camera's.

    Each table is a dict of arrays, a structured array or a data frame, with ``stamp_ns`` and the
    columns of its sensor: ``docs/library.md`` lists them with units and axes. ``heading`` is that
    of two antennas, ``set_heading`` one that a person sets. Only the camera's poses need
    ``joints`` or ``camera_attitude``. ``config`` is as for ``load_config``; unless it sets the
    method, the method is ``ekf_heading``, or ``ekf`` without ``heading``.

    With ``smooth`` each pose is estimated from the whole flight. A flight without any solution
    gives an empty result and a warning. Raises TableError naming a wrong column, and ConfigError.
    """
    aids = (rtk_fix, rtk_velocity, heading, gps_fix, gps_velocity, pressure, set_heading)
    pairs = zip(_ARGUMENTS, (imu, *aids, joints, camera_attitude), strict=True)
    tables = {topic: table for topic, table in pairs if table is not None}
    configs, _ = load_config(config).fitting({f"/{topic}" for topic in tables}, "")
    solutions = Solutions()
    poses = FlightPoses(configs.ekf, configs.gimbal, (), None, [solutions.watch])
    if smooth:
        record = poses.recorder()
        for sample in _stream(tables, configs):
            record(sample)
        poses.smooth()
    for sample in _stream(tables, configs):
        poses.take(sample)
    status = poses.registration.navigation.status()
    verdicts: defaultdict[str, dict[str, int]] = defaultdict(dict)
    for (source, outcome), number in status.counts.items():
        verdicts[source][outcome] = number
    flight = FilteredFlight(
        **solutions.arrays(),
        method=status.method,
        state=status.state.value,
        reason=status.reason,
        verdicts=dict(verdicts),
        warnings=status.warnings,
        plane=poses.plane,
        table=None,
        video_latency_s=configs.overlay.video_latency_s,
        _cameras=poses.cameras,
    )
    columns = flight.columns()
    object.__setattr__(flight, "table", type(imu)(columns) if is_frame(imu) else columns)
    if not len(flight):
        warnings.warn(f"filter_flight: no solution: {_why(flight, tables, configs)}", stacklevel=2)
    return flight


class Solutions:
    """Collect solutions compactly: an hour at 100 Hz takes 280 MB."""

    def __init__(self) -> None:
        self._stamps = array("q")
        self._rows = array("d")

    def watch(self, _sample: Sample, registered: Registered) -> None:
        """Add a solution, and its pose in the plane."""
        solution, body = registered.solution, registered.body
        if solution is None or body is None:
            return
        self._stamps.append(solution.stamp_ns)
        self._rows.extend((solution.latitude_rad, solution.longitude_rad, solution.height_m))
        motion = solution.velocity_n, solution.q_nb, solution.angular_rate_b
        for part in (body.position_n, *motion, solution.covariance):
            self._rows.frombytes(np.ascontiguousarray(part, float).tobytes())

    def arrays(self) -> dict[str, Any]:
        """Return the solutions as fields of a FilteredFlight."""
        rows = np.array(self._rows).reshape(-1, _ENDS[-1])
        place, position_n, velocity_n, q_nb, rate_b, covariance = np.split(rows, _ENDS[:-1], 1)
        return {
            "stamp_ns": np.array(self._stamps, np.int64),
            "latitude_rad": place[:, 0],
            "longitude_rad": place[:, 1],
            "height_m": place[:, 2],
            "position_n": position_n,
            "velocity_n": velocity_n,
            "q_nb": q_nb,
            "rpy_rad": euler_from_quat(q_nb),
            "angular_rate_b": rate_b,
            "covariance": covariance.reshape(-1, 9, 9),
        }


def _stream(tables: Mapping[str, Table], configs: NodeConfigs) -> Iterator[Sample]:
    """Yield the samples that the method and the composition use, in the order of arrival."""
    wanted = {*METHOD_TOPICS[configs.ekf.method], *GIMBAL_TOPICS[configs.gimbal.composition]}
    arrivals = Arrivals()
    for topic, arrival_ns, sample in arrived(tables, _ARGUMENTS):
        if topic in wanted:
            yield arrivals.stamped(topic, sample, arrival_ns)


def _why(flight: FilteredFlight, tables: Mapping[str, Table], configs: NodeConfigs) -> str:
    """Return why there is no solution: no position, a fault of the IMU, or the filter's reason."""
    if not {"rtk/fix", "gps/fix"} & tables.keys():
        return "there is no position: give rtk_fix or gps_fix"
    own = arrived({"imu/data": tables["imu/data"]}, _ARGUMENTS)
    for finding in imu_findings((sample for *_, sample in own), configs.ekf.aircraft.rotation_bi):
        return finding.line
    bad = [
        f"{number} {source} {outcome}"
        for source, counts in flight.verdicts.items()
        for outcome, number in counts.items()
        if Outcome(outcome) not in QUIET
    ]
    refused = f" (refused: {', '.join(bad)})" if bad else ""
    return f"{flight.reason or flight.state}{refused}"

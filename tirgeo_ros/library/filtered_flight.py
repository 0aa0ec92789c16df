"""Hold a filtered flight: the aircraft's poses as arrays, the camera's by time."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import PoseError
from tirgeo_ros.core.types.poses import BodyPose, CameraPose, NavSolution
from tirgeo_ros.library.picture_pose import PicturePose
from tirgeo_ros.tools.replay.flight_poses import pose_at

_NED = ("north", "east", "down")
#: Where in a row of numbers place, position, velocity, attitude, rate and covariance end.
_WIDTHS = (3, 6, 9, 13, 16, 97)


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

        The exposure is ``video_latency_s`` before the stamp. Raises PoseError where the camera's
        pose is not known then.
        """
        try:
            exposed_ns = int(stamp_ns) - round(self.video_latency_s * 1e9)
        except (TypeError, ValueError, OverflowError):
            raise PoseError(f"stamp_ns: must be a number of ns, is {stamp_ns!r}") from None
        found = pose_at(self._cameras, exposed_ns)
        if found is None or self.plane is None:
            raise PoseError(f"no camera pose at {exposed_ns} ns: {self._why_none(exposed_ns)}")
        return PicturePose(int(stamp_ns), found[0], self.plane, found[1])

    def _why_none(self, exposed_ns: int) -> str:
        miss = self._cameras.at(exposed_ns)
        if miss is Miss.EMPTY:
            return "the flight has none; give filter_flight joints or camera_attitude"
        if miss is Miss.TOO_OLD:
            return "that is before the first"
        if miss is Miss.TOO_NEW:
            return f"that is after the last, at {self._cameras.newest_ns} ns"
        return "the poses on both sides are too far apart"


class Solutions:
    """Collect solutions compactly: an hour at 100 Hz takes 280 MB."""

    def __init__(self) -> None:
        self._stamps = array("q")
        self._rows = array("d")

    def add(self, solution: NavSolution, body: BodyPose) -> None:
        """Add a solution, and its pose in the plane."""
        self._stamps.append(solution.stamp_ns)
        place = solution.latitude_rad, solution.longitude_rad, solution.height_m
        self._rows.extend(place)
        for part in (body.position_n, *solution[4:7], solution.covariance):
            self._rows.frombytes(np.ascontiguousarray(part, float).tobytes())

    def __len__(self) -> int:
        """Return their number."""
        return len(self._stamps)

    def flight(self, made: Callable[[dict[str, Any]], Any], **others: Any) -> FilteredFlight:
        """Return them as a flight; ``made`` turns columns into the table.

        ``others`` are the fields that are no arrays.
        """
        rows = np.array(self._rows).reshape(-1, _WIDTHS[-1])
        place, position_n, velocity_n, q_nb, rate_b, covariance = np.split(rows, _WIDTHS[:-1], 1)
        flight = FilteredFlight(
            stamp_ns=np.array(self._stamps, np.int64),
            latitude_rad=place[:, 0],
            longitude_rad=place[:, 1],
            height_m=place[:, 2],
            position_n=position_n,
            velocity_n=velocity_n,
            q_nb=q_nb,
            rpy_rad=euler_from_quat(q_nb),
            angular_rate_b=rate_b,
            covariance=covariance.reshape(-1, 9, 9),
            table=None,
            **others,
        )
        object.__setattr__(flight, "table", made(flight.columns()))
        return flight

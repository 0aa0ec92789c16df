"""Hold where a picture was taken, with all that projecting and locating need of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.frames.axes import Q_BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import quat_from_euler, quat_multiply
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.streams.sanity_checks import place_fault, pose_fault
from tirgeo_ros.core.types.errors import PoseError
from tirgeo_ros.core.types.poses import CameraPose


@dataclass(frozen=True, eq=False)
class PicturePose:
    """Hold the camera's pose at the exposure of a picture, and the plane that the pose is in."""

    stamp_ns: int
    """Stamp of the picture, ns."""
    pose: CameraPose
    """The camera's pose at the exposure, with its covariance, in ``plane``."""
    plane: TangentPlane
    """The tangent plane: ``plane.ned_from_geodetic`` gives points for ``project``."""
    rates: CameraRates | None = None
    """The camera's motion at the exposure; None: the time of exposure counts as exact."""

    @classmethod
    def of_angles(
        cls,
        latitude_rad: float,
        longitude_rad: float,
        height_m: float,
        *,
        roll_rad: float = 0.0,
        pitch_rad: float,
        heading_rad: float,
        covariance: npt.ArrayLike,
        stamp_ns: int = 0,
    ) -> PicturePose:
        """Return the pose of a camera whose place and angles are known from elsewhere.

        The angles are those of the camera body against north, east, down at its place: forward is
        the optical axis, heading 0 is true north, pitch -pi/2 looks straight down, roll is 0 with
        the picture's rows level. ``height_m`` is above the ellipsoid. ``covariance`` (6, 6) is of
        position (north, east, down, m2) and of the attitude error phi (north, east, down, rad2).
        The plane's origin is the camera's place. Raises PoseError for no place, no rotation or no
        covariance.
        """
        try:
            matrix = np.array(covariance, float)
            place = float(latitude_rad), float(longitude_rad), float(height_m)
            q_ng = quat_from_euler(float(roll_rad), float(pitch_rad), float(heading_rad))
        except (TypeError, ValueError) as error:
            raise PoseError(f"not the pose of a camera: {error}") from None
        if matrix.shape != (6, 6):
            raise PoseError(f"covariance must be of shape (6, 6), is {matrix.shape}")
        q_nc = quat_multiply(q_ng, Q_BODY_OPTICAL)
        fault = place_fault(*place)
        fault = fault or pose_fault(np.zeros(3), q_nc, matrix)
        if not fault and not np.allclose(matrix, matrix.T):
            fault = "covariance is not symmetric"
        if fault:
            raise PoseError(f"not the pose of a camera: {fault}")
        plane = TangentPlane(*place)
        return cls(stamp_ns, CameraPose(stamp_ns, np.zeros(3), q_nc, matrix), plane)

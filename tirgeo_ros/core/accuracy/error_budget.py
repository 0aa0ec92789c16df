"""How far off on the ground a pixel comes out, for errors of the camera's pose, time and lens.

Two forms of the same. The paper's (Ren et al. 2022, section 3.5): scalars of a level pinhole
camera over a plane, Equations 15 to 21 as printed. And ours: the derivative of the ground point by
position and attitude, from rotation matrices, for any lens and any covariance of the pose; the
paper's is its special case.

The paper measures its angle ``alpha`` differently in two places. In Equation 15 it is the angle
from the nadir and ``y_im`` goes up; in Equation 21 it is the depression below the horizon and
``y_im`` goes down. The second row of Equation 15 has the sign of ``x_im`` wrong: as printed, its
two rows are no rotation unless ``beta`` is a multiple of 90 degrees. Here it is mended.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.camera.model import Camera
from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import matrix_from_euler, skew
from tirgeo_ros.core.types.arrays import Array

_DOWN = 2


def paper_ground_offset(
    x_im: Array, y_im: Array, f: float, alpha_rad: float, beta_rad: float, h_m: float
) -> tuple[Array, Array]:
    """Equation 15 less the camera's place: (X_D - x_cam, Y_D - y_cam) in m.

    ``x_im`` and ``y_im`` (px) from the middle, right and up; ``f`` in px; ``alpha_rad`` from the
    nadir. X goes to the west and Y to the north, ``beta_rad`` from north by east.
    """
    sin_a, cos_a, sin_b, cos_b = (
        np.sin(alpha_rad),
        np.cos(alpha_rad),
        np.sin(beta_rad),
        np.cos(beta_rad),
    )
    below = f * cos_a - y_im * sin_a
    ahead = f * h_m * sin_a + h_m * y_im * cos_a
    x = -(h_m * x_im * cos_b + ahead * sin_b) / below
    y = (-h_m * x_im * sin_b + ahead * cos_b) / below
    return x, y


def paper_position_error_m(east_m: float, north_m: float) -> float:
    """Equation 17."""
    return float(np.hypot(east_m, north_m))


def paper_height_error_m(
    x_im: Array, y_im: Array, f: float, depression_rad: float, height_error_m: float
) -> Array:
    """Equation 19: the derivative of Equation 15 by the camera's height, times its error.

    ``x_im`` and ``y_im`` in px from the middle, right and down, as in Equation 21.
    """
    x, y = paper_ground_offset(x_im, -y_im, f, np.pi / 2 - depression_rad, 0.0, 1.0)
    return np.asarray(height_error_m * np.hypot(x, y))


def paper_heading_error_m(
    x_im: Array, y_im: Array, f: float, depression_rad: float, h_m: float, heading_error_rad: float
) -> Array:
    """Equation 21, as printed."""
    sin_a, cos_a = np.sin(depression_rad), np.cos(depression_rad)
    below = (f * sin_a + y_im * cos_a) ** 2
    first = (f**2 * cos_a**2 - 2 * f * y_im * sin_a * cos_a) / below
    second = (x_im**2 + y_im**2 * sin_a**2) / below
    return np.asarray(heading_error_rad * h_m * np.sqrt(first + second))


@dataclass(frozen=True)
class GroundView:
    """Pixels of a camera over level ground, and how their ground points move.

    ``uv`` (N, 2); ``points_n`` (N, 3) NED from the camera, m, nan over the horizon and outside
    the lens model; ``by_pose`` (N, 2, 6) the derivative of north and east by the camera's position
    (NED, m) and attitude phi_n (rad); ``by_pixel`` (N, 2, 2) by column and row (m/px).
    """

    uv: Array
    points_n: Array
    by_pose: Array
    by_pixel: Array

    @classmethod
    def of(cls, camera: Camera, rotation_nc: Array, height_m: float, uv: Array) -> GroundView:
        """See pixels (N, 2) from a height over the ground, with an attitude (3, 3).

        With the ground point at d along the ray r, a pose that is off by dp and phi_n moves it by
        (I - r e3' / r3)(dp + phi x d): along the ground, since the ray meets it elsewhere.
        """
        rays_c = camera.rays(uv)
        rays_c = rays_c / rays_c[:, 2:]
        rays_n = rays_c @ rotation_nc.T
        with np.errstate(invalid="ignore"):
            rays_n[~(rays_n[:, _DOWN] > 0)] = np.nan
        way = height_m / rays_n[:, _DOWN]
        points_n = rays_n * way[:, None]
        along = np.zeros((len(uv), 2, 3))
        along[:, 0, 0] = along[:, 1, 1] = 1
        along[:, :, _DOWN] = -rays_n[:, :2] / rays_n[:, 2:]
        turned = np.stack([-skew(point) for point in np.eye(3)])  # phi x d = -[d x] phi
        by_attitude = along @ np.einsum("nk,kij->nij", points_n, turned)
        lens = np.linalg.inv(np.stack(camera.slopes(*rays_c[:, :2].T), -1).reshape(-1, 2, 2))
        by_pixel = along @ (way[:, None, None] * rotation_nc[:, :2]) @ lens
        return cls(uv, points_n, np.concatenate([along, by_attitude], axis=2), by_pixel)

    def covariance(
        self,
        pose_covariance: Array,
        *,
        lens_sigma_px: float = 0.0,
        ground_sigma_m: float = 0.0,
        latency_sigma_s: float = 0.0,
        rates: Array | None = None,
    ) -> Array:
        """(N, 2, 2) of the ground points' north and east, m2.

        ``pose_covariance`` (6, 6) position NED m2 and phi_n rad2; ``rates`` (6,) velocity (m/s)
        and turn rate (rad/s) of the camera, NED, along which an error of time acts.
        """
        covariance = np.array(pose_covariance, float)
        covariance[_DOWN, _DOWN] += ground_sigma_m**2
        if rates is not None:
            covariance += latency_sigma_s**2 * np.outer(rates, rates)
        by_pose = self.by_pose @ covariance @ self.by_pose.transpose(0, 2, 1)
        by_lens = self.by_pixel @ self.by_pixel.transpose(0, 2, 1)
        return np.asarray(by_pose + lens_sigma_px**2 * by_lens)


def looking(depression_rad: float, heading_rad: float = 0.0) -> Array:
    """``R_nc`` (3, 3) of a level camera that looks down by so much."""
    return np.asarray(matrix_from_euler(0.0, -depression_rad, heading_rad) @ BODY_OPTICAL)


def pixel_grid(camera: Camera, step_px: int) -> tuple[Array, tuple[int, int]]:
    """(N, 2) the middles of blocks of pixels over the whole picture, row by row, and the shape."""
    rows, columns = -(-camera.height // step_px), -(-camera.width // step_px)
    u = (np.arange(columns) + 0.5) * (camera.width / columns) - 0.5
    v = (np.arange(rows) + 0.5) * (camera.height / rows) - 0.5
    return np.stack(np.meshgrid(u, v), -1).reshape(-1, 2), (rows, columns)


def rms_m(covariance: Array) -> Array:
    """(N,) root mean square horizontal errors of covariances (N, 2, 2)."""
    return np.asarray(np.sqrt(np.trace(covariance, axis1=1, axis2=2)))

"""Render pictures of the painted ground through the true camera: its lens, blur and noise."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.types.arrays import Array, RawPixels
from tirgeo_ros.tools.simulate.ground import Ground
from tirgeo_ros.tools.simulate.relief import LEVEL, Relief
from tirgeo_ros.tools.simulate.scenario_ground import VideoScenario
from tirgeo_ros.tools.simulate.targets import Target, draw_targets

#: For 16 bits: a scene uses a small part of the range, as with a radiometric camera.
COUNTS_OF_0, COUNTS_PER_GREY = 20000.0, 16.0
_SKY = 20.0
_FAR_M = 2000.0

Floats = npt.NDArray[np.float32]


class Renderer:
    """Render frames; a frame depends only on its pose and its random generator."""

    def __init__(
        self,
        camera: Camera,
        ground: Ground,
        scenario: VideoScenario,
        targets: Sequence[Target] = (),
        relief: Relief = LEVEL,
    ) -> None:
        """Compute the ray of every pixel once; the targets stand on the ground."""
        self._shape = camera.height, camera.width
        self._targets = targets
        self._relief = relief
        self._ground = ground
        self._scenario = scenario
        v, u = np.mgrid[: camera.height, : camera.width]
        rays_c = camera.rays(np.stack([u.ravel(), v.ravel()], -1).astype(float))
        self._rays_c: Floats = rays_c.astype(np.float32)
        self._pixel_angle = 1 / min(camera.fx, camera.fy)
        off_axis = np.sum(self._rays_c[:, :2] ** 2, axis=1).reshape(self._shape)
        share = off_axis / off_axis.max()
        self._gain = (1 - scenario.vignetting * share).astype(np.float32)

    def frame(self, position_p: Array, q_pc: Array, rng: np.random.Generator) -> RawPixels:
        """Return a picture (h, w) of the ground from a pose (3,), (4,) in the plane ``p``."""
        rays_p = self._rays_c @ matrix_from_quat(q_pc).T.astype(np.float32)
        # Single precision is enough: 1e-5 m at some 100 m.
        place = position_p.astype(np.float32)
        height, loss = self._relief.met(place, rays_p)
        seen = loss > height / _FAR_M
        depth = np.asarray(height / np.where(seen, loss, np.float32(1)), np.float32)
        north = (place[0] + depth * rays_p[:, 0]).reshape(self._shape)
        east = (place[1] + depth * rays_p[:, 1]).reshape(self._shape)
        picture = self._sampled(north, east, self._footprints(depth, rays_p))
        draw_targets(picture, self._targets, north, east)
        picture[~seen.reshape(self._shape)] = _SKY
        return self._sensed(picture, rng)

    def _footprints(self, depth: Floats, rays_p: Floats) -> Floats:
        """Return a pixel's size on the ground in every row (h,), m: its sides' geometric mean."""
        middle = slice(self._shape[1] // 2, None, self._shape[1])
        across = depth[middle] * self._pixel_angle
        # Along the view a pixel is stretched by the cosecant of the depression angle.
        slope = rays_p[middle, 2] / np.linalg.norm(rays_p[middle], axis=1)
        return np.asarray(across / np.sqrt(np.maximum(slope, 1e-3)))

    def _sampled(self, north: Floats, east: Floats, footprint: Floats) -> Floats:
        """Sample the ground row by row, at the level whose cells have a pixel's size."""
        ground = self._ground
        levels = np.log2(np.maximum(footprint / ground.resolution_m, 1.0))
        levels = np.clip(np.floor(levels + 0.3), 0, len(ground.levels) - 1).astype(int)
        picture = np.empty(self._shape, np.float32)
        for level in np.unique(levels):
            rows = np.flatnonzero(levels == level)
            cell = ground.resolution_m * 2 ** int(level)
            column = (east[rows] - ground.west_edge_m) / cell - 0.5
            row = (ground.north_edge_m - north[rows]) / cell - 0.5
            picture[rows] = cv2.remap(
                ground.levels[level], column, row, cv2.INTER_LINEAR, None, cv2.BORDER_REFLECT
            )
        return picture

    def _sensed(self, picture: Floats, rng: np.random.Generator) -> RawPixels:
        """Apply optics and detector: blur, vignetting, noise, whole numbers."""
        scenario = self._scenario
        if scenario.blur_px > 0:
            cv2.GaussianBlur(picture, (0, 0), scenario.blur_px, dst=picture)
        picture = picture * self._gain
        picture += scenario.noise_grey * rng.standard_normal(self._shape, np.float32)
        if scenario.bits == 16:
            counts = COUNTS_OF_0 + COUNTS_PER_GREY * picture
            return np.asarray(np.clip(np.rint(counts), 0, 65535), np.uint16)
        return np.asarray(np.clip(np.rint(picture), 0, 255), np.uint8)

"""Define a picture of a flight with all that a product needs of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.poses import BodyPose, CameraPose


@dataclass(frozen=True)
class ExportFrame:
    """Hold a picture as recorded, where the camera was, and the ground below."""

    number: int  # of the picture in the flight, from 0
    stamp_ns: int  # of the picture's header
    pixels: Pixels  # (h, w) 8 or 16 bits, or (h, w, 3) BGR
    camera: Camera
    pose: CameraPose  # at the time of exposure
    body: BodyPose  # at the time of exposure
    plane: TangentPlane
    ground: Ground | None


class Product(Protocol):
    """Define a product of a flight: it takes the frames in order, then writes its files."""

    def take(self, frame: ExportFrame) -> None:
        """Take the next frame."""

    def finish(self) -> dict[str, object]:
        """Write what is left; return what was made, for the summary."""

    def close(self) -> None:
        """Remove what is not finished."""

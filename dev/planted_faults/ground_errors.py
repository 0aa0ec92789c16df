"""How far from the truth a picture's pixels are located, in units of their ellipses."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dev.planted_faults.planting import FlightFiles
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import CHI2_95, CameraRates
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import Miss, PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.ground_point import Located, place
from tirgeo_ros.core.streams.arrivals import exposure_ns
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.tools.replay.graph_outputs import read_outputs
from tirgeo_ros.tools.replay.node_configs import node_configs

_WHOLE_FLIGHT_S = 1e9
_RATES_NS = 100_000_000
#: Of the picture's width and height: the middle, and a quarter from the edges.
_PLACES = ((0.5, 0.5), (0.25, 0.5), (0.75, 0.5), (0.5, 0.75))


@dataclass
class Eye:
    """What locates pixels: poses of a bag, a lens, a latency and a ground."""

    poses: PoseBuffer[CameraPose]
    plane: TangentPlane
    camera: Camera
    ground: Ground
    config: OverlayConfig

    def locate(self, stamp_ns: int, uv: tuple[float, float]) -> Located | None:
        """Return the place at a pixel of a picture; None where there is none."""
        exposed_ns = exposure_ns(stamp_ns, self.config.video_latency_s)
        pose, before = self.poses.at(exposed_ns), self.poses.at(exposed_ns - _RATES_NS)
        if isinstance(pose, Miss):
            return None
        rates = None if isinstance(before, Miss) else CameraRates.between(before, pose)
        found = place(
            self.camera, pose, uv, self.plane, self.ground, self.config.confidence, rates
        )
        return found if isinstance(found, Located) else None


def eye_of(poses_bag: Path, camera: Camera, ground: Ground, config: OverlayConfig) -> Eye | None:
    """Return the eye of a bag with camera poses; None where it has none."""
    outputs = read_outputs(poses_bag)
    if outputs.plane is None or not outputs.cameras:
        return None
    poses: PoseBuffer[CameraPose] = PoseBuffer(_WHOLE_FLIGHT_S)
    for pose in outputs.cameras:
        poses.add(pose)
    return Eye(poses, outputs.plane, camera, ground, config)


def camera_of(bag: Path) -> Camera | None:
    """Return the first calibration in a bag; None where it has none."""
    for item in BagReader(bag).messages(["/thermal/camera_info"]):
        return convert.camera(Cdr().deserialize(item.data, item.typename))
    return None


def times_of_ellipse(
    believed: Eye,
    true: Eye,
    stamp_ns: int,
    true_ns: int | None = None,
    flipped: Sequence[int] = (),
) -> float:
    """Return the largest error of a picture's pixels over its ellipse; nan: none is located.

    1 is on the ellipse of 95 %. A pixel that the truth has nowhere counts as infinitely wrong.
    ``true_ns``: the picture's stamp in the good flight; ``flipped``: its axes, 0 down, 1 across.
    """
    true_ns = stamp_ns if true_ns is None else true_ns
    size = true.camera.width - 1, true.camera.height - 1
    worst = math.nan
    for across, down in _PLACES:
        uv = across * size[0], down * size[1]
        told = believed.locate(stamp_ns, uv)
        if told is None:
            continue
        was = (
            size[0] - uv[0] if 1 in flipped else uv[0],
            size[1] - uv[1] if 0 in flipped else uv[1],
        )
        actual = true.locate(true_ns, was)
        times = math.inf if actual is None else _times(told, actual, believed.plane)
        worst = times if math.isnan(worst) else max(worst, times)
    return worst


def eyes_of(good: FlightFiles, planted: FlightFiles, poses: Path) -> tuple[Eye, Eye] | None:
    """Return how poses of a planted flight locate pixels, and how they lie in truth; or None."""
    believed, true = _eye(planted, poses), _eye(good, good.bag.with_name("truth.mcap"))
    return (believed, true) if believed and true else None


def _eye(flight: FlightFiles, poses: Path) -> Eye | None:
    overlay = node_configs(flight.params, dem=flight.options.get("dem")).overlay
    camera, ground = camera_of(flight.bag), ground_of(overlay)
    return None if camera is None or ground is None else eye_of(poses, camera, ground, overlay)


def flight_times(
    good: FlightFiles, planted: FlightFiles, poses: Path, flipped: Sequence[int]
) -> list[float]:
    """Return the times of the ellipse of all pictures that are located."""
    eyes = eyes_of(good, planted, poses)
    if eyes is None:
        return []
    stamps = zip(_picture_stamps_ns(planted.bag), _picture_stamps_ns(good.bag), strict=True)
    times = [times_of_ellipse(*eyes, told, actual, flipped) for told, actual in stamps]
    return [one for one in times if not math.isnan(one)]


def _picture_stamps_ns(bag: Path) -> list[int]:
    items = BagReader(bag).messages(["/thermal/image_raw/compressed"])
    return [header_stamp_ns(item.data) for item in items]


def _times(told: Located, actual: Located, plane: TangentPlane) -> float:
    place_n = plane.ned_from_geodetic(actual.latitude_rad, actual.longitude_rad, actual.height_m)
    off = (told.point_n - place_n)[:2]
    squared = float(off @ np.linalg.solve(told.covariance_n[:2, :2], off))
    return math.sqrt(squared / CHI2_95)

"""The overlay on thermal pictures of a folder, in every palette, to be looked at on one sheet.

``python -m dev.contact_sheet FOLDER -o sheet.png`` draws a made-up map on each
picture with the XT2's lens, from the height and the depression that are given, or that the names
tell as those of the HIT-UAV data set do (``..._<altitude m>_<depression deg>_<weather>_<index>``).
Each picture is as wide on the sheet as on a phone.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from tirgeo_ros.core.camera.camera_model import XT2, Camera
from tirgeo_ros.core.config.overlay_parameters import PALETTES, OverlayConfig
from tirgeo_ros.core.frames.axes import BODY_OPTICAL
from tirgeo_ros.core.frames.rotations import quat_from_matrix, rotation_y, rotation_z
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import locate
from tirgeo_ros.core.map.map_layers import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.types.arrays import Array, Pixels
from tirgeo_ros.core.types.errors import TirgeoError, VideoError
from tirgeo_ros.core.types.measurements import FixStatus
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.core.types.verdicts import FilterState, NavigationStatus
from tirgeo_ros.io.files.encoded_picture import MOST_OF_FILE, unpacked

PHONE_PX = 360
_PLANE = TangentPlane(0.6955, 2.0368, 11.5)
_GROUND_M = 11.5
_HEADING = math.radians(25.0)
#: Standard deviations of position (m) and of roll, pitch, yaw (rad) that RTK and a gimbal leave.
_SIGMA_M = 0.03
_SIGMA_RAD = np.radians([0.2, 0.2, 0.4])
_STATUS = NavigationStatus("ekf_heading", FilterState.RUNNING, "", FixStatus.FIXED, 0.004, {}, {})
_NAME = re.compile(r"_(\d+)_(\d+)_\d+_\d+$")
_SUFFIXES = {".jpg", ".jpeg", ".png", ".tif", ".tiff"}
_FRAME_NS = 100_000_000
_NAMES = "Linde", "\u00c9rable", "\u6a31\u82b1", "Eiche", "\u0414\u0443\u0431", ""  # of trees
_YELLOW, _CYAN, _GREEN, _ORANGE = (0, 255, 255), (255, 220, 60), (90, 230, 60), (40, 150, 255)


def contact_sheet(
    folder: Path, height_m: float, depression_deg: float, singles: Path | None = None
) -> Pixels:
    """The sheet (h, w, 3) BGR: a row for a picture, a column for a palette.

    ``singles`` is a folder for the pictures in their own size. Raises VideoError where no picture
    can be read.
    """
    rows = []
    paths = sorted(path for path in folder.glob("*") if path.suffix.lower() in _SUFFIXES)
    if not paths:
        raise VideoError(f"{folder}: no pictures (JPEG, PNG, TIFF) in this folder")
    for path in paths:
        told = _NAME.search(path.stem)
        pose_of = (float(told[1]), float(told[2])) if told else (height_m, depression_deg)
        drawn = list(_in_palettes(path, *pose_of))
        for palette, image in zip(PALETTES, drawn, strict=True):
            if singles is not None:
                _write(singles / f"{path.stem}_{palette}.png", image)
        size = PHONE_PX, round(drawn[0].shape[0] * PHONE_PX / drawn[0].shape[1])
        on_phone = [cv2.resize(image, size, interpolation=cv2.INTER_AREA) for image in drawn]
        rows.append(np.hstack(on_phone))
    width = max(row.shape[1] for row in rows)
    padded = [np.pad(row, ((0, 4), (0, width - row.shape[1]), (0, 0))) for row in rows]
    return np.asarray(np.vstack(padded), np.uint8)


def _in_palettes(path: Path, height_m: float, depression_deg: float) -> Iterator[Pixels]:
    try:
        picture = unpacked(path.read_bytes(), cv2.IMREAD_ANYDEPTH, MOST_OF_FILE)
    except (OSError, ValueError) as error:
        raise VideoError(f"{path}: {error}") from None
    if picture is None:
        raise VideoError(f"{path}: not a picture that can be read")
    camera = _scaled(XT2, picture.shape[1], picture.shape[0])
    attitude = rotation_z(_HEADING) @ rotation_y(-math.radians(depression_deg)) @ BODY_OPTICAL
    sigmas = np.concatenate([np.full(3, _SIGMA_M), _SIGMA_RAD])
    place_n = np.array([0.0, 0.0, -height_m])
    pose = CameraPose(0, place_n, quat_from_matrix(attitude), np.diag(sigmas**2))
    layers = _map(camera, pose)
    for palette in PALETTES:
        config = OverlayConfig(palette=palette, ground_height_m=_GROUND_M, video_latency_s=0.0)
        yield _drawn(Overlay(config, layers), camera, pose, np.asarray(picture))


def _drawn(
    overlay: Overlay, camera: Camera, pose: CameraPose, picture: npt.NDArray[np.uint8]
) -> Pixels:
    """The second of two frames: by then there is a rate to be shown."""
    overlay.set_plane(_PLANE)
    overlay.set_camera(camera)
    overlay.set_status(_STATUS)
    image = picture
    for stamp_ns in (_FRAME_NS, 2 * _FRAME_NS):
        overlay.add_pose(replace(pose, stamp_ns=stamp_ns))
        overlay.add_frame(stamp_ns, picture, stamp_ns)
        result = overlay.take(stamp_ns + _FRAME_NS // 3)
        assert result is not None  # its pose is there
        image = result.image
    return image


def _scaled(camera: Camera, width: int, height: int) -> Camera:
    across, down = width / camera.width, height / camera.height
    return Camera(
        width,
        height,
        camera.fx * across,
        camera.fy * down,
        (camera.cx + 0.5) * across - 0.5,
        (camera.cy + 0.5) * down - 0.5,
        camera.distortion,
    )


def _map(camera: Camera, pose: CameraPose) -> list[MapLayer]:
    """Parcels, ways and trees on the ground that is seen, sized to be seen well in its middle."""
    places = np.array([[0.5, 0.5], [0.65, 0.5]]) * [camera.width, camera.height]
    points, reasons = locate(camera, pose, places, _PLANE, _GROUND_M)
    if reasons[0] is not None:
        raise VideoError(f"the camera looks at no ground ({reasons[0].value}); point it lower")
    middle, unit_m = points[0, :2], float(np.linalg.norm(points[1] - points[0]))
    trees = np.random.default_rng(7).uniform([-3, -4], [4, 4], (24, 2))
    corners = np.array([[-0.4, -0.4], [-0.4, 0.4], [0.4, 0.4], [0.4, -0.4]])
    parcels = {
        "Gr\u00fcnfl\u00e4che 1": (0.5, 0.5),
        "Rosenbeet": (0.5, -0.6),
        "Wiese": (-0.6, 0.5),
        "Beet 12": (1.6, 0.5),
    }
    along = np.linspace(-5, 6, 60)
    ways = {
        "Hauptweg": np.stack([along, 0.35 * np.sin(1.3 * along) - 0.05], -1),
        "Querweg": np.stack([0.15 * np.sin(along) - 0.05, along], -1),
    }
    fence = np.array([[-1.6, -1.8], [-1.6, 1.6], [2.6, 1.9], [2.9, -1.5]])

    def feature(label: str, places: Array, *, closed: bool = False) -> GeoFeature:
        return _feature(label, middle + unit_m * places, closed=closed)

    beds = [feature(name, corners + place, closed=True) for name, place in parcels.items()]
    marks = [feature(_NAMES[i % len(_NAMES)], tree[None]) for i, tree in enumerate(trees)]
    return [
        MapLayer("beds", beds, LayerStyle(_GREEN, 1, _GREEN, 0.25)),
        MapLayer("ways", [feature(*way) for way in ways.items()], LayerStyle(_ORANGE, 3)),
        MapLayer("fence", [feature("Park", fence, closed=True)], LayerStyle(_CYAN, 1)),
        MapLayer("trees", marks, LayerStyle(_YELLOW, 1), sigma_m=0.3),
    ]


def _feature(label: str, places_n: Array, *, closed: bool = False) -> GeoFeature:
    down = np.zeros(len(places_n))
    geodetic = _PLANE.geodetic_from_ned(np.column_stack([places_n, down]))
    return GeoFeature(label, closed, np.stack(geodetic, -1))


def _write(path: Path, image: Pixels) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    done, data = cv2.imencode(path.suffix or ".png", image)
    if not done:
        raise VideoError(f"{path}: this kind of picture cannot be written; use .png")
    path.write_bytes(data.tobytes())


def main(arguments: Sequence[str] | None = None) -> int:
    """Make a sheet; the exit code."""
    parser = argparse.ArgumentParser(prog="contact_sheet", description=__doc__)
    parser.add_argument("folder", type=Path, help="thermal pictures")
    parser.add_argument("-o", "--output", type=Path, required=True, help="the sheet (PNG)")
    parser.add_argument("--singles", type=Path, help="folder for the pictures in full size")
    parser.add_argument("--height", type=float, default=60.0, help="above ground, m")
    parser.add_argument("--depression", type=float, default=40.0, help="of the camera, deg")
    asked = parser.parse_args(arguments)
    try:
        sheet = contact_sheet(asked.folder, asked.height, asked.depression, asked.singles)
        _write(asked.output, sheet)
    except (TirgeoError, OSError) as error:
        sys.stderr.write(f"contact_sheet: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())

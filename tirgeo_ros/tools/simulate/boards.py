"""Write pictures and a video of a thermal checkerboard for ``tirgeo calibrate lens``, ``gimbal``.

``python -m tirgeo_ros.tools.simulate.boards -o boards`` writes ``lens/``, pictures as for a lens
calibration; ``wall.mcap``, a video of a board on a wall while the aircraft yaws to and fro (Ren et
al. 2022, section 5.2); and ``wall.csv``, the camera's true angles in it.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from tirgeo_ros.core.calibration.checkerboard.board import Checkerboard
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError, TirgeoError
from tirgeo_ros.io.bags.bag import BagWriter, Cdr
from tirgeo_ros.io.files.whole_files import csv_text, made_folder
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent
from tirgeo_ros.tools.simulate.board import BoardLook, BoardRenderer, board_views, gimbal_pose
from tirgeo_ros.tools.simulate.gimbal import ERROR_TIME_S
from tirgeo_ros.tools.simulate.processes import generator, scaled_noise
from tirgeo_ros.tools.simulate.scenario import Scenario

BOARD = Checkerboard(9, 6, 0.1)
RATE_HZ = 10.0  # of the video's pictures, as the paper took from its own
#: The camera follows the airframe, which is turned to and fro by hand: Table 8's standard
#: deviation.
YAW_STD_DEG, YAW_PERIOD_S = 13.8857, 6.0
_DISTANCE_M, _FOLLOWED = 2.2, 0.7  # so that the board stays in the picture


def camera_angles(times_s: Array, duration_s: float, seed: int) -> Array:
    """Return the camera's roll, pitch, yaw relative to the wall (n, 3), rad.

    Roll and pitch drift as for the camera of a simulated flight (Table 8); yaw oscillates.
    """
    rms = np.radians(Scenario().gimbal.error_rms_deg)
    wander = scaled_noise(generator(seed, "gimbal"), duration_s, ERROR_TIME_S, rms)
    swing = math.sqrt(2) * math.radians(YAW_STD_DEG)
    yaw = swing * np.sin(2 * np.pi * times_s / YAW_PERIOD_S)
    return np.column_stack([wander(times_s), yaw])


def write_wall(path: Path, duration_s: float, seed: int, progress: Report = silent) -> Array:
    """Write the video; return the true angles (n, 3), rad, of its pictures. Raise BagError."""
    times_s = np.arange(round(duration_s * RATE_HZ)) / RATE_HZ
    angles = camera_angles(times_s, duration_s, seed)
    messages, draw = Messages(Cdr().types), BoardRenderer(XT2, BOARD)
    with BagWriter(path) as bag:
        for number, rpy in enumerate(angles):
            progress(number / RATE_HZ, duration_s)
            stamp_ns = Scenario().start_ns + round(number * 1e9 / RATE_HZ)
            pose = gimbal_pose(BOARD, rpy, _DISTANCE_M, _FOLLOWED)
            view = draw.view(*pose, BoardLook(), generator(seed, f"picture {number}"))
            for topic, message in (
                ("thermal/camera_info", messages.camera_info(XT2, stamp_ns)),
                ("thermal/image_raw", messages.image(stamp_ns, view.image)),
            ):
                bag.write(f"/{topic}", TOPIC_TYPES[topic], message, stamp_ns)
    return angles


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command's arguments."""
    made = argparse.ArgumentParser(
        prog="python -m tirgeo_ros.tools.simulate.boards", description=__doc__
    )
    made.add_argument("-o", "--output", type=Path, metavar="DIR", required=True)
    made.add_argument("--views", type=int, default=40, metavar="N", help="default: %(default)s")
    made.add_argument("--seconds", type=float, default=30.0, metavar="S", help="of video")
    made.add_argument("--seed", type=int, default=2205, metavar="N", help="default: %(default)s")
    return made


def run(args: argparse.Namespace) -> dict[str, object]:
    """Write all files; ``angles_std_deg`` in the result is the truth of the video."""
    if not (args.views >= 1 and 1 <= args.seconds <= 3600 and args.seed >= 0):
        raise CalibrationError("--views must be 1 or more, --seconds 1 to 3600, --seed 0 or more")
    lens = made_folder(args.output / "lens", CalibrationError)
    wall, angles_csv = args.output / "wall.mcap", args.output / "wall.csv"
    for number, view in enumerate(board_views(XT2, BOARD, args.views, args.seed), 1):
        _, data = cv2.imencode(".png", view.image)
        (lens / f"view_{number:02d}.png").write_bytes(data.tobytes())
    with Progress("rendering", unit="s") as bar:
        angles = write_wall(wall, args.seconds, args.seed, bar)
    rows = [
        [f"{number / RATE_HZ:.3f}", *(f"{angle:.5f}" for angle in rpy)]
        for number, rpy in enumerate(np.degrees(angles).tolist())
    ]
    text = csv_text([["time_s", "roll_deg", "pitch_deg", "yaw_deg"], *rows])
    angles_csv.write_text(text, encoding="utf-8")
    std = np.degrees(angles.std(0, ddof=1)).tolist()
    return {
        "output": [str(lens), str(wall), str(angles_csv)],
        "views": args.views,
        "angles_std_deg": dict(zip(("roll", "pitch", "yaw"), std, strict=True)),
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command."""
    try:
        found = run(parser().parse_args(argv))
    except (TirgeoError, OSError) as error:
        sys.exit(f"boards: {error}")
    sys.stdout.write("\n".join([*found["output"], ""]))  # type: ignore[misc]


if __name__ == "__main__":
    main()

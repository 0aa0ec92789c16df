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
"""Measure how still a gimbal holds its camera, from a video of a fixed checkerboard.

This is the work of ``tirgeo calibrate gimbal`` (Ren et al. 2022, section 5.2, Table 8).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.calibration.board_detection import find_board
from tirgeo_ros.core.calibration.checkerboard import (
    BoardSighting,
    BoardTracker,
    Checkerboard,
    RefusalReason,
    Refused,
    camera_angles,
)
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, csv_text
from tirgeo_ros.io.pictures.camera_file import load_camera
from tirgeo_ros.tools.calibrate.board_pictures import (
    UNREADABLE,
    Picture,
    opened,
    pictures_of_files,
    thinned,
)
from tirgeo_ros.tools.calibrate.lens import reasons
from tirgeo_ros.tools.calibrate.result import written
from tirgeo_ros.tools.presentation.progress import Report, silent

AXES = ("roll", "pitch", "yaw")
_FEWEST = 10  # pictures with the board that are needed
#: With more than this share of pictures without a board, the numbers may not represent the video.
_MANY_LOST = 0.2
#: Share of an axis's standard deviation from the picture's noise that causes a warning.
_NOISY = 0.5
_MOST_RMS_PX = 1.5  # a pose with a larger reprojection error is refused


class BoardAttitudes(NamedTuple):
    """Hold a camera's attitudes relative to a fixed board, over N pictures."""

    names: list[str]
    times_s: Array  # (N,) since the first picture
    angles_deg: Array  # (N, 3) roll, pitch, yaw, unwrapped
    sigmas_deg: Array  # (N, 3) standard deviations from the picture's noise
    rms_px: Array  # (N,) reprojection errors


def calibrate_gimbal(
    inputs: Sequence[Path],
    board: Checkerboard,
    *,
    camera: PathLike | None = None,
    rate_hz: float = 10.0,
    output: PathLike | None = None,
    namespace: str = "",
    progress: Report = silent,
) -> dict[str, object]:
    """Measure the standard deviation of a camera's roll, pitch and yaw; return a summary.

    ``inputs`` is a bag, from which ``rate_hz`` pictures a second are used, or pictures that were
    taken at this rate. ``camera`` is a calibration file; None: the bag's camera. Write the time
    series (CSV) to ``output``, if given. Raise CalibrationError, CameraError, BagError.
    """
    paths, video = opened(inputs, namespace)
    check_outputs((*paths, camera), (output,), CalibrationError)
    needed("scipy", "fitting the board's corners", CalibrationError)
    if video is not None:
        pictures = thinned(video.pictures(progress), rate_hz)
        lens = video.camera() if camera is None else load_camera(camera)
    elif camera is not None:
        pictures = (
            picture._replace(stamp_ns=round(number * 1e9 / rate_hz))
            for number, picture in enumerate(pictures_of_files(paths, progress))
        )
        lens = load_camera(camera)
    else:
        raise CalibrationError("gimbal: picture files have no camera calibration; give --camera")
    attitudes, lost = _attitudes(pictures, board, lens)
    files = [(output, lambda: _csv(attitudes))]
    return written(files, _summary(attitudes, lost), video.reader if video else None)


def _attitudes(
    pictures: Iterator[Picture], board: Checkerboard, camera: Camera
) -> tuple[BoardAttitudes, dict[str, Refused]]:
    """Return the camera's attitude in each picture with the board, and the refused pictures.

    Raise CalibrationError for pictures of another size than the calibration's, or too few.
    """
    tracker = BoardTracker(board, camera)
    lost: dict[str, Refused] = {}
    rows: list[tuple[str, int, Array, Array, float]] = []
    for name, stamp_ns, pixels in pictures:
        if pixels is None or stamp_ns is None:
            lost[name] = UNREADABLE
            continue
        if pixels.shape[:2] != (camera.height, camera.width):
            raise CalibrationError(
                f"{name}: the picture has {pixels.shape[1]}x{pixels.shape[0]} pixels, the "
                f"camera's calibration {camera.width}x{camera.height}; give the calibration of "
                "these pictures"
            )
        detected = find_board(pixels, board)
        if isinstance(detected, BoardSighting):
            pose = tracker.pose(detected)
            if pose is not None and pose.rms_px <= _MOST_RMS_PX:
                rows.append((name, stamp_ns, *camera_angles(pose), pose.rms_px))
                continue
            error = "no pose" if pose is None else f"error {pose.rms_px:.1f} px"
            detected = Refused(RefusalReason.OUTLIER, f"{error} with this camera's calibration")
        lost[name] = detected
    if len(rows) < _FEWEST:
        raise CalibrationError(
            f"gimbal: {len(rows)} pictures of {len(lost) + len(rows)} show the board, {_FEWEST} "
            f"are needed: {reasons(lost) or 'record a longer video'}"
        )
    names, stamps_ns, angles, sigmas, errors = zip(*rows, strict=True)
    return BoardAttitudes(
        [*names],
        (np.array(stamps_ns) - stamps_ns[0]) * 1e-9,
        np.degrees(np.unwrap(angles, axis=0)),
        np.degrees(sigmas),
        np.array(errors),
    ), lost


def _summary(attitudes: BoardAttitudes, lost: Mapping[str, Refused]) -> dict[str, object]:
    total = len(attitudes.names) + len(lost)
    std = attitudes.angles_deg.std(0, ddof=1)
    noise = np.sqrt((attitudes.sigmas_deg**2).mean(0))
    columns = {
        "std_deg": std,
        "noise_deg": noise,
        "std_without_noise_deg": np.sqrt(np.maximum(std**2 - noise**2, 0.0)),
    }
    notes = []
    if len(lost) > _MANY_LOST * total:
        notes.append(f"{len(lost)} of {total} pictures are not used: {reasons(lost)}")
    noisy = [AXES[k] for k in np.flatnonzero(noise > _NOISY * std)]
    if noisy:
        notes.append(
            f"much of the standard deviation of {' and '.join(noisy)} comes from the picture's "
            "noise: let the board fill more of the picture, and view it at an angle"
        )
    return {
        "pictures": total,
        "used": len(attitudes.names),
        "duration_s": float(attitudes.times_s[-1]),
        **{key: dict(zip(AXES, v.tolist(), strict=True)) for key, v in columns.items()},
        "reprojection_rms_px": float(np.sqrt((attitudes.rms_px**2).mean())),
        "refused": {name: str(why) for name, why in lost.items()},
        "warning": "; ".join(notes) or None,
    }


def _csv(attitudes: BoardAttitudes) -> str:
    """Return CSV, a line per picture: time, angles and their sigmas in degrees, error in px."""
    names = [f"{axis}_deg" for axis in AXES] + [f"sigma_{axis}_deg" for axis in AXES]
    _, times_s, *numbers, rms_px = attitudes
    rows = [
        [name, f"{time_s:.3f}", *(f"{angle:.4f}" for angle in row), f"{rms:.3f}"]
        for name, time_s, row, rms in zip(
            attitudes.names, times_s, np.hstack(numbers).tolist(), rms_px, strict=True
        )
    ]
    return csv_text([["picture", "time_s", *names, "rms_px"], *rows])

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
"""Calibrate a lens from pictures of a checkerboard: the work of ``tirgeo calibrate lens``."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np

from tirgeo_ros.core.calibration.board_detection import find_board
from tirgeo_ros.core.calibration.checkerboard import (
    BoardSighting,
    Checkerboard,
    RefusalReason,
    Refused,
)
from tirgeo_ros.core.calibration.lens_fit import LensFit, doubtful_views, fit_lens, most_distinct
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.pictures.camera_file import camera_yaml
from tirgeo_ros.tools.calibrate.board_pictures import (
    UNREADABLE,
    Picture,
    opened,
    pictures_of_files,
    sharpest,
)
from tirgeo_ros.tools.calibrate.result import written
from tirgeo_ros.tools.presentation.plots import COLOURS, arrows, figure, png
from tirgeo_ros.tools.presentation.progress import Report, silent

_MOST_VIEWS = 60  # a fit takes the most different views, up to this number
_EVERY_S = 0.5  # the sharpest picture in each interval of a video is used
_CELLS = (8, 6)  # cells of the picture; a good set of views has corners in most of them
#: A smaller number of views, share of cells covered, or largest tilt causes a warning.
_FEW_VIEWS, _LEAST_COVERED, _LOW_TILT_DEG = 10, 0.7, 15.0
_ARROW = 0.02  # length of the arrow of an rms error, as a share of the picture's width


def calibrate_lens(
    inputs: Sequence[Path],
    board: Checkerboard,
    output: PathLike,
    *,
    k3: bool = False,
    plot: PathLike | None = None,
    namespace: str = "",
    progress: Report = silent,
) -> dict[str, object]:
    """Calibrate from pictures, folders of pictures, or a bag; return a summary.

    Write a calibration file and, if asked, a plot of its views and errors: both or none. Raise
    CalibrationError, BagError.
    """
    paths, video = opened(inputs, namespace)
    check_outputs(paths, (output, plot), CalibrationError)
    needed("scipy", "fitting the board's corners", CalibrationError)
    if plot is not None:
        needed("matplotlib", f"drawing {plot}", CalibrationError)
    if video is None:
        pictures = pictures_of_files(paths, progress)
    else:
        pictures = sharpest(video.pictures(progress), _EVERY_S)
    views, refused, size = _sightings(pictures, board)
    number = len(views) + len(refused)
    if not views:
        none = f"no picture of {number} can be used: {reasons(refused)}"
        raise CalibrationError(f"lens: {none if number else 'there are no pictures'}")
    chosen = sorted(most_distinct(views, _MOST_VIEWS), key=list(views).index)
    fit = fit_lens({name: views[name] for name in chosen}, board, size, with_k3=k3)
    numbers = {
        "pictures": number,
        "views_spare": len(views) - len(chosen),
        **_summary(fit, views),
        "refused": {name: str(why) for name, why in (refused | fit.refused).items()},
    }
    files = (
        (output, lambda: camera_yaml(fit.camera, "thermal")),
        (plot, lambda: lens_png(fit, views)),
    )
    return written(files, numbers, video.reader if video else None)


def _sightings(
    pictures: Iterator[Picture], board: Checkerboard
) -> tuple[dict[str, BoardSighting], dict[str, Refused], tuple[int, int]]:
    """Return the detected boards, the refused pictures, and the pictures' (width, height).

    Refuse pictures of another size than most, and blurred or repeated views.
    """
    views: dict[str, BoardSighting] = {}
    refused: dict[str, Refused] = {}
    sizes: dict[str, tuple[int, int]] = {}
    for name, _, pixels in pictures:
        detected = UNREADABLE if pixels is None else find_board(pixels, board)
        if isinstance(detected, Refused):
            refused[name] = detected
        elif pixels is not None:
            views[name], sizes[name] = detected, (pixels.shape[1], pixels.shape[0])
    size = Counter(sizes.values()).most_common(1)[0][0] if sizes else (0, 0)
    for name, (width, height) in sizes.items():
        if (width, height) != size:
            refused[name] = Refused(RefusalReason.OTHER_SIZE, f"{width}x{height} pixels")
            del views[name]
    refused |= doubtful_views(views, size[0])
    return {name: view for name, view in views.items() if name not in refused}, refused, size


def reasons(refused: Mapping[str, Refused]) -> str:
    """Return the reasons of refused pictures: ``12 x no board, 3 x blurred``."""
    counts = Counter(why.reason.value for why in refused.values())
    return ", ".join(f"{number} x {reason}" for reason, number in counts.most_common())


def _summary(fit: LensFit, views: Mapping[str, BoardSighting]) -> dict[str, object]:
    size = np.array([fit.camera.width, fit.camera.height])
    corners = np.concatenate([views[name].corners_px for name in fit.errors_px])
    cells = np.floor((corners + 0.5) / size * _CELLS).astype(int).clip(0, np.array(_CELLS) - 1)
    covered = len(np.unique(cells, axis=0)) / (_CELLS[0] * _CELLS[1])
    number, tilt_deg = len(fit.errors_px), float(np.degrees(fit.tilt_rad))
    notes = {
        f"{number} views are too few: take 20": number < _FEW_VIEWS,
        f"the views cover {100 * covered:.0f} % of the picture: take some at its edges and "
        "corners": covered < _LEAST_COVERED,
        f"the board is tilted by {tilt_deg:.0f} deg at most: tilt it by 20 to 45 deg, in all "
        "directions": tilt_deg < _LOW_TILT_DEG,
    }
    return {
        "views": number,
        "image_size": size.tolist(),
        "parameters": dict(zip(fit.names, fit.values.tolist(), strict=True)),
        "sigma": dict(zip(fit.names, fit.sigma.tolist(), strict=True)),
        "covariance": fit.covariance,
        "reprojection_rms_px": fit.rms_px,
        "covered_share": covered,
        "tilt_deg": tilt_deg,
        "view_rms_px": fit.view_rms_px,
        "warning": "; ".join(note for note, is_so in notes.items() if is_so) or None,
    }


def lens_png(fit: LensFit, views: Mapping[str, BoardSighting]) -> bytes:
    """Return a PNG of all corners in the frame, with their errors enlarged."""
    chart, frame = figure(8.0, 6.8)
    width, height = fit.camera.width, fit.camera.height
    scale = _ARROW * width / max(fit.rms_px, 1e-3)
    for number, (name, errors) in enumerate(fit.errors_px.items()):
        colour = COLOURS[number % len(COLOURS)]
        corners = views[name].corners_px
        frame.plot(*corners.T, ".", color=colour, markersize=3)
        arrows(frame, corners, scale * errors, colour, 0.0012)
    frame.plot(fit.camera.cx, fit.camera.cy, "k+", markersize=12, label="principal point")
    frame.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
    frame.set(xlabel="column, px", ylabel="row, px")
    frame.set_title(f"Corners of {len(fit.errors_px)} views, errors enlarged {scale:.0f} times")
    frame.legend(loc="lower right", frameon=True)
    return png(chart)

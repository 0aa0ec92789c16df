"""Calibrate a lens from pictures of a checkerboard: the work of ``tirgeo calibrate lens``."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tirgeo_ros.core.calibration.checkerboard.board import (
    BoardSighting,
    Checkerboard,
    RefusalReason,
    Refused,
)
from tirgeo_ros.core.calibration.checkerboard.detection import find_board
from tirgeo_ros.core.calibration.checkerboard.lens_fit import LensFit, LensModel, fit_lens
from tirgeo_ros.core.calibration.checkerboard.view_selection import doubtful_views, most_distinct
from tirgeo_ros.core.types.errors import CalibrationError
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs, write_files
from tirgeo_ros.io.pictures.camera_file import camera_yaml
from tirgeo_ros.tools.calibrate.board_pictures import (
    BoardVideo,
    Taken,
    files_of,
    is_bag,
    pictures_of_files,
    sharpest,
)
from tirgeo_ros.tools.calibrate.residual_plots import lens_png
from tirgeo_ros.tools.presentation.progress import Report, silent

_CELLS = (8, 6)  # cells of the picture; a good set of views has corners in most of them
_FEW_VIEWS = 10
_LEAST_COVERED = 0.7
_LOW_TILT_DEG = 15.0
_LOOSE = 0.5  # largest ratio of a coefficient's standard deviation to its value


@dataclass
class BoardSightings:
    """Hold the boards that were seen in pictures, and why the other pictures were refused."""

    views: dict[str, BoardSighting] = field(default_factory=dict)
    refused: dict[str, Refused] = field(default_factory=dict)
    size: tuple[int, int] = (0, 0)  # width, height of most pictures

    @property
    def pictures(self) -> int:
        """Return the number of pictures."""
        return len(self.views) + len(self.refused)

    @property
    def reasons_by_name(self) -> dict[str, str]:
        """Return why each of the other pictures was refused."""
        return {name: f"{why.reason.value}: {why.detail}" for name, why in self.refused.items()}

    def leave(self, refused: dict[str, Refused]) -> None:
        """Move views to the refused pictures."""
        for name, why in refused.items():
            del self.views[name]
            self.refused[name] = why


def sightings_in(pictures: Iterator[Taken], board: Checkerboard) -> BoardSightings:
    """Look for the board in every picture; refuse pictures of another size than most."""
    seen = BoardSightings()
    sizes: dict[str, tuple[int, int]] = {}
    for name, _, pixels in pictures:
        if pixels is None:
            seen.refused[name] = Refused(
                RefusalReason.UNREADABLE, "it is no picture of 8 or 16 bits"
            )
            continue
        sizes[name] = pixels.shape[1], pixels.shape[0]
        found = find_board(pixels, board)
        if isinstance(found, BoardSighting):
            seen.views[name] = found
        else:
            seen.refused[name] = found
    sized = Counter(sizes[name] for name in seen.views or sizes)
    if sized:
        seen.size = sized.most_common(1)[0][0]
    odd = {name: sizes[name] for name in seen.views if sizes[name] != seen.size}
    seen.leave(
        {n: Refused(RefusalReason.OTHER_SIZE, f"{w}x{h} pixels") for n, (w, h) in odd.items()}
    )
    return seen


def calibrate_lens(
    inputs: Sequence[Path],
    board: Checkerboard,
    output: PathLike,
    *,
    model: LensModel | None = None,
    every_s: float = 0.5,
    max_views: int = 60,
    plot: PathLike | None = None,
    camera_name: str = "thermal",
    namespace: str = "",
    progress: Report = silent,
) -> dict[str, object]:
    """Calibrate from pictures, folders of pictures, or a bag; return a summary.

    Write a calibration file and, if asked, a plot of its views and errors: both or none. Of a bag
    the sharpest picture of every ``every_s`` seconds is used. At most ``max_views`` views, the
    most different ones, enter the fit. Raise CalibrationError, BagError.
    """
    by_bag = is_bag(inputs)
    check_outputs(files_of(inputs), (output, plot), CalibrationError)
    video = BoardVideo(inputs[0], namespace) if by_bag else None
    if video is not None:
        pictures = sharpest(video.pictures(progress), every_s)
    else:
        pictures = pictures_of_files(files_of(inputs), progress)
    seen = sightings_in(pictures, board)
    seen.leave(doubtful_views(seen.views, seen.size[0]))
    if not seen.views:
        none = f"no picture of {seen.pictures} can be used: {reasons(seen)}"
        raise CalibrationError(f"lens: {none if seen.pictures else 'there are no pictures'}")
    chosen = sorted(most_distinct(seen.views, max_views), key=list(seen.views).index)
    fit = fit_lens({name: seen.views[name] for name in chosen}, board, seen.size, model)
    spare = len(seen.views) - len(chosen)
    seen.leave(fit.refused)
    files: dict[PathLike, str | bytes] = {output: camera_yaml(fit.camera, camera_name)}
    if plot is not None:
        files[plot] = lens_png(fit, seen.views)
    write_files(files, CalibrationError)
    damage = None if video is None else video.damage
    output_files = [os.fspath(path) for path in files]
    return {"output": output_files} | _summary(fit, seen, spare) | {"error": damage}


def reasons(seen: BoardSightings) -> str:
    """Return the reasons of refused pictures: ``12 x no board, 3 x blurred``."""
    counts = Counter(refused.reason.value for refused in seen.refused.values())
    return ", ".join(f"{number} x {reason}" for reason, number in counts.most_common())


def _summary(fit: LensFit, seen: BoardSightings, spare: int) -> dict[str, object]:
    size = np.array([fit.camera.width, fit.camera.height])
    corners = np.concatenate([seen.views[name].corners_px for name in fit.views])
    cells = np.floor((corners + 0.5) / size * _CELLS).astype(int).clip(0, np.array(_CELLS) - 1)
    covered = len(np.unique(cells, axis=0)) / (_CELLS[0] * _CELLS[1])
    errors = {name: view.rms_px for name, view in fit.views.items()}
    return {
        "pictures": seen.pictures,
        "views": len(fit.views),
        "views_spare": spare,
        "image_size": size.tolist(),
        "parameters": dict(zip(fit.names, fit.values.tolist(), strict=True)),
        "sigma": dict(zip(fit.names, fit.sigma.tolist(), strict=True)),
        "covariance": fit.covariance,
        "reprojection_rms_px": fit.rms_px,
        "reprojection_mean_px": fit.mean_px,
        "reprojection_worst_view_px": max(errors.values()),
        "covered_share": covered,
        "tilt_deg": float(np.degrees(fit.tilt_rad)),
        "view_rms_px": errors,
        "refused": seen.reasons_by_name,
        "warning": _warning(fit, covered),
    }


def _warning(fit: LensFit, covered: float) -> str | None:
    """Return what makes the result less good than it looks, and what to do; None if nothing."""
    notes = []
    if len(fit.views) < _FEW_VIEWS:
        notes.append(f"{len(fit.views)} views are few: take 20")
    if covered < _LEAST_COVERED:
        notes.append(
            f"the views cover {100 * covered:.0f} % of the picture: "
            "take some at its edges and corners"
        )
    tilt = float(np.degrees(fit.tilt_rad))
    if tilt < _LOW_TILT_DEG:
        notes.append(
            f"the board is tilted by {tilt:.0f} deg at most: tilt it by 20 to 45, all ways"
        )
    loose = [
        name
        for name, value, sigma in zip(fit.names, fit.values, fit.sigma, strict=True)
        if name in {"k3", "k4", "k5", "k6"} and sigma > _LOOSE * abs(value)
    ]
    if loose:
        notes.append(f"{', '.join(loose)} cannot be told from the others: leave them out")
    return "; ".join(notes) or None

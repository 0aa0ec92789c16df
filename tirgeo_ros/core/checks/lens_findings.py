"""Check a camera's calibration, by itself and against the pictures' size."""

from __future__ import annotations

import math

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.finding import Finding, Severity

#: Largest offset of the principal point, in picture widths: no lens is mounted further off.
_ASIDE = 0.1
_NARROWEST_DEG, _WIDEST_DEG = 5.0, 120.0
_SQUARE = 0.1  # largest relative difference of fx and fy: the pixels of sensors are square
#: Ratios between the picture sizes that cameras offer.
_RATIOS = (0.25, 1 / 3, 0.4, 0.5, 0.6, 0.625, 2 / 3, 0.75, 0.8, 1.25, 4 / 3, 1.5, 1.6, 2, 2.5, 4)
_NEAR_RATIO = 0.1  # tolerance, because principal points are off centre too
_FROM_LENS = "run tirgeo calibrate lens on pictures of this camera"


def lens_findings(camera: Camera, lens: str) -> list[Finding]:
    """Return what is wrong with a calibration; ``lens`` names its source."""
    found = (
        _aside(camera, lens),
        _view(camera, lens),
        _square(camera, lens),
        _folds(camera, lens),
    )
    return [one for one in found if one is not None]


def size_finding(camera: Camera, size: tuple[int, int], lens: str) -> Finding | None:
    """Return a finding if the pictures' ``size`` (width, height) is not the calibration's."""
    if size == (camera.width, camera.height):
        return None
    evidence = f"pictures are {size[0]}x{size[1]}, the lens {camera.width}x{camera.height}"
    mend = "calibrate the lens in the pictures' size; nothing is drawn until then"
    return Finding("picture_size", Severity.STOP, evidence, lens, mend)


def _aside(camera: Camera, lens: str) -> Finding | None:
    right = camera.cx - (camera.width - 1) / 2
    down = camera.cy - (camera.height - 1) / 2
    far = math.hypot(right, down)
    if far <= _ASIDE * camera.width:
        return None
    evidence = (
        f"principal point {camera.cx:.0f}, {camera.cy:.0f} lies {far:.0f} px from the middle of "
        f"{camera.width}x{camera.height}"
    )
    ratio = 2 * camera.cx / camera.width
    nearest = min(_RATIOS, key=lambda one: abs(math.log(one / max(ratio, 1e-6))))
    alike = abs(2 * camera.cy / camera.height / nearest - 1) < _NEAR_RATIO
    if alike and abs(ratio / nearest - 1) < _NEAR_RATIO:
        width, height = camera.width * nearest, camera.height * nearest
        evidence += f": K is that of {width:.0f}x{height:.0f}"
        return Finding("principal_point", Severity.STOP, evidence, lens, _FROM_LENS)
    return Finding("principal_point", Severity.CAUTION, evidence, lens, _FROM_LENS)


def _view(camera: Camera, lens: str) -> Finding | None:
    view_deg = 2 * math.degrees(math.atan(camera.width / 2 / camera.fx))
    if _NARROWEST_DEG <= view_deg <= _WIDEST_DEG:
        return None
    evidence = f"field of view {view_deg:.1f} deg, by a focal length of {camera.fx:.0f} px"
    return Finding("field_of_view", Severity.STOP, evidence, lens, _FROM_LENS)


def _square(camera: Camera, lens: str) -> Finding | None:
    ratio = camera.fx / camera.fy
    if abs(ratio - 1) <= _SQUARE:
        return None
    evidence = f"focal lengths {camera.fx:.0f} and {camera.fy:.0f} px: pixels {ratio:.2f} to 1"
    return Finding("focal_ratio", Severity.CAUTION, evidence, lens, _FROM_LENS)


def _folds(camera: Camera, lens: str) -> Finding | None:
    """Return a finding if the lens model is not defined in a tenth or more of the picture."""
    columns = np.linspace(0, camera.width - 1, 9)
    rows = np.linspace(0, camera.height - 1, 9)
    grid = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    share = float(np.isnan(camera.rays(grid)[:, 0]).mean())
    if share < 0.1:
        return None
    evidence = f"the lens model folds within the picture: {100 * share:.0f} % of it has no place"
    return Finding("lens_folds", Severity.CAUTION, evidence, lens, _FROM_LENS)

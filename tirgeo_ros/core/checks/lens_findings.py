"""Check a camera's calibration, by itself and against the pictures' size."""

from __future__ import annotations

import math

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.finding import Finding, Severity

#: Largest offset of the principal point, in picture widths: no lens is mounted further off.
_ASIDE = 0.1
_NARROWEST_DEG, _WIDEST_DEG = 5.0, 120.0
_FROM_LENS = "run tirgeo calibrate lens on pictures of this camera"


def lens_findings(camera: Camera, lens: str, size: tuple[int, int] | None = None) -> list[Finding]:
    """Return what is wrong with a calibration for pictures of a ``size`` (width, height) if known.

    ``lens`` names its source.
    """
    found = []

    def tell(check: str, severity: Severity, evidence: str, mend: str = _FROM_LENS) -> None:
        found.append(Finding(check, severity, evidence, lens, mend))

    if size is not None and size != (camera.width, camera.height):
        evidence = f"pictures are {size[0]}x{size[1]}, the lens {camera.width}x{camera.height}"
        mend = "calibrate the lens in the pictures' size; nothing is drawn until then"
        tell("picture_size", Severity.STOP, evidence, mend)
    right, down = camera.cx - (camera.width - 1) / 2, camera.cy - (camera.height - 1) / 2
    if math.hypot(right, down) > _ASIDE * camera.width:
        evidence = (
            f"principal point {camera.cx:.0f}, {camera.cy:.0f} lies "
            f"{math.hypot(right, down):.0f} px from the middle of {camera.width}x{camera.height}"
        )
        tell("principal_point", Severity.CAUTION, evidence)
    view_deg = 2 * math.degrees(math.atan(camera.width / 2 / camera.fx))
    if not _NARROWEST_DEG <= view_deg <= _WIDEST_DEG:
        evidence = f"field of view {view_deg:.1f} deg, by a focal length of {camera.fx:.0f} px"
        tell("field_of_view", Severity.STOP, evidence)
    return found

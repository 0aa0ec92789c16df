"""Check the parameters and the camera's calibration as they are given."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.finding import Finding, Severity

#: Parameters that give the ground's height but do not describe the aircraft.
_GROUND = ("ground_height_m", "dem")
#: Largest offset of the principal point, in picture widths: no lens is mounted further off.
_ASIDE = 0.1
#: So far off is a K that belongs to pictures of another size: 5/8, 3/2 or more of these.
_OF_ANOTHER_SIZE = 0.2
_NARROWEST_DEG, _WIDEST_DEG = 5.0, 120.0
_FROM_LENS = "run tirgeo calibrate lens on pictures of this camera"


def parameter_findings(
    given: Collection[str],
    unused: Sequence[str],
    namespace: str,
    *,
    pictures: bool,
    option: str = "--params",
) -> list[Finding]:
    """Return what is wrong with the parameters ``given``.

    ``unused`` are sections for nodes that do not run. ``pictures`` is whether the flight has
    pictures or a gimbal. ``option`` is the option that names parameter files.
    """
    found = []

    def tell(check: str, evidence: str, mend: str) -> None:
        found.append(Finding(check, Severity.CAUTION, evidence, option, mend))

    if unused:
        where = f"/{namespace.strip('/')}" if namespace.strip("/") else "no namespace"
        evidence = f"sections of parameters for no node of this flight ({where}): "
        mend = "give the --namespace of that aircraft, or begin the section with /**/"
        tell("parameters_elsewhere", evidence + ", ".join(unused), mend)
    if pictures and set(given) <= {"camera", "method", *_GROUND}:
        ground = "" if any(name in given for name in _GROUND) else ", no height of the ground"
        evidence = "no place on the aircraft is given: all lever arms and the boresight are 0"
        mend = "measure them and write them into a copy of your aircraft's file in config"
        tell("no_parameters", evidence + ground, mend)
    return found


def size_fault(camera: Camera, width: int, height: int) -> str:
    """Return why a calibration does not fit a picture's size; empty if the sizes are equal."""
    if (camera.width, camera.height) == (width, height):
        return ""
    size = f"{camera.width}x{camera.height}"
    return f"the calibration is of {size} pixels and the pictures have {width}x{height}"


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
    aside_px = math.hypot(right, down)
    if aside_px > _ASIDE * camera.width:
        evidence = (
            f"principal point {camera.cx:.0f}, {camera.cy:.0f} lies {aside_px:.0f} px from the "
            f"middle of {camera.width}x{camera.height}"
        )
        is_wrong = aside_px > _OF_ANOTHER_SIZE * camera.width
        tell("principal_point", Severity.STOP if is_wrong else Severity.CAUTION, evidence)
    view_deg = 2 * math.degrees(math.atan(camera.width / 2 / camera.fx))
    if not _NARROWEST_DEG <= view_deg <= _WIDEST_DEG:
        evidence = f"field of view {view_deg:.1f} deg, by a focal length of {camera.fx:.0f} px"
        tell("field_of_view", Severity.STOP, evidence)
    return found

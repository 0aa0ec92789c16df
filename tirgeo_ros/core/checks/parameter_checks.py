"""Check the parameters as they are given, independent of the flight."""

from __future__ import annotations

from collections.abc import Collection, Sequence

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.finding import Finding, Severity

#: Parameters that give the ground's height but do not describe the aircraft.
_GROUND = ("ground_height_m", "dem")


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
        mend = "measure them and write them into a copy of config/m600_xt2.yaml or m300_h20t.yaml"
        tell("no_parameters", evidence + ground, mend)
    return found


def size_fault(camera: Camera, width: int, height: int) -> str:
    """Return why a calibration does not fit a picture's size; empty if the sizes are equal."""
    if (camera.width, camera.height) == (width, height):
        return ""
    size = f"{camera.width}x{camera.height}"
    return f"the calibration is of {size} pixels and the pictures have {width}x{height}"

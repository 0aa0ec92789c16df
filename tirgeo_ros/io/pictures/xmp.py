"""Write a still's XMP: the position and the angles as DJI's pictures and as Pix4D have them.

There are two descriptions. A reader that takes values from both in turn (OpenDroneMap) ends with
the angles of the second, which are the camera's own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from xml.sax.saxutils import quoteattr

from tirgeo_ros.core.types.arrays import Vector
from tirgeo_ros.io.pictures.still import Still

_DJI, _PIX4D = "http://www.dji.com/drone-dji/1.0/", "http://pix4d.com/camera/1.0/"
_PACKET = """<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>
<x:xmpmeta xmlns:x="adobe:ns:meta/">
 <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
{descriptions} </rdf:RDF>
</x:xmpmeta>
<?xpacket end="w"?>"""
_OF_BROWN = 5  # coefficients k1, k2, p1, p2, k3
_LARGEST_SIGMA_DEG = 180.0


def still_xmp(still: Still) -> bytes:
    """Return the packet, UTF-8; what is not known has no attribute."""
    dji = _description("drone-dji", _DJI, _as_dji(still))
    pix4d = _description("Camera", _PIX4D, _as_pix4d(still))
    return _PACKET.format(descriptions=dji + pix4d).encode()


def _description(prefix: str, namespace: str, texts: Mapping[str, str]) -> str:
    attributes = "".join(f"\n   {prefix}:{key}={quoteattr(text)}" for key, text in texts.items())
    return f'  <rdf:Description rdf:about="" xmlns:{prefix}="{namespace}"{attributes}/>\n'


def _as_dji(still: Still) -> dict[str, str]:
    """Return the attributes of DJI's cameras; angles against true north and the horizon.

    There is no RtkFlag: it tells the kind of a receiver's fix, which a pose does not have.
    """
    place = still.place
    north_m, east_m, down_m = place.position_sigmas_m
    return {
        "GpsLatitude": f"{math.degrees(place.latitude_rad):+.9f}",
        "GpsLongitude": f"{math.degrees(place.longitude_rad):+.9f}",
        "AbsoluteAltitude": f"{still.altitude_m:+.4f}",
        **_known({"RelativeAltitude": still.above_ground_m}, "+.4f"),
        **_turned("Gimbal", place.rpy),
        **(_turned("Flight", still.body_rpy) if still.body_rpy is not None else {}),
        **_known({"RtkStdLon": east_m, "RtkStdLat": north_m, "RtkStdHgt": down_m}, ".4f"),
        **_dewarp(still),
    }


def _turned(what: str, rpy: Vector) -> dict[str, str]:
    """Return the three angles of gimbal or aircraft, yaw from -180 to 180 deg."""
    roll, pitch, yaw = map(math.degrees, rpy)
    named = {"Roll": roll, "Pitch": pitch, "Yaw": yaw}
    return {f"{what}{axis}Degree": f"{angle:+.5f}" for axis, angle in named.items()}


def _dewarp(still: Still) -> dict[str, str]:
    """Return the calibration, of a picture that still has its distortion.

    It is fx, fy, the principal point from the picture's middle (px), k1, k2, p1, p2, k3, as
    OpenCV has them. The rational model has no place there.
    """
    camera = still.camera
    if len(camera.distortion) > _OF_BROWN:
        return {}
    off_middle = camera.cx - (camera.width - 1) / 2, camera.cy - (camera.height - 1) / 2
    lens = *camera.distortion, *[0.0] * (_OF_BROWN - len(camera.distortion))
    numbers = ",".join(f"{number:.9g}" for number in (camera.fx, camera.fy, *off_middle, *lens))
    return {"DewarpFlag": "0", "DewarpData": f"{still.time:%Y-%m-%d};{numbers}"}


def _as_pix4d(still: Still) -> dict[str, str]:
    """Return the attributes that Pix4D defines; lengths in mm by the pixels' width.

    There is no distortion: that model has one focal length, ours has two. Nor is there a
    ModelType, by which OpenDroneMap would leave its own, better model.
    """
    camera, place, mm = still.camera, still.place, still.pixel_pitch_um * 1e-3
    roll, pitch, yaw = map(math.degrees, place.mapping_rpy)
    angles = {"Yaw": yaw, "Pitch": pitch, "Roll": roll}
    roll, pitch, yaw = map(math.degrees, place.mapping_sigmas_rad)
    sigmas = {"IMUYawAccuracy": yaw, "IMUPitchAccuracy": pitch, "IMURollAccuracy": roll}
    north_m, east_m, down_m = place.position_sigmas_m
    return {
        **{key: f"{angle:.5f}" for key, angle in angles.items()},
        **_known({k: v for k, v in sigmas.items() if v < _LARGEST_SIGMA_DEG}, ".5f"),
        **_known({"GPSXYAccuracy": max(north_m, east_m), "GPSZAccuracy": down_m}, ".4f"),
        "PerspectiveFocalLength": f"{(camera.fx + camera.fy) / 2 * mm:.6f}",
        "PrincipalPoint": f"{(camera.cx + 0.5) * mm:.6f},{(camera.cy + 0.5) * mm:.6f}",
    }


def _known(numbers: Mapping[str, float], form: str) -> dict[str, str]:
    """Return the numbers that are finite as texts."""
    return {key: f"{value:{form}}" for key, value in numbers.items() if math.isfinite(value)}

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
"""Encode a still with its metadata, EXIF and XMP: JPEG of 8 bits, TIFF of 16.

EXIF (CIPA DC-008) has time, place, direction and focal length. XMP has the position and the angles
as DJI's pictures and as Pix4D have them, in two descriptions. A reader that takes values from both
in turn (OpenDroneMap) ends with the angles of the second, which are the camera's own.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from xml.sax.saxutils import quoteattr

import numpy as np
from PIL import Image
from PIL.ExifTags import GPS, IFD, Base
from PIL.TiffImagePlugin import IFDRational
from PIL.TiffTags import TAGS_V2_GROUPS, UNDEFINED, TagInfo

from tirgeo_ros import __version__
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.ground.frame_geometry import CameraPlace
from tirgeo_ros.core.types.arrays import RawPixels, Vector
from tirgeo_ros.io.pictures.jpeg_segments import XMP, segment, with_metadata

_DJI, _PIX4D = "http://www.dji.com/drone-dji/1.0/", "http://pix4d.com/camera/1.0/"
_PACKET = """<?xpacket begin="\ufeff" id="W5M0MpCehiHzreSzNTczkc9d"?>
<x:xmpmeta xmlns:x="adobe:ns:meta/">
 <rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
{descriptions} </rdf:RDF>
</x:xmpmeta>
<?xpacket end="w"?>"""
_MOST_BROWN = 5  # coefficients of Brown's model: k1, k2, p1, p2, k3
_LARGEST_SIGMA_DEG = 180.0
#: Parts in which seconds of arc are written, 0.03 mm on the ground.
_PER_SECOND = 1_000_000
#: Versions of EXIF and its GPS tags, by whether altitudes are above sea level. GPSAltitudeRef 0
#: and 1 mean above sea level in 2.3, ellipsoidal in 3.0 (which has 2 and 3 for sea level). Readers
#: know only 0 and 1: OpenDroneMap takes any other value for a depth.
_VERSIONS = {True: (b"0231", b"\x02\x03\x00\x00"), False: (b"0300", b"\x02\x04\x00\x00")}
_COMPONENTS = Base.ComponentsConfiguration  # whose type (undefined) Pillow does not know
TAGS_V2_GROUPS[IFD.Exif].setdefault(_COMPONENTS, TagInfo(_COMPONENTS, _COMPONENTS.name, UNDEFINED))
_INCH, _CENTRED, _SRGB = 2, 1, 1
_CENTIMETRE = 3  # unit of the focal plane's resolution: the metric one that all readers know
#: Never "DJI": OpenDroneMap adds 90 deg to the pitch of pictures by that maker, and takes the
#: aircraft's heading for the camera's.
MAKE, MODEL = "tirgeo", "thermal"
#: Assumed width of a pixel on the sensor; focal lengths in pixels do not depend on it.
_PIXEL_MM = 0.012
_EPOCH = datetime(1970, 1, 1, tzinfo=timezone.utc)


@dataclass(frozen=True, slots=True)
class Still:
    """Hold the metadata of a still; nan and None are unknown values."""

    exposure_ns: int  # since 1970, UTC
    camera: Camera
    place: CameraPlace
    heading_rad: float  # of the view, from true north, clockwise
    body_rpy: Vector | None  # the aircraft's roll, pitch and heading, rad
    above_ground_m: float
    undulation_m: float  # of the geoid

    @property
    def above_sea(self) -> bool:
        """Return whether ``altitude_m`` is above sea level, not above the ellipsoid."""
        return math.isfinite(self.undulation_m)

    @property
    def altitude_m(self) -> float:
        """Return the height above sea level if the undulation is known, else the ellipsoidal."""
        return self.place.altitude_m(self.undulation_m)

    @property
    def altitude_words(self) -> str:
        """Return what the altitude is measured from, for a person."""
        height = f"{self.place.height_m:.3f} m above the WGS84 ellipsoid"
        if self.above_sea:
            return f"altitude above sea level: {height}, geoid undulation {self.undulation_m:g} m"
        return f"altitude is ellipsoidal: {height}"

    @property
    def time(self) -> datetime:
        """Return the exposure's time, UTC, to a microsecond, rounded down."""
        return _EPOCH + timedelta(microseconds=self.exposure_ns // 1000)


def ending_of(pixels: RawPixels) -> str:
    """Return the ending of the name of a file with these pixels."""
    return ".tif" if pixels.dtype == np.uint16 else ".jpg"


def still_bytes(pixels: RawPixels, still: Still) -> bytes:
    """Return a picture as a file: TIFF of 16 bits (h, w); JPEG of 8, (h, w) or BGR."""
    exif, out = still_exif(still), io.BytesIO()
    if pixels.dtype == np.uint16:
        exif[Base.XMLPacket] = still_xmp(still)
        Image.fromarray(np.ascontiguousarray(pixels)).save(out, "TIFF", exif=exif.tobytes())
        return out.getvalue()
    rgb = pixels if pixels.ndim == 2 else pixels[..., ::-1]
    exif[Base.YCbCrPositioning] = _CENTRED
    exif[IFD.Exif] |= {
        Base.ColorSpace: _SRGB,
        _COMPONENTS: b"\1\0\0\0" if pixels.ndim == 2 else b"\1\2\3\0",
        Base.FlashPixVersion: b"0100",
    }
    picture = Image.fromarray(np.ascontiguousarray(rgb))
    picture.save(out, "JPEG", quality=100, subsampling=0)
    metadata = segment(exif.tobytes()) + segment(XMP + still_xmp(still))
    return with_metadata(out.getvalue(), metadata)


def still_exif(still: Still) -> Image.Exif:
    """Return the tags of EXIF; unknown numbers have none.

    The focal length in mm follows from a pixel of 12 um. In pixels it is, exactly, the product
    of FocalLength and the focal plane's resolution.
    """
    exif = Image.Exif()
    exif[Base.ImageDescription] = still.altitude_words
    exif[Base.Make], exif[Base.Model] = MAKE, MODEL
    exif[Base.Software] = f"tirgeo {__version__}"
    exif[Base.Orientation] = 1
    exif[Base.XResolution] = exif[Base.YResolution] = IFDRational(72)  # EXIF's value for unknown
    exif[Base.ResolutionUnit] = _INCH
    exif[IFD.Exif] = _picture(still)
    exif[IFD.GPSInfo] = _position(still)
    return exif


def _picture(still: Still) -> dict[int, object]:
    """Return the tags of time and lens.

    There is no SubSecTime, the fraction of the file's own date: OpenDroneMap adds it to
    DateTimeOriginal as a number, without its leading zeros.
    """
    camera, time = still.camera, still.time
    focal = _rational(camera.fx * _PIXEL_MM, 1_000_000)
    return {
        Base.ExifVersion: _VERSIONS[still.above_sea][0],
        Base.DateTimeOriginal: f"{time:%Y:%m:%d %H:%M:%S}",
        Base.OffsetTimeOriginal: "+00:00",
        Base.SubsecTimeOriginal: f"{time:%f}",
        Base.FocalLength: focal,
        Base.ExifImageWidth: camera.width,
        Base.ExifImageHeight: camera.height,
        Base.FocalPlaneXResolution: _rational(10 * camera.fx / float(focal), 100_000),
        Base.FocalPlaneYResolution: _rational(10 * camera.fy / float(focal), 100_000),
        Base.FocalPlaneResolutionUnit: _CENTIMETRE,
    }


def _position(still: Still) -> dict[int, object]:
    place, time = still.place, still.time
    tags: dict[int, object] = {
        GPS.GPSVersionID: _VERSIONS[still.above_sea][1],
        GPS.GPSLatitudeRef: "S" if place.latitude_rad < 0 else "N",
        GPS.GPSLatitude: _sexagesimal(place.latitude_rad),
        GPS.GPSLongitudeRef: "W" if place.longitude_rad < 0 else "E",
        GPS.GPSLongitude: _sexagesimal(place.longitude_rad),
        GPS.GPSAltitudeRef: b"\x01" if still.altitude_m < 0 else b"\x00",
        GPS.GPSAltitude: _rational(abs(still.altitude_m), 10_000),
        GPS.GPSTimeStamp: (
            IFDRational(time.hour),
            IFDRational(time.minute),
            IFDRational(time.second * 1_000_000 + time.microsecond, 1_000_000),
        ),
        GPS.GPSDateStamp: f"{time:%Y:%m:%d}",
        GPS.GPSMapDatum: "WGS-84",
        GPS.GPSImgDirectionRef: "T",
        GPS.GPSImgDirection: _rational(math.degrees(still.heading_rad) % 360, 1000),
    }
    north_m, east_m, _ = place.position_sigmas_m
    if math.isfinite(north_m + east_m):
        tags[GPS.GPSHPositioningError] = _rational(max(north_m, east_m), 10_000)
    return tags


def _sexagesimal(angle_rad: float) -> tuple[IFDRational, IFDRational, IFDRational]:
    """Return whole degrees, minutes, and seconds; rounded first, so no seconds are 60."""
    parts = round(math.degrees(abs(angle_rad)) * 3600 * _PER_SECOND)
    minutes, rest = divmod(parts, 60 * _PER_SECOND)
    return IFDRational(minutes // 60), IFDRational(minutes % 60), IFDRational(rest, _PER_SECOND)


def _rational(value: float, denominator: int) -> IFDRational:
    return IFDRational(round(value * denominator), denominator)


def still_xmp(still: Still) -> bytes:
    """Return the packet of XMP, UTF-8; unknown values have no attribute."""
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
    place, camera = still.place, still.camera
    north_m, east_m, down_m = place.position_sigmas_m
    dewarp = {}
    if len(camera.distortion) <= _MOST_BROWN:  # DewarpData has no place for the rational model
        # For a picture that still has its distortion: fx, fy, the principal point from the
        # picture's middle (px), k1, k2, p1, p2, k3 of OpenCV.
        middle = camera.cx - (camera.width - 1) / 2, camera.cy - (camera.height - 1) / 2
        lens = *camera.distortion, *[0.0] * (_MOST_BROWN - len(camera.distortion))
        numbers = ",".join(f"{x:.9g}" for x in (camera.fx, camera.fy, *middle, *lens))
        dewarp = {"DewarpFlag": "0", "DewarpData": f"{still.time:%Y-%m-%d};{numbers}"}
    return {
        "GpsLatitude": f"{math.degrees(place.latitude_rad):+.9f}",
        "GpsLongitude": f"{math.degrees(place.longitude_rad):+.9f}",
        "AbsoluteAltitude": f"{still.altitude_m:+.4f}",
        **_finite({"RelativeAltitude": still.above_ground_m}, "+.4f"),
        **_angles("Gimbal", place.rpy),
        **(_angles("Flight", still.body_rpy) if still.body_rpy is not None else {}),
        **_finite({"RtkStdLon": east_m, "RtkStdLat": north_m, "RtkStdHgt": down_m}, ".4f"),
        **dewarp,
    }


def _angles(what: str, rpy: Vector) -> dict[str, str]:
    """Return the three angles of gimbal or aircraft, yaw from -180 to 180 deg."""
    roll, pitch, yaw = map(math.degrees, rpy)
    named = {"Roll": roll, "Pitch": pitch, "Yaw": yaw}
    return {f"{what}{axis}Degree": f"{angle:+.5f}" for axis, angle in named.items()}


def _as_pix4d(still: Still) -> dict[str, str]:
    """Return the attributes that Pix4D defines; lengths in mm by a pixel of 12 um.

    Distortion is left out: Pix4D's model has one focal length, ours has two. ModelType is left
    out: OpenDroneMap would use it in place of its own, better model.
    """
    camera, place = still.camera, still.place
    roll, pitch, yaw = map(math.degrees, place.mapping_rpy)
    angles = {"Yaw": yaw, "Pitch": pitch, "Roll": roll}
    roll, pitch, yaw = map(math.degrees, place.mapping_sigmas_rad)
    sigmas = {"IMUYawAccuracy": yaw, "IMUPitchAccuracy": pitch, "IMURollAccuracy": roll}
    north_m, east_m, down_m = place.position_sigmas_m
    return {
        **{key: f"{angle:.5f}" for key, angle in angles.items()},
        **_finite({k: v for k, v in sigmas.items() if v < _LARGEST_SIGMA_DEG}, ".5f"),
        **_finite({"GPSXYAccuracy": max(north_m, east_m), "GPSZAccuracy": down_m}, ".4f"),
        "PerspectiveFocalLength": f"{(camera.fx + camera.fy) / 2 * _PIXEL_MM:.6f}",
        "PrincipalPoint": ",".join(f"{(c + 0.5) * _PIXEL_MM:.6f}" for c in (camera.cx, camera.cy)),
    }


def _finite(numbers: Mapping[str, float], form: str) -> dict[str, str]:
    """Return the numbers that are finite, as texts."""
    return {key: f"{value:{form}}" for key, value in numbers.items() if math.isfinite(value)}

"""Write a still's EXIF: time, place, direction and focal length (CIPA DC-008)."""

from __future__ import annotations

import math

from PIL import Image
from PIL.ExifTags import GPS, IFD, Base
from PIL.TiffImagePlugin import IFDRational

from tirgeo_ros import __version__
from tirgeo_ros.io.pictures.still import MAKE, Still

#: Parts of a second of arc: 0.03 mm on the ground.
_OF_A_SECOND = 1_000_000
#: Of the versions, 2.3 has altitudes above sea level; 3.0 has ellipsoidal ones under the same
#: values 0 and 1 of the reference, and those above sea level under 2 and 3. Readers know 0 and 1
#: alone: OpenDroneMap takes any other value for a depth.
_VERSIONS = {True: (b"0231", b"\x02\x03\x00\x00"), False: (b"0300", b"\x02\x04\x00\x00")}
_CENTIMETRE = 3  # the unit of the focal plane's resolution; of metric units all readers know it


def still_exif(still: Still) -> Image.Exif:
    """Return the tags; numbers that are not known have none.

    The focal length in mm follows from the pixels' width. In pixels it is, exactly, the product
    of FocalLength and the focal plane's resolution, whatever that width is.
    """
    exif = Image.Exif()
    exif[Base.ImageDescription] = still.altitude_words
    exif[Base.Make], exif[Base.Model] = MAKE, still.model.encode("ascii", "replace").decode()
    exif[Base.Software] = f"tirgeo {__version__}"
    exif[Base.Orientation] = 1
    exif[IFD.Exif] = _picture(still)
    exif[IFD.GPSInfo] = _position(still)
    return exif


def _picture(still: Still) -> dict[int, object]:
    """Return the tags of time and lens.

    There is no SubSecTime, the fraction of the file's own date: OpenDroneMap adds it to
    DateTimeOriginal as a number, without its leading zeros.
    """
    camera, time = still.camera, still.time
    focal = _rational(still.focal_mm, 1_000_000)
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
    parts = round(math.degrees(abs(angle_rad)) * 3600 * _OF_A_SECOND)
    minutes, rest = divmod(parts, 60 * _OF_A_SECOND)
    return IFDRational(minutes // 60), IFDRational(minutes % 60), IFDRational(rest, _OF_A_SECOND)


def _rational(value: float, denominator: int) -> IFDRational:
    return IFDRational(round(value * denominator), denominator)

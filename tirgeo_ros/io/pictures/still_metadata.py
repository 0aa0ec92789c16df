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
"""Interpret the EXIF and XMP of a drone's still: time, place, attitudes, lens, laser.

DJI's fields are those of its manuals (Mavic 3T, Matrice 4, chapter 'photo file'): angles in NED,
order yaw, pitch, roll; at pitch -90 deg the roll may be 180 deg and the yaw turned, so the three
are one rotation. Autel's newer firmware writes the same fields with the prefix ``drone``.
Untested, by their documents: Parrot (``drone-parrot``, developer.parrot.com, 'photo metadata'),
Skydio (``drone-skydio``, support.skydio.com, 'camera and metadata overview'), FLIR's Vue and Duo
(``FLIR:MAV``) and older Autel, which write the camera's angles as Pix4D defines ``Camera:Yaw``,
``Pitch`` and ``Roll``: zero is straight down.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL.ExifTags import GPS, Base

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import DATA_SHEET_SIGMA, camera_of
from tirgeo_ros.core.frames.rotations import matrix_from_euler, quat_from_matrix, rotation_y
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CameraError
from tirgeo_ros.io.pictures.embedded_metadata import Embedded, Unreadable, embedded_metadata
from tirgeo_ros.io.pictures.still_file import MODEL as OWN_MODEL

_DRONES = ("drone-dji:", "drone:")  # DJI, Autel
_SKYDIO = "drone-skydio:"
_SKYDIO_PARTS = ("FocalLength", "OpticalCenter")
_CAMERA_ANGLES = (
    *(f"{drone}Gimbal{{}}Degree" for drone in _DRONES),
    "drone-parrot:Camera{}Degree",
    f"{_SKYDIO}CameraOrientationNED/{_SKYDIO}{{}}",
)
_MAPPING_ANGLES = ("Camera:{}",)
_BODY_ANGLES = (
    *(f"{drone}Flight{{}}Degree" for drone in _DRONES),
    "drone-parrot:Drone{}Degree",
    f"{_SKYDIO}VehicleOrientationNED/{_SKYDIO}{{}}",
    "FLIR:MAV{}",
)
#: Names of the latitude's and longitude's fields; DJI's own spelling of longitude is among them.
_PLACES = ("GpsLatitude", "Latitude"), ("GpsLongitude", "GpsLongtitude", "Longitude")
_DATE = re.compile(r"(\d{4}):(\d\d):(\d\d)")
_TIME, _ZONE = re.compile(r"\d:\d\d:\d\d"), re.compile(r"(?:Z|UTC|[+-]\d\d:?\d\d)\s*$")
#: Models whose heights without RTK are ellipsoidal: H20T (two public flights over ground of known
#: height), those of which the manual says geodetic, Anafi Ai (Parrot's document).
_ELLIPSOIDAL = {"ZH20T", "M3T", "M3TD", "M4T", "M4TD", "ANAFI AI"}
#: Those above sea level: XT2 (a public picture where the geoid is at -92 m), our own exports.
_ABOVE_SEA = {"FLIR", "XT2", OWN_MODEL.upper()}
_VERSION_3 = (2, 4)  # of the GPS tags: EXIF 3.0, where heights are ellipsoidal unless it says sea
_THERMAL = re.compile(r"infra|thermal|lwir|\bir\b", re.IGNORECASE)
_SUFFIX = re.compile(r"_([A-Z])(?:_[^_]*)?$")  # DJI_20220602143534_0192_T_waypoint
_MOST_APART = 0.2  # of focal lengths of one lens, in the picture and in the data sheet
_FULL_FRAME_MM = math.hypot(36, 24)
_LENGTHS_MM = {2.0: 25.4, 3.0: 10.0, 4.0: 1.0}  # unit of the focal plane's resolution
#: Relative sigma of a focal length that EXIF gives as the equivalent of another film.
_EQUIVALENT_SIGMA = 0.05


@dataclass(frozen=True, slots=True)
class LaserTarget:
    """Hold where the laser hit, in the middle of the picture; the height has the still's datum."""

    latitude_rad: float
    longitude_rad: float
    height_m: float
    distance_m: float


@dataclass(frozen=True, eq=False, slots=True)
class StillMetadata:
    """Hold what a still says; nan and None are unknown values."""

    maker: str
    model: str
    source: str  # which camera of several took it: DJI's ImageSource, else the letter in its name
    thermal: bool
    size: tuple[int, int]  # width, height
    time: str  # with its zone if it is written; empty: none
    latitude_rad: float
    longitude_rad: float
    absolute_m: float  # height above ``datum``
    datum: str  # ellipsoid or sea; empty: not known
    surveyed: bool  # the height is RTK's
    relative_m: float  # above the take-off
    rtk_flag: int  # 50 fixed, 32 to 49 float, 16 single, 0 none
    rtk_std_m: tuple[float, float, float]  # north, east, height
    camera_q_ng: Array | None  # (4,) wxyz, camera body (FRD) to NED
    body_q_nb: Array | None  # (4,) wxyz
    laser: LaserTarget | None
    camera: Camera | None
    focal_sigma: float  # relative; zero: calibrated


def still_metadata(path: Path) -> StillMetadata:
    """Read the metadata of a still. Raise Unreadable, naming the reason."""
    return _interpreted(embedded_metadata(path), path)


def _interpreted(embedded: Embedded, path: Path) -> StillMetadata:
    xmp, tags = embedded.xmp, embedded.tags
    if not xmp:
        raise Unreadable("no XMP in it: it does not say where the camera was and looked")
    maker = _text(tags.get(Base.Make)) or xmp.get("tiff:Make", "")
    model = _text(tags.get(Base.Model)) or xmp.get("tiff:Model", "")
    suffix = _SUFFIX.search(path.stem.upper())
    source = _own(xmp, "ImageSource") or xmp.get("Camera:BandName", xmp.get("FLIR:BandName", ""))
    source = source or (suffix[1] if suffix else "")
    sheet = _data_sheet(embedded, maker, model)
    camera, sigma = _lens(embedded, sheet)
    absolute_m, datum = _height(embedded, model)
    latitude_rad, longitude_rad = _place(embedded)
    stds = (_number(_own(xmp, f"RtkStd{axis}")) for axis in ("Lat", "Lon", "Hgt"))
    flag = _number(_own(xmp, "RtkFlag"))
    return StillMetadata(
        maker=maker,
        model=model,
        source=source,
        thermal=bool(sheet or source.upper() == "T" or _THERMAL.search(source)),
        size=embedded.size,
        time=_time(embedded),
        latitude_rad=latitude_rad,
        longitude_rad=longitude_rad,
        absolute_m=absolute_m,
        datum=datum,
        surveyed=_own(xmp, "AltitudeType") == "RtkAlt",
        relative_m=_number(_own(xmp, "RelativeAltitude")),
        rtk_flag=int(flag) if math.isfinite(flag) else 0,
        rtk_std_m=(next(stds), next(stds), next(stds)),
        camera_q_ng=_attitude(xmp, _CAMERA_ANGLES, _MAPPING_ANGLES),
        body_q_nb=_attitude(xmp, _BODY_ANGLES),
        laser=_laser(xmp),
        camera=camera,
        focal_sigma=sigma,
    )


def _own(xmp: Mapping[str, str], *names: str) -> str:
    """Return the first field of these names in a drone's own terms, or an empty string."""
    keys = (drone + name for name in names for drone in (*_DRONES, _SKYDIO))
    return next((xmp[key] for key in keys if xmp.get(key)), "")


def _text(value: object) -> str:
    return value.strip("\0 ") if isinstance(value, str) else ""


def _number(value: object) -> float:
    """Return a number as XMP and EXIF write it (``+1.5``, ``9509/100``), or nan."""
    try:
        above, _, below = str(value).partition("/")
        return float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        return math.nan


def _angles(xmp: Mapping[str, str], forms: tuple[str, ...]) -> list[float] | None:
    """Return roll, pitch and yaw (rad) by the first form of which all three are there."""
    for form in forms:
        angles = [_number(xmp.get(form.format(axis))) for axis in ("Roll", "Pitch", "Yaw")]
        if all(abs(angle) <= 360 for angle in angles):  # false for nan
            return [math.radians(angle) for angle in angles]
    return None


def _attitude(
    xmp: Mapping[str, str], forms: tuple[str, ...], mapping: tuple[str, ...] = ()
) -> Array | None:
    """Return the attitude (4,) that three angles give together.

    Those of ``mapping`` are zero for a camera straight down, its top to the north.
    """
    if angles := _angles(xmp, forms):
        return quat_from_matrix(matrix_from_euler(*angles))
    if angles := _angles(xmp, mapping):
        return quat_from_matrix(matrix_from_euler(*angles) @ rotation_y(-math.pi / 2))
    return None


def _place(embedded: Embedded) -> tuple[float, float]:
    """Return latitude and longitude, rad; nan, nan where none or both are zero."""
    degrees = [_number(_own(embedded.xmp, *names)) for names in _PLACES]
    if not all(map(math.isfinite, degrees)):
        degrees = [
            _sexagesimal(embedded.gps.get(tag), embedded.gps.get(tag - 1))
            for tag in (GPS.GPSLatitude, GPS.GPSLongitude)
        ]
    latitude, longitude = degrees
    if not (abs(latitude) <= 90 and abs(longitude) <= 180) or latitude == longitude == 0:
        return math.nan, math.nan
    return math.radians(latitude), math.radians(longitude)


def _sexagesimal(value: object, side: object) -> float:
    """Return the degrees of EXIF's degrees, minutes and seconds."""
    parts = [_number(part) for part in value] if isinstance(value, tuple) else []
    if len(parts) != 3:
        return math.nan
    degrees = parts[0] + parts[1] / 60 + parts[2] / 3600
    return -degrees if _text(side) in {"S", "W"} else degrees


def _height(embedded: Embedded, model: str) -> tuple[float, str]:
    """Return the absolute height (m) and its datum, where it is known."""
    own_m, exif_m = _number(_own(embedded.xmp, "AbsoluteAltitude")), _exif_height_m(embedded)
    kind = _own(embedded.xmp, "AltitudeType")
    if kind == "RtkAlt" or f"{_SKYDIO}AbsoluteAltitude" in embedded.xmp:
        return own_m, "ellipsoid"
    height_m = own_m if math.isfinite(own_m) else exif_m
    version = embedded.gps.get(GPS.GPSVersionID)
    if isinstance(version, bytes) and tuple(version[:2]) >= _VERSION_3:
        return height_m, "sea" if _reference(embedded) in {2, 3} else "ellipsoid"
    if kind not in {"", "GpsFusionAlt"}:
        return height_m, ""  # by air pressure
    if model.upper() in _ELLIPSOIDAL:
        return height_m, "ellipsoid"
    # EXIF 2.3 defines its own height as above sea level; XMP's is not defined.
    return height_m, "sea" if model.upper() in _ABOVE_SEA or not math.isfinite(own_m) else ""


def _exif_height_m(embedded: Embedded) -> float:
    height_m = _number(embedded.gps.get(GPS.GPSAltitude))
    return -height_m if _reference(embedded) in {1, 3} else height_m


def _reference(embedded: Embedded) -> int:
    value = embedded.gps.get(GPS.GPSAltitudeRef)
    return value[0] if isinstance(value, bytes) and value else 0


def _time(embedded: Embedded) -> str:
    """Return the first time with a zone, else the first without; an empty string: none.

    The exposure's UTC, EXIF's own, XMP's, then that of the last position before it.
    """
    exif, gps = embedded.exposure, embedded.gps
    fraction = _text(exif.get(Base.SubsecTimeOriginal))
    zone = _text(exif.get(Base.OffsetTimeOriginal)) or _text(exif.get(Base.OffsetTime))
    own = _text(exif.get(Base.DateTimeOriginal)) or _text(embedded.tags.get(Base.DateTime))
    exposure = _own(embedded.xmp, "UTCAtExposure")
    of_day = gps.get(GPS.GPSTimeStamp)
    numbers = [_number(x) for x in of_day] if isinstance(of_day, tuple) else []
    position = ""
    if len(numbers) == 3 and all(map(math.isfinite, numbers)):
        day = _text(gps.get(GPS.GPSDateStamp))
        position = f"{day} {numbers[0]:02.0f}:{numbers[1]:02.0f}:{numbers[2]:09.6f}Z"
    written = (
        f"{exposure}Z" if exposure and not _ZONE.search(exposure) else exposure,
        own + (f".{fraction}" if fraction.isdigit() else "") + zone,
        *(embedded.xmp.get(f"xmp:{kind}Date", "") for kind in ("Create", "Modify")),
        position,
    )
    times = [_DATE.sub(r"\1-\2-\3", text, count=1) for text in written if _TIME.search(text)]
    return next(filter(_ZONE.search, times), times[0] if times else "")


def _laser(xmp: Mapping[str, str]) -> LaserTarget | None:
    """Return the laser's target; None without one, and where it did not hit."""
    names = ("LRFTargetLat", "LRFTargetLon", "LRFTargetAbsAlt", "LRFTargetDistance")
    latitude, longitude, height_m, distance_m = (_number(_own(xmp, name)) for name in names)
    if _own(xmp, "LRFStatus") not in {"", "Normal"} or not distance_m > 0:
        return None
    if not (abs(latitude) <= 90 and abs(longitude) <= 180 and math.isfinite(height_m)):
        return None
    return LaserTarget(math.radians(latitude), math.radians(longitude), height_m, distance_m)


def _data_sheet(embedded: Embedded, maker: str, model: str) -> Camera | None:
    """Return the thermal camera that has a data sheet; a zoom of 0 means none."""
    zoom = _number(embedded.exposure.get(Base.DigitalZoomRatio))
    return camera_of(maker, model, embedded.size, zoom if zoom > 0 else 1.0, _focal_mm(embedded))


def _focal_mm(embedded: Embedded) -> float:
    focal_mm = _number(embedded.exposure.get(Base.FocalLength))
    return focal_mm if focal_mm > 0 else math.nan


def _lens(embedded: Embedded, sheet: Camera | None) -> tuple[Camera | None, float]:
    """Return the camera and the relative sigma of its focal length.

    A calibration in the picture, the designed focal length there, the data sheet's, then EXIF's.
    One that is far from the data sheet's is that of another camera of the aircraft.
    """
    for camera, sigma in (_calibrated(embedded), _designed(embedded)):
        if camera and (sheet is None or abs(camera.fx / sheet.fx - 1) < _MOST_APART):
            return camera, sigma
    if sheet:
        return sheet, DATA_SHEET_SIGMA
    return _by_exif(embedded)


def _calibrated(embedded: Embedded) -> tuple[Camera | None, float]:
    """Return the camera of ``DewarpData``: date; fx, fy, centre from the middle, k1, k2, p1 ..."""
    numbers = _numbers(_own(embedded.xmp, "DewarpDataK6", "DewarpData").rpartition(";")[2])
    if len(numbers) < 4:
        return None, 0.0
    fx, fy, x, y, *lens = numbers
    if _own(embedded.xmp, "DewarpFlag") == "1":
        lens = []  # the picture has no distortion any more
    return _camera(embedded, fx, fy, x, y, lens), 0.0


def _designed(embedded: Embedded) -> tuple[Camera | None, float]:
    """Return the camera of ``CalibratedFocalLength``: DJI's designed one, Skydio's calibrated.

    Skydio's ``DewarpData`` is taken as k1, k2, k3: its document shows three numbers.
    """
    focal, centre = (f"{_SKYDIO}Calibrated{part}/{_SKYDIO}" for part in _SKYDIO_PARTS)
    f_c = _numbers(
        ",".join(embedded.xmp.get(key + axis, "") for key in (focal, centre) for axis in "XY")
    )
    if len(f_c) == 4:
        middle_x, middle_y = _middle(embedded)
        k1, k2, k3 = (*_numbers(_own(embedded.xmp, "DewarpData")), 0.0, 0.0, 0.0)[:3]
        lens = [k1, k2, 0.0, 0.0, k3]
        return _camera(embedded, f_c[0], f_c[1], f_c[2] - middle_x, f_c[3] - middle_y, lens), 0.0
    focal_px = _number(_own(embedded.xmp, "CalibratedFocalLength"))
    x = _number(_own(embedded.xmp, "CalibratedOpticalCenterX"))
    if abs(x / embedded.size[0] - 0.5) > _MOST_APART:  # of a picture of another size
        focal_px = math.nan
    return _camera(embedded, focal_px, focal_px), DATA_SHEET_SIGMA


def _by_exif(embedded: Embedded) -> tuple[Camera | None, float]:
    """Return the camera by the focal plane's resolution, else by the equivalent focal length."""
    exif = embedded.exposure
    unit_mm = _LENGTHS_MM.get(_number(exif.get(Base.FocalPlaneResolutionUnit)), math.nan)
    focal_px = _focal_mm(embedded) * _number(exif.get(Base.FocalPlaneXResolution)) / unit_mm
    if camera := _camera(embedded, focal_px, focal_px):
        return camera, DATA_SHEET_SIGMA
    equivalent_mm = _number(exif.get(Base.FocalLengthIn35mmFilm))
    focal_px = equivalent_mm / _FULL_FRAME_MM * math.hypot(*embedded.size)
    return _camera(embedded, focal_px, focal_px), _EQUIVALENT_SIGMA


def _numbers(text: str) -> list[float]:
    """Return numbers with commas between them; none if one of them is not finite."""
    numbers = [_number(part) for part in text.split(",")]
    return numbers if all(map(math.isfinite, numbers)) else []


def _middle(embedded: Embedded) -> tuple[float, float]:
    width, height = embedded.size
    return (width - 1) / 2, (height - 1) / 2


def _camera(
    embedded: Embedded,
    fx: float,
    fy: float,
    x: float = 0.0,
    y: float = 0.0,
    lens: Sequence[float] = (),
) -> Camera | None:
    """Return a camera with its principal point at (x, y) from the middle; None: impossible."""
    middle_x, middle_y = _middle(embedded)
    try:
        return Camera(*embedded.size, fx, fy, middle_x + x, middle_y + y, tuple(lens))
    except CameraError:
        return None

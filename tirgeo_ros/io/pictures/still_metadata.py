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
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.known_cameras import DATA_SHEET_SIGMA, camera_of
from tirgeo_ros.core.frames.rotations import matrix_from_euler, quat_from_matrix, rotation_y
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import CameraError
from tirgeo_ros.io.pictures.embedded_metadata import Fields, Unreadable, embedded_metadata
from tirgeo_ros.io.pictures.still_file import MODEL as OWN_MODEL

_MAPPING = "Camera:{}"
#: Their angles in this order; the first that are there count.
_CAMERA = ("Gimbal{}Degree", "Camera{}Degree", "CameraOrientationNED/{}", _MAPPING)
_BODY = ("Flight{}Degree", "Drone{}Degree", "VehicleOrientationNED/{}", "MAV{}")
_DATE = re.compile(r"(\d{4}):(\d\d):(\d\d)")
_TIME, _ZONE = re.compile(r"\d:\d\d:\d\d"), re.compile(r"(?:Z|UTC|[+-]\d\d:?\d\d)\s*$")
#: Models whose heights without RTK are ellipsoidal: H20T (two public flights over ground of known
#: height), those of which the manual says geodetic, Anafi Ai (Parrot's document).
_ELLIPSOIDAL = {"ZH20T", "M3T", "M3TD", "M4T", "M4TD", "ANAFI AI"}
#: Those above sea level: XT2 (a public picture where the geoid is at -92 m), our own exports.
_ABOVE_SEA = {"FLIR", "XT2", OWN_MODEL.upper()}
_EXIF_3 = b"\2\4\0\0"  # version of GPS tags whose heights are ellipsoidal, or it says sea
_THERMAL = re.compile(r"infra|thermal|lwir|\bir\b|^T$", re.IGNORECASE)
_SUFFIX = re.compile(r"_([A-Z])(?:_[^_]*)?$")  # DJI_20220602143534_0192_T_waypoint
_MOST_APART = 0.2  # of focal lengths of one lens, in the picture and in the data sheet
_FULL_FRAME_MM = math.hypot(36, 24)
#: Relative sigma of a focal length that EXIF gives as the equivalent of a full frame.
_EQUIVALENT_SIGMA = 0.05


class Position(NamedTuple):
    """Hold where a still was taken, and how that was measured."""

    latitude_rad: float
    longitude_rad: float
    absolute_m: float  # height above ``datum``
    datum: str  # ellipsoid or sea; empty: not known
    surveyed: bool  # the height is RTK's
    rtk_flag: int  # 50 fixed, 32 to 49 float, 16 single, 0 none
    rtk_std_m: tuple[float, ...]  # north, east, height; nan: not known


@dataclass(frozen=True, eq=False, slots=True)
class StillMetadata:
    """Hold what a still says; nan and None are unknown values."""

    camera_name: str  # maker, model, which of its cameras, size of the picture
    thermal: bool
    pixels: int  # of the picture
    time: str  # with its zone if it is written; empty: none
    position: Position
    relative_m: float  # height above the take-off
    camera_q_ng: Array  # (4,) wxyz, camera body (FRD) to NED
    body_q_nb: Array | None  # (4,) wxyz
    laser_below_m: float  # what the laser met in the middle of the picture, below the camera
    camera: Camera | None
    focal_sigma: float  # relative; zero: calibrated


def still_metadata(path: Path) -> StillMetadata:
    """Read the metadata of a still. Raise Unreadable, naming the reason."""
    size, exif, xmp = embedded_metadata(path)
    if not xmp:
        raise Unreadable("no XMP in it: it does not say where the camera was and looked")
    try:
        return _interpreted(xmp | exif, size, path.stem.upper())
    except (TypeError, ValueError, LookupError, ArithmeticError) as fault:
        raise Unreadable(f"its EXIF is damaged ({fault})") from None


def _interpreted(fields: Fields, size: tuple[int, int], stem: str) -> StillMetadata:
    maker, model = _text(fields, "Make"), _text(fields, "Model")
    zoom = _number(fields, "DigitalZoomRatio", unknown=1.0) or 1.0  # 0: none
    sheet = camera_of(maker, model, size, zoom, _number(fields, "FocalLength") or math.nan)
    # DJI's name of its camera, else the letter in the file's name.
    source = _text(fields, "ImageSource", "Camera:BandName", "BandName")
    source = source or "".join(_SUFFIX.findall(stem))
    thermal = bool(sheet or _THERMAL.search(source))
    position, camera_q_ng = _position(fields, model.upper()), _attitude(fields, _CAMERA)
    lacks = {
        "angles of the camera": camera_q_ng is None,
        "position": math.isnan(position.latitude_rad),
        "height": math.isnan(position.absolute_m),
    }
    if camera_q_ng is None or any(lacks.values()):
        raise Unreadable(f"no {', no '.join(what for what, lack in lacks.items() if lack)} in it")
    camera, focal_sigma = _lens(fields, size, sheet)
    return StillMetadata(
        camera_name=f"{maker} {model} {'thermal' if thermal else source} {size[0]}x{size[1]}",
        thermal=thermal,
        pixels=math.prod(size),
        time=_time(fields),
        position=position,
        relative_m=_number(fields, "RelativeAltitude"),
        camera_q_ng=camera_q_ng,
        body_q_nb=_attitude(fields, _BODY),
        laser_below_m=_laser_below_m(fields),
        camera=camera,
        focal_sigma=focal_sigma,
    )


def _text(fields: Fields, *names: str) -> str:
    """Return the first field of these names that is a text; an empty string: none."""
    texts = (fields.get(name) for name in names)
    return next((text.strip("\0 ") for text in texts if isinstance(text, str) and text), "")


def _number(fields: Fields, *names: str, unknown: float = math.nan) -> float:
    """Return the first field of these names as a number (``+1.5``, ``9509/100``)."""
    return _float(next((fields[name] for name in names if name in fields), ""), unknown)


def _float(value: object, unknown: float = math.nan) -> float:
    above, _, below = str(value).partition("/")
    try:
        number = float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        return unknown
    return number if math.isfinite(number) else unknown


def _three(fields: Fields, name: str) -> tuple[float, ...]:
    """Return EXIF's degrees or hours, minutes and seconds; nan without them."""
    parts = fields.get(name)
    if not isinstance(parts, tuple) or len(parts) != 3:
        return (math.nan,) * 3
    return tuple(map(float, parts))


def _attitude(fields: Fields, forms: Sequence[str]) -> Array | None:
    """Return the attitude (4,) that the first three angles (deg) give together.

    Those for mapping are zero for a camera straight down, its top to the north.
    """
    for form in forms:
        angles = [_number(fields, form.format(axis)) for axis in ("Roll", "Pitch", "Yaw")]
        if all(abs(angle) <= 360 for angle in angles):  # false for nan
            down = rotation_y(-math.pi / 2 if form == _MAPPING else 0.0)
            return quat_from_matrix(matrix_from_euler(*map(math.radians, angles)) @ down)
    return None


def _position(fields: Fields, model: str) -> Position:
    """Return the position: XMP's (with DJI's own spelling), else EXIF's, else nan.

    Both angles are zero where there was no position.
    """
    latitude = _number(fields, "GpsLatitude", "Latitude")
    longitude = _number(fields, "GpsLongitude", "GpsLongtitude", "Longitude")
    if math.isnan(latitude + longitude):
        latitude, longitude = (_exif_degrees(fields, f"GPS{x}itude") for x in ("Lat", "Long"))
    if not (abs(latitude) <= 90 and abs(longitude) <= 180) or latitude == longitude == 0:
        latitude = longitude = math.nan
    absolute_m, datum = _height(fields, model)
    return Position(
        latitude_rad=math.radians(latitude),
        longitude_rad=math.radians(longitude),
        absolute_m=absolute_m,
        datum=datum,
        surveyed=_text(fields, "AltitudeType") == "RtkAlt",
        rtk_flag=int(_number(fields, "RtkFlag", unknown=0.0)),
        rtk_std_m=tuple(_number(fields, f"RtkStd{axis}") for axis in ("Lat", "Lon", "Hgt")),
    )


def _exif_degrees(fields: Fields, name: str) -> float:
    degrees, minutes, seconds = _three(fields, name)
    sign = -1 if _text(fields, f"{name}Ref") in {"S", "W"} else 1
    return sign * (degrees + minutes / 60 + seconds / 3600)


def _height(fields: Fields, model: str) -> tuple[float, str]:
    """Return the absolute height (m) and its datum, where it is known."""
    height_m, kind = _number(fields, "AbsoluteAltitude"), _text(fields, "AltitudeType")
    if kind == "RtkAlt" or _text(fields, "Make").upper() == "SKYDIO":
        return height_m, "ellipsoid"
    reference = fields.get("GPSAltitudeRef")
    is_exif = math.isnan(height_m)
    if is_exif:
        height_m = _number(fields, "GPSAltitude") * (-1 if reference in {b"\1", b"\3"} else 1)
    if fields.get("GPSVersionID") == _EXIF_3:
        return height_m, "sea" if reference in {b"\2", b"\3"} else "ellipsoid"
    if model in _ELLIPSOIDAL and kind in {"", "GpsFusionAlt"}:  # else by air pressure
        return height_m, "ellipsoid"
    # EXIF 2.3 defines its own height as above sea level; XMP's is not defined.
    return height_m, "sea" if not kind and (is_exif or model in _ABOVE_SEA) else ""


def _time(fields: Fields) -> str:
    """Return the first time with a zone, else the first without; an empty string: none.

    The exposure's UTC, EXIF's own, XMP's, then that of the last position before it.
    """
    utc, fraction = _text(fields, "UTCAtExposure"), _text(fields, "SubsecTimeOriginal")
    own = _text(fields, "DateTimeOriginal", "DateTime")
    own += (f".{fraction}" if fraction.isdigit() else "") + _text(fields, "OffsetTimeOriginal")
    hours, minutes, seconds = _three(fields, "GPSTimeStamp")
    position = f"{_text(fields, 'GPSDateStamp')} {hours:02.0f}:{minutes:02.0f}:{seconds:09.6f}Z"
    utc = utc if _ZONE.search(utc) else f"{utc}Z"
    written = (utc, own, _text(fields, "CreateDate"), position)
    times = [_DATE.sub(r"\1-\2-\3", text, count=1) for text in written if _TIME.search(text)]
    return next(filter(_ZONE.search, times), times[0] if times else "")


def _laser_below_m(fields: Fields) -> float:
    """Return how far the laser's target is below the camera; nan without one, or a hit."""
    hit = _text(fields, "LRFStatus") in {"", "Normal"} and _number(fields, "LRFTargetDistance") > 0
    below_m = _number(fields, "AbsoluteAltitude") - _number(fields, "LRFTargetAbsAlt")
    return below_m if hit else math.nan


def _lens(
    fields: Fields, size: tuple[int, int], sheet: Camera | None
) -> tuple[Camera | None, float]:
    """Return the camera and the relative sigma of its focal length.

    A calibration in the picture (``DewarpData``: date; fx, fy, centre from the middle, k1, ...),
    DJI's designed focal length there, the data sheet's, then EXIF's. One that is far from the data
    sheet's is that of another camera of the aircraft.
    """
    dewarp = _text(fields, "DewarpData").rpartition(";")[2].split(",")
    fx, fy, x, y, *lens = *map(_float, dewarp), *[math.nan] * 4
    lens = [] if _number(fields, "DewarpFlag") == 1 else lens[:-4]  # 1: it was taken out
    centre_x = _number(fields, "CalibratedOpticalCenterX")  # elsewhere for another size
    designed_px = _number(fields, "CalibratedFocalLength")
    designed_px *= 1 if abs(centre_x / size[0] - 0.5) < _MOST_APART else math.nan
    equivalent = _number(fields, "FocalLengthIn35mmFilm") / _FULL_FRAME_MM * math.hypot(*size)
    choices = (
        (_camera(size, fx, fy, x, y, *lens), 0.0),
        (_camera(size, designed_px), DATA_SHEET_SIGMA),
        (sheet, DATA_SHEET_SIGMA),
        (_camera(size, equivalent), _EQUIVALENT_SIGMA),
    )
    for camera, sigma in choices:
        if camera and (sheet is None or abs(camera.fx / sheet.fx - 1) < _MOST_APART):
            return camera, sigma
    return None, 0.0


def _camera(size: tuple[int, int], fx: float, *others: float) -> Camera | None:
    """Return a camera; ``others``: fy, centre from the middle, lens. None: impossible."""
    fy, x, y, *lens = others or (fx, 0.0, 0.0)
    try:
        return Camera(*size, fx, fy, (size[0] - 1) / 2 + x, (size[1] - 1) / 2 + y, tuple(lens))
    except CameraError:
        return None

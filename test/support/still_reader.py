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
"""Read stills as programs of photogrammetry do: EXIF by GDAL, XMP as XML, angles by definition.

Nothing of the code that writes them is used.
"""

from __future__ import annotations

import re
import warnings
from typing import NamedTuple
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import rasterio
from PIL import Image
from pyproj import Transformer
from rasterio.errors import NotGeoreferencedWarning

DJI = "{http://www.dji.com/drone-dji/1.0/}"
PIX4D = "{http://pix4d.com/camera/1.0/}"
_RDF = "{http://www.w3.org/1999/02/22-rdf-syntax-ns#}"
_EXIF, _GPS = 0x8769, 0x8825
_TO_EARTH = Transformer.from_crs(4979, 4978, always_xy=True).transform


class Read(NamedTuple):
    """What is in a still: tags by number (Pillow), by name (GDAL), and each description of XMP."""

    tags: dict
    picture: dict
    gps: dict
    by_gdal: dict
    descriptions: list[dict]

    @property
    def xmp(self) -> dict:
        return {key: text for item in self.descriptions for key, text in item.items()}


def read_still(path) -> Read:
    with Image.open(path) as image:
        exif = image.getexif()
        tags, picture, gps = dict(exif), exif.get_ifd(_EXIF), exif.get_ifd(_GPS)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", NotGeoreferencedWarning)
        with rasterio.open(path) as image:
            by_gdal = image.tags() | image.tags(ns="EXIF")
    content = path.read_bytes()
    begin, end = content.find(b"<x:xmpmeta"), content.find(b"</x:xmpmeta>")
    root = ET.fromstring(content[begin : end + len(b"</x:xmpmeta>")])
    return Read(
        tags, picture, gps, by_gdal, [item.attrib for item in root.iter(f"{_RDF}Description")]
    )


def place_of(read: Read) -> tuple[float, float, float]:
    """Latitude and longitude, deg, and altitude, m, of EXIF."""
    gps = read.gps
    degrees = [float(d) + float(m) / 60 + float(s) / 3600 for d, m, s in (gps[2], gps[4])]
    signs = [-1 if letter in "SW" else 1 for letter in (gps[1], gps[3])]
    altitude = float(gps[6]) * (-1 if bytes(gps[5]) == b"\x01" else 1)
    return signs[0] * degrees[0], signs[1] * degrees[1], altitude


def turn(axis: int, angle_deg: float) -> np.ndarray:
    """A rotation about x, y or z, written out."""
    c, s = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    return np.array(
        [
            [[1, 0, 0], [0, c, -s], [0, s, c]],
            [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        ][axis]
    )


def by_gimbal(read: Read) -> np.ndarray:
    """Right, down and forward of the picture as columns, in north, east, down, by DJI's angles.

    The camera's own axes are forward, right, down.
    """
    roll, pitch, yaw = (float(read.xmp[f"{DJI}Gimbal{a}Degree"]) for a in ("Roll", "Pitch", "Yaw"))
    axes = turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)
    return axes[:, [1, 2, 0]]


def by_mapping(read: Read) -> np.ndarray:
    """The same by Pix4D's angles: at 0, 0, 0 down is forward, and north is up in the picture."""
    return _mapped(*(float(read.xmp[PIX4D + a]) for a in ("Roll", "Pitch", "Yaw")))


def _mapped(roll: float, pitch: float, yaw: float) -> np.ndarray:
    axes = turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)
    return np.stack([axes[:, 1], -axes[:, 0], axes[:, 2]], axis=1)


def by_open_drone_map(read: Read) -> np.ndarray:
    """The same as OpenDroneMap finds it: in each description the first of these names counts.

    A maker DJI would add 90 deg to the pitch.
    """
    result = {}
    for item in read.descriptions:
        for angle, names in (
            ("yaw", (f"{DJI}FlightYawDegree", f"{PIX4D}Yaw")),
            ("pitch", (f"{DJI}GimbalPitchDegree", f"{PIX4D}Pitch")),
            ("roll", (f"{DJI}GimbalRollDegree", f"{PIX4D}Roll")),
        ):
            texts = [item[name] for name in names if name in item]
            if texts:
                result[angle] = float(texts[0])
    assert read.tags[271].lower() not in {"dji", "hasselblad", "sensefly"}
    return _mapped(result["roll"], result["pitch"], result["yaw"])


def lens_of(read: Read) -> tuple[np.ndarray, np.ndarray]:
    """K and the distortion: fx, fy of EXIF; the principal point and the lens by DewarpData."""
    picture = read.picture
    assert picture[0xA210] == 3  # per centimetre
    focal_mm = float(picture[0x920A])
    fx, fy = (focal_mm * float(picture[tag]) / 10 for tag in (0xA20E, 0xA20F))
    date, numbers = read.xmp[f"{DJI}DewarpData"].split(";")
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", date)
    assert read.xmp[f"{DJI}DewarpFlag"] == "0"
    dewarp = [float(number) for number in numbers.split(",")]
    np.testing.assert_allclose(dewarp[:2], [fx, fy], rtol=1e-7)
    u, v = dewarp[2] + (picture[0xA002] - 1) / 2, dewarp[3] + (picture[0xA003] - 1) / 2
    return np.array([[fx, 0, u], [0, fy, v], [0, 0, 1.0]]), np.array(dewarp[4:9])


def projected(read: Read, axes: np.ndarray, undulation_m: float, places) -> np.ndarray:
    """Pixels (N, 2) of places (latitude, longitude deg, ellipsoidal height m), by OpenCV."""
    latitude, longitude, altitude = place_of(read)
    lat, lon = np.radians([latitude, longitude])
    local = np.array(
        [
            [-np.sin(lat) * np.cos(lon), -np.sin(lat) * np.sin(lon), np.cos(lat)],
            [-np.sin(lon), np.cos(lon), 0],
            [-np.cos(lat) * np.cos(lon), -np.cos(lat) * np.sin(lon), -np.sin(lat)],
        ]
    )
    camera_e = np.array(_TO_EARTH(longitude, latitude, altitude + undulation_m))
    points_e = np.array([_TO_EARTH(lon, lat, height) for lat, lon, height in places])
    points_c = (points_e - camera_e) @ local.T @ axes
    return cv2.projectPoints(points_c, np.zeros(3), np.zeros(3), *lens_of(read))[0][:, 0]

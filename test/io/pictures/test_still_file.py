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
"""A still's metadata, read by others: GDAL, Pillow and an XML parser; angles by definition."""

from __future__ import annotations

import dataclasses
import math
import re

import cv2
import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.testing import assert_allclose
from PIL.ExifTags import Base
from scenes import camera_pose
from still_reader import DJI, by_gimbal, by_mapping, by_open_drone_map, place_of, read_still

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.frame_geometry import camera_place
from tirgeo_ros.io.pictures.still_file import Still, ending_of, still_bytes

GREY = np.random.default_rng(7).integers(0, 256, (512, 640), np.uint8)
WORDS = "WGS84 ellipsoid"
#: Half a step of the fifth decimal of a degree, for each of three angles.
ANGLES_RAD = 3 * math.radians(0.5e-5)

angles = st.tuples(st.floats(-180, 180), st.floats(-90, 90), st.floats(-180, 180))
places = st.tuples(st.floats(-89.9, 89.9), st.floats(-180, 180), st.floats(-400, 9000))


def still_at(where=(39.85, 116.7, 41.5), attitude=(0.0, -30.0, 20.0), **changes):
    """A still at a place (deg, m) by roll, pitch and yaw of the camera's body (deg)."""
    latitude, longitude, height_m = where
    plane = TangentPlane(math.radians(latitude), math.radians(longitude), height_m)
    covariance = np.diag([0.01, 0.02, 0.03, 0.002, 0.003, 0.004]) ** 2
    pose = camera_pose([0.0, 0, 0], *attitude, covariance)
    usual = {
        "exposure_ns": 1_634_731_239_055_555_556,
        "camera": XT2,
        "place": camera_place(pose, plane),
        "heading_rad": 1.0,
        "body_rpy": (0.01, -0.02, 3.0),
        "above_ground_m": 30.0,
        "undulation_m": math.nan,
    }
    return Still(**usual | changes)


@pytest.fixture
def written(tmp_path):
    """Writes a still, and reads it."""

    def write(still, pixels=GREY):
        path = tmp_path / f"still{ending_of(pixels)}"
        path.write_bytes(still_bytes(pixels, still))
        return read_still(path)

    return write


@given(places, angles)
def test_place_and_angles_are_those_of_the_pose(tmp_path_factory, place, attitude):
    path = tmp_path_factory.getbasetemp() / "still.jpg"
    still = still_at(place, attitude)
    path.write_bytes(still_bytes(GREY[:8, :8], still))
    read = read_still(path)
    for axes in (by_gimbal(read), by_mapping(read), by_open_drone_map(read)):
        assert_allclose(axes, still.place.rotation_lc, atol=ANGLES_RAD + 1e-12)
    latitude, longitude, altitude = place_of(read)
    # Half of a millionth of a second of arc, and a tenth of a millimetre.
    assert_allclose([latitude, longitude], place[:2], atol=0.51e-6 / 3600)
    assert altitude == pytest.approx(place[2], abs=0.51e-4)
    assert float(read.xmp[f"{DJI}GpsLatitude"]) == pytest.approx(place[0], abs=0.51e-9)
    assert float(read.xmp[f"{DJI}GpsLongitude"]) == pytest.approx(place[1], abs=0.51e-9)


def test_altitudes_name_their_reference(written):
    ellipsoidal = written(still_at())
    assert place_of(ellipsoidal)[2] == 41.5
    assert ellipsoidal.picture[0x9000] == b"0300"  # where 0 means the ellipsoid
    assert ellipsoidal.tags[270] == f"altitude is ellipsoidal: 41.500 m above the {WORDS}"
    sea = written(still_at(undulation_m=-9.25))
    assert place_of(sea)[2] == pytest.approx(50.75, abs=1e-4)
    assert float(sea.xmp[f"{DJI}AbsoluteAltitude"]) == pytest.approx(50.75, abs=1e-4)
    assert sea.picture[0x9000] == b"0231"  # where 0 means the sea
    assert sea.tags[270].endswith(f"41.500 m above the {WORDS}, geoid undulation -9.25 m")
    below = written(still_at(undulation_m=60.0))
    assert place_of(below)[2] == pytest.approx(-18.5, abs=1e-4)
    assert below.by_gdal["EXIF_GPSAltitudeRef"] == "0x01"


@pytest.mark.parametrize("pixels", [GREY, np.dstack([GREY] * 3)])
def test_a_jpeg_has_the_tags_that_exif_asks_for_and_that_qgis_imports(written, pixels):
    """CIPA DC-008, table 17."""
    read = written(still_at(), pixels)
    assert (read.tags[Base.XResolution], read.tags[Base.YResolution]) == (72, 72)
    assert read.tags[Base.ResolutionUnit] == 2  # inch
    assert read.tags[Base.YCbCrPositioning] == 1  # centred
    assert read.picture[Base.ColorSpace] == 1  # sRGB
    assert read.picture[0x9291] == "055555"  # SubSecTimeOriginal
    assert 0x9290 not in read.picture  # SubSecTime, of which OpenDroneMap loses the zeros
    assert [float(part) for part in read.gps[7]] == [12, 0, 39.055555]
    expected = {
        "EXIF_DateTimeOriginal": "2021:10:20 12:00:39",
        "EXIF_OffsetTimeOriginal": "+00:00",
        "EXIF_GPSLatitude": "(39) (51) (0)",
        "EXIF_GPSLatitudeRef": "N",
        "EXIF_GPSLongitude": "(116) (42) (0)",
        "EXIF_GPSLongitudeRef": "E",
        "EXIF_GPSAltitude": "(41.5)",
        "EXIF_GPSAltitudeRef": "0x00",
        "EXIF_GPSImgDirection": "(57.296)",
        "EXIF_GPSImgDirectionRef": "T",
        "EXIF_GPSDateStamp": "2021:10:20",
        "EXIF_Orientation": "1",
        "EXIF_Make": "tirgeo",
        "EXIF_Model": "thermal",
    }
    assert {key: read.by_gdal.get(key) for key in expected} == expected


def test_sixteen_bits_are_kept_in_a_tiff(written, tmp_path):
    pixels = GREY.astype(np.uint16) * 200 + 17
    read = written(still_at(), pixels)
    assert read.xmp == written(still_at()).xmp
    assert read.gps == written(still_at()).gps
    assert read.picture[0x920A] == written(still_at()).picture[0x920A]
    assert (cv2.imread(str(tmp_path / "still.tif"), cv2.IMREAD_UNCHANGED) == pixels).all()


def test_unknown_values_have_no_tags(written):
    rational = dataclasses.replace(XT2, distortion=(0.1, 0, 0, 0, 0, 0.01, 0, 0))
    place = dataclasses.replace(still_at().place, covariance_l=np.full((6, 6), np.nan))
    nothing = {"body_rpy": None, "above_ground_m": math.nan, "place": place, "camera": rational}
    read = written(still_at(**nothing))
    assert not re.search("Flight|Relative|Rtk|Dewarp|Accuracy", " ".join(read.xmp))
    assert 0x1F not in read.gps  # GPSHPositioningError
    assert "nan" not in " ".join(read.xmp.values())


def test_the_names_and_forms_are_those_of_real_pictures(written, shared):
    """The same reader on pictures that a DJI H20T took."""
    real = [
        read_still(path) for path in sorted((shared / "foreign_logs/dji/rjpeg").glob("h*.jpg"))
    ]
    assert real
    ours = written(still_at())
    named = {name for name in ours.xmp if name.startswith(DJI)}
    common = {name for name in named if all(name in item.xmp for item in real)}
    assert {f"{DJI}Gimbal{axis}Degree" for axis in ("Roll", "Pitch", "Yaw")} < common
    assert {f"{DJI}{name}" for name in ("GpsLatitude", "AbsoluteAltitude")} < common
    for name in common:
        assert all(re.fullmatch(r"[+-]\d+\.\d+", item.xmp[name]) for item in (ours, *real)), name
    nadir = next(item for item in real if float(item.xmp[f"{DJI}GimbalPitchDegree"]) == -90)
    assert_allclose(by_gimbal(nadir)[:, 2], [0, 0, 1], atol=1e-12)  # it looks down
    up = -by_gimbal(nadir)[:, 1]  # the picture's top
    assert math.degrees(math.atan2(up[1], up[0])) == pytest.approx(42.4)

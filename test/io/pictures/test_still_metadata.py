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
"""Metadata of stills: DJI's fields in every form, other makers', lenses, and hostile files."""

from __future__ import annotations

import math
import struct
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, strategies as st
from made_stills import M3T, XMP_HEAD, jpeg_with, packet, picture, segment, still
from PIL import Image

from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    euler_from_quat,
    matrix_from_quat,
    quat_conjugate,
    quat_multiply,
    rotvec_from_quat,
)
from tirgeo_ros.io.pictures.embedded_metadata import Unreadable, properties
from tirgeo_ros.io.pictures.still_metadata import _attitude, still_metadata


@pytest.fixture
def read(tmp_path):
    def of(data: bytes, name: str = "DJI_0001_T.JPG"):
        path = tmp_path / name
        path.write_bytes(data)
        return still_metadata(path)

    return of


def degrees_between(p, q):
    turn = rotvec_from_quat(quat_multiply(quat_conjugate(p), q))
    return math.degrees(float(np.linalg.norm(turn)))


@pytest.mark.parametrize("elements", [False, True])
def test_all_fields_of_dji_are_read_from_attributes_and_elements(read, elements):
    data = read(still(elements=elements))
    assert (data.maker, data.model, data.source, data.thermal) == (
        *("DJI", "M3T", "InfraredCamera", True),
    )
    assert data.time == "2024-05-10 08:30:00.250000Z"
    assert np.degrees([data.latitude_rad, data.longitude_rad]) == pytest.approx([51.366, 12.309])
    assert (data.absolute_m, data.datum, data.surveyed) == (230.25, "ellipsoid", True)
    assert data.relative_m == 75.0
    assert (data.rtk_flag, data.rtk_std_m) == (50, (0.01, 0.02, 0.03))
    assert np.degrees(euler_from_quat(data.body_q_nb)) == pytest.approx([1, -3, 28])
    assert data.laser is None


def test_dji_s_own_spelling_of_longitude_is_taken(read):
    data = read(still(GpsLongitude=None, GpsLongtitude="-70.5"))
    assert math.degrees(data.longitude_rad) == pytest.approx(-70.5)


def test_the_camera_s_angles_are_one_rotation_where_dji_turns_the_roll(read):
    before = read(still(GimbalYawDegree="+29.97", GimbalPitchDegree="-89.98"))
    after = read(
        still(GimbalYawDegree="-149.98", GimbalPitchDegree="-90.00", GimbalRollDegree="+180.00")
    )
    assert degrees_between(before.camera_q_ng, after.camera_q_ng) < 0.1
    apart = read(still(GimbalYawDegree="-149.98"))
    assert degrees_between(before.camera_q_ng, apart.camera_q_ng) > 179


@given(st.floats(-180, 180), st.floats(-30, 90), st.floats(-20, 20))
def test_pix4d_s_angles_give_the_attitude_that_they_define(yaw, pitch, roll):
    """0, 0, 0 is straight down with the top north; pitch lifts the view towards the top."""
    fields = {"Yaw": yaw, "Pitch": pitch, "Roll": roll}
    xmp = properties(packet({f"Camera:{k}": f"{round(v * 100)}/100" for k, v in fields.items()}))
    q_ng = _attitude(xmp, ("Camera:{}",))
    axis_n, top_n = (matrix_from_quat(q_ng) @ BODY_OPTICAL @ v for v in ([0, 0, 1], [0, -1, 0]))
    y, p, r = np.radians([yaw, pitch, roll])
    nose = np.array([math.cos(p) * math.cos(y), math.cos(p) * math.sin(y), -math.sin(p)])
    belly_down = math.cos(p) * math.cos(r)  # Groves 2.24: the body's z axis in NED
    assert top_n == pytest.approx(nose, abs=2e-4)  # rounded to 0.01 deg
    assert axis_n[2] == pytest.approx(belly_down, abs=2e-4)


@pytest.mark.parametrize(
    "form", ["drone:Gimbal{}Degree", "drone-parrot:Camera{}Degree", "Camera:{}"]
)
def test_other_makers_angles_are_taken_where_dji_s_are_not(read, form):
    yaw, pitch, roll = ("12", "-60", "2") if "Camera:" not in form else ("12", "30", "2")
    own = {form.format(k): v for k, v in {"Yaw": yaw, "Pitch": pitch, "Roll": roll}.items()}
    none = {key: None for key in M3T if key.startswith("Gimbal")}
    q_ng = read(still(**none, **own)).camera_q_ng
    assert math.degrees(euler_from_quat(q_ng)[1]) == pytest.approx(-60, abs=0.1)


def test_a_structure_of_skydio_is_read(read):
    inside = "".join(
        f"<drone-skydio:{axis}>{angle}</drone-skydio:{axis}>"
        for axis, angle in (("Roll", 0), ("Pitch", -45), ("Yaw", 10))
    )
    fields = {
        "drone-skydio:Latitude": "51.3",
        "drone-skydio:Longitude": "12.3",
        "drone-skydio:AbsoluteAltitude": "200",
        "drone-skydio:CameraOrientationNED": inside,
    }
    data = read(jpeg_with(packet(fields, elements=True), model="VT300-Z_40"))
    assert np.degrees(euler_from_quat(data.camera_q_ng)) == pytest.approx([0, -45, 10])
    assert (data.absolute_m, data.datum) == (200, "ellipsoid")


@pytest.mark.parametrize(
    ("fields", "tags", "written"),
    [
        ({}, {"DateTimeOriginal": "2024:05:10 10:30:00"}, "2024-05-10 10:30:00"),
        (
            {},
            {"DateTimeOriginal": "2024:05:10 10:30:00", "OffsetTimeOriginal": "+02:00"},
            "2024-05-10 10:30:00+02:00",
        ),
        (
            {"xmp:CreateDate": "2024-05-10T10:30:01+02:00"},
            {"DateTimeOriginal": "2024:05:10 10:30:00", "SubsecTimeOriginal": "25"},
            "2024-05-10T10:30:01+02:00",
        ),
        ({"xmp:CreateDate": "2024-05-10"}, {}, ""),
    ],
)
def test_a_time_with_a_zone_comes_first(read, fields, tags, written):
    assert read(still(UTCAtExposure=None, tags=tags, **fields)).time == written


@pytest.mark.parametrize(
    ("fields", "model", "datum"),
    [
        ({"AltitudeType": "GpsFusionAlt"}, "ZH20T", "ellipsoid"),
        ({"AltitudeType": "PressureAlt"}, "ZH20T", ""),
        ({"AltitudeType": None}, "MAVIC2-ENTERPRISE-ADVANCED", ""),
        ({"AltitudeType": None}, "FLIR", "sea"),
    ],
)
def test_the_datum_is_that_of_type_and_model_or_unknown(read, fields, model, datum):
    assert read(still(model=model, **fields)).datum == datum


def test_without_own_position_exif_s_is_taken_and_zeros_are_none(read):
    """Its height is above sea level, and below zero with the reference 1 (EXIF 2.3)."""
    gps = {
        "GPSLatitudeRef": "S",
        "GPSLatitude": (33.0, 30.0, 36.0),
        "GPSLongitudeRef": "W",
        "GPSLongitude": (70.0, 0.0, 18.0),
        "GPSAltitudeRef": b"\1",
        "GPSAltitude": 2.5,
    }
    none = dict.fromkeys(("GpsLatitude", "GpsLongitude", "AbsoluteAltitude", "AltitudeType"))
    data = read(still(model="other", gps=gps, **none))
    assert np.degrees([data.latitude_rad, data.longitude_rad]) == pytest.approx([-33.51, -70.005])
    assert (data.absolute_m, data.datum) == (-2.5, "sea")
    assert math.isnan(read(still(GpsLatitude="0", GpsLongitude="0")).latitude_rad)


@pytest.mark.parametrize(
    ("fields", "size", "expected", "sigma"),
    [
        ({}, (640, 512), (758.33, 319.5), 0.02),
        (
            {"DewarpData": "2024-01-01;750,751,3,-2,-0.3,0.1,0.001,0.002,0"},
            (640, 512),
            (750, 322.5),
            0,
        ),
        ({"DewarpData": "2024-01-01;3700,3700,0,0,0,0,0,0,0"}, (640, 512), (758.33, 319.5), 0.02),
        (
            {"CalibratedFocalLength": "745", "CalibratedOpticalCenterX": "320"},
            *((640, 512), (745, 319.5), 0.02),
        ),
    ],
)
def test_a_calibration_in_the_picture_comes_before_the_data_sheet(
    read, fields, size, expected, sigma
):
    data = read(still(size=size, **fields))
    assert (data.camera.fx, data.camera.cx) == pytest.approx(expected, abs=0.01)
    assert data.focal_sigma == sigma


def test_a_lens_that_no_table_has_is_exif_s_or_unknown(read):
    tags = {"FocalLengthIn35mmFilm": 40}
    data = read(still(model="other", tags=tags))
    assert data.camera.fx == pytest.approx(40 / math.hypot(36, 24) * math.hypot(640, 512))
    assert data.focal_sigma == 0.05
    assert read(still(model="other")).camera is None


def test_a_tiff_with_xmp_is_a_still_and_a_cut_one_is_refused(read):
    tiff = picture("TIFF", xmp=packet(M3T))
    assert read(tiff, "DJI_0001_T.tif").rtk_flag == 50
    with pytest.raises(Unreadable, match="cut off"):
        read(tiff[: len(tiff) // 2], "DJI_0001_T.tif")


#: A billion laughs: each entity is ten of the one before.
BOMB = (
    '<!DOCTYPE x [<!ENTITY a0 "laugh">'
    + "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
    + "]><x>&a9;</x>"
)


def vast_jpeg() -> bytes:
    """Return a JPEG of 65000 x 65000 pixels by its header."""
    jpeg = still()
    frame = jpeg.index(b"\xff\xc0") + 5
    return jpeg[:frame] + struct.pack(">HH", 65000, 65000) + jpeg[frame + 4 :]


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: jpeg_with(BOMB.encode()), "document type or entities"),
        (lambda: jpeg_with(BOMB.encode("utf-16")), "document type or entities|damaged"),
        (lambda: jpeg_with(b"<a>" * 10_000), "nested too deeply"),
        (lambda: jpeg_with(b"<x:xmpmeta><a b='"), "XMP is damaged"),
        (lambda: jpeg_with(*[b"<a>" + b" " * 65_000] * 1600), "more than 1 MB"),
        (lambda: picture("TIFF", xmp=bytes(100_000_000)), "more than 32 MB"),
        (lambda: picture("TIFF", xmp=bytes(2_000_000)), "more than 1 MB"),
        (vast_jpeg, "million pixels"),
        (lambda: still()[:200], "cut off"),
        (lambda: b"\x89PNG\r\n\x1a\n", "no JPEG or TIFF"),
    ],
)
def test_a_hostile_file_is_refused_in_a_line_at_once(tmp_path, make, reason):
    path = tmp_path / "hostile.jpg"
    path.write_bytes(make())
    tracemalloc.start()
    begin = time.perf_counter()
    try:
        with pytest.raises(Unreadable, match=reason) as refused:
            still_metadata(path)
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert time.perf_counter() - begin < 1
    assert peak_bytes < 20e6
    assert "\n" not in str(refused.value)


def test_an_extension_of_xmp_is_put_together_and_bounded(read):
    text, head = packet(M3T), b"http://ns.adobe.com/xmp/extension/\0" + b"G" * 32
    halves = [(0, text[:400]), (400, text[400:])]
    parts = [segment(head + struct.pack(">II", len(text), at) + part) for at, part in halves]
    jpeg = picture("JPEG")
    assert read(jpeg[:2] + parts[1] + parts[0] + jpeg[2:]).rtk_flag == 50
    assert XMP_HEAD not in jpeg


def test_real_files_say_their_own_focal_lengths(shared):
    """The table's focal lengths are those that the pictures' EXIF gives in mm, to a percent."""
    pictures = [*(shared / "real_pictures").glob("*_strip/*.JPG")]
    assert len(pictures) > 50
    for path in pictures[::16]:
        exif = Image.open(path).getexif().get_ifd(0x8769)
        focal_mm = float(exif.get(37386, 9.0))  # the M2EA's pictures have none
        assert still_metadata(path).camera.fx * 0.012 == pytest.approx(focal_mm, rel=0.01)

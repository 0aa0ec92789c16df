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
"""Metadata of stills: times, angles and lenses in every form, and hostile files."""

from __future__ import annotations

import math
import struct
import time
import tracemalloc

import numpy as np
import pytest
from hypothesis import given, strategies as st
from made_stills import M3T, packet, picture, still

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


def test_the_camera_s_angles_are_one_rotation_where_dji_turns_the_roll(read):
    angles = [("+29.97", "-89.98", "+0.00"), ("-149.98", "-90.00", "+180.00")]
    before, after = (
        read(still(GimbalYawDegree=y, GimbalPitchDegree=p, GimbalRollDegree=r)).camera_q_ng
        for y, p, r in angles
    )
    turn = rotvec_from_quat(quat_multiply(quat_conjugate(before), after))
    assert math.degrees(float(np.linalg.norm(turn))) < 0.1


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
    ("form", "pitch"),
    [("drone:Gimbal{}Degree", -60), ("drone-parrot:Camera{}Degree", -60), ("Camera:{}", 30)],
)
def test_other_makers_angles_are_taken_where_dji_s_are_not(read, form, pitch):
    own = {form.format(k): str(v) for k, v in (("Yaw", 12), ("Pitch", pitch), ("Roll", 2))}
    none = {key: None for key in M3T if key.startswith("Gimbal")}
    q_ng = read(still(**none, **own)).camera_q_ng
    assert math.degrees(euler_from_quat(q_ng)[1]) == pytest.approx(-60, abs=0.1)


def test_structures_of_skydio_are_read(read):
    angles = {"Camera": (0, -45, 10), "Vehicle": (1, 2, 11)}
    structures = {
        f"drone-skydio:{what}OrientationNED": "".join(
            f"<drone-skydio:{axis}>{angle}</drone-skydio:{axis}>"
            for axis, angle in zip(("Roll", "Pitch", "Yaw"), of, strict=True)
        )
        for what, of in angles.items()
    }
    places = {"Latitude": "51.3", "Longitude": "12.3", "AbsoluteAltitude": "200"}
    fields = structures | {f"drone-skydio:{key}": text for key, text in places.items()}
    xmp = packet(fields, elements=True)
    data = read(picture(xmp=xmp, make="Skydio", model="VT300-Z_40"))
    attitudes = [euler_from_quat(q) for q in (data.camera_q_ng, data.body_q_nb)]
    assert np.degrees(attitudes) == pytest.approx(np.array([*angles.values()]))
    assert (data.position.absolute_m, data.position.datum) == (200, "ellipsoid")


def test_the_last_of_several_items_is_a_property_s():
    items = "<rdf:Seq><rdf:li>LWIR</rdf:li></rdf:Seq>"
    assert (
        properties(packet({"Camera:BandName": items}, elements=True))["Camera:BandName"] == "LWIR"
    )


EXPOSED = {"DateTimeOriginal": "2024:05:10 10:30:00"}


@pytest.mark.parametrize(
    ("fields", "tags", "written"),
    [
        ({}, EXPOSED, "2024-05-10 10:30:00"),
        ({}, EXPOSED | {"OffsetTimeOriginal": "+02:00"}, "2024-05-10 10:30:00+02:00"),
        ({"xmp:CreateDate": "2024-05-10T10:30:01+02:00"}, EXPOSED, "2024-05-10T10:30:01+02:00"),
        ({"xmp:CreateDate": "2024-05-10"}, {}, ""),
    ],
)
def test_a_time_with_a_zone_comes_first(read, fields, tags, written):
    assert read(still(UTCAtExposure=None, tags=tags, **fields)).time == written


def test_without_own_position_exif_s_is_taken(read):
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
    position = read(still(model="other", gps=gps, **none)).position
    assert np.degrees(position[:2]) == pytest.approx([-33.51, -70.005])
    assert (position.absolute_m, position.datum) == (-2.5, "sea")


DEWARP = "2024-01-01;{0},{0},3,-2,-0.3,0.1,0.001,0.002,0"


@pytest.mark.parametrize(
    ("fields", "focal_px", "centre_px", "sigma"),
    [
        ({}, 758.33, 319.5, 0.02),
        ({"DewarpData": DEWARP.format(750)}, 750, 322.5, 0),
        ({"DewarpData": DEWARP.format(3700)}, 758.33, 319.5, 0.02),  # the wide camera's
        ({"CalibratedFocalLength": "745", "CalibratedOpticalCenterX": "320"}, 745, 319.5, 0.02),
        # 40 mm as for 36 x 24 mm with its diagonal.
        ({"model": "other", "tags": {"FocalLengthIn35mmFilm": 40}}, 757.72, 319.5, 0.05),
    ],
)
def test_a_calibration_in_the_picture_comes_before_the_data_sheet_s_and_exif_s(
    read, fields, focal_px, centre_px, sigma
):
    data = read(still(**fields))
    assert (data.camera.fx, data.camera.cx) == pytest.approx((focal_px, centre_px), abs=0.01)
    assert data.focal_sigma == sigma


def test_a_tiff_with_xmp_is_a_still_and_a_cut_one_is_refused(read):
    tiff = still("TIFF")
    assert read(tiff, "DJI_0001_T.tif").position.rtk_flag == 50
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
        (lambda: picture(xmp=BOMB.encode()), "document type"),
        (lambda: picture(xmp=BOMB.encode("utf-16")), "no UTF-8"),
        (lambda: picture(xmp=b"<a>" * 20_000), "XMP is damaged"),
        (lambda: picture(xmp=b"<a>" * 4000 + b"</a>" * 4000), "no XMP"),
        (lambda: picture(xmp=b"<x:xmpmeta><a b='"), "XMP is damaged"),
        (lambda: picture("TIFF", bytes(100_000_000)), "more than 64 MB"),
        (lambda: picture("TIFF", bytes(2_000_000)), "XMP has more than 64 kB"),
        (vast_jpeg, "million pixels"),
        (lambda: still()[:200], "cut off"),
        (lambda: b"\xff\xd8" + b"\xff" * 60_000_000, "no end"),
        (lambda: b"\xff\xd8" + b"\xff\xe2\0\2" * 15_000_000, "no end"),
        (lambda: b"\x89PNG\r\n\x1a\n", "no JPEG or TIFF"),
    ],
)
def test_a_hostile_file_is_refused_in_a_line_at_once(tmp_path, make, reason):
    path = tmp_path / "hostile.jpg"
    path.write_bytes(make())
    tracemalloc.start()
    begin = time.process_time()
    try:
        with pytest.raises(Unreadable, match=reason) as refused:
            still_metadata(path)
        peak_bytes = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert time.process_time() - begin < 2  # each took 10 s and more once
    assert peak_bytes < 20e6
    assert "\n" not in str(refused.value)

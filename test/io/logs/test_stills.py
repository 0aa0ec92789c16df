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
"""A folder of stills: what is imported and refused, times, heights, the laser's test."""

from __future__ import annotations

import math
import re
from datetime import datetime, timezone

import numpy as np
import pytest
from made_stills import picture, still

from tirgeo_ros.core.frames.rotations import (
    Q_BODY_OPTICAL,
    euler_from_quat,
    quat_multiply,
)
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import locate
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import (
    CameraAttitudeSample,
    FixStatus,
    ImuSample,
    PositionSample,
    Source,
)
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.logs.forms import STILLS, form_of
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.stills import read_stills
from tirgeo_ros.io.pictures.embedded_metadata import embedded_metadata
from tirgeo_ros.io.pictures.still_metadata import still_metadata

LOCAL = {"UTCAtExposure": None, "tags": {"DateTimeOriginal": "2024:05:10 10:30:00"}}
UNKNOWN = np.zeros((6, 6))
BEGIN_NS = int(datetime(2024, 5, 10, 8, tzinfo=timezone.utc).timestamp()) * 10**9


def at(second: float, **fields) -> bytes:
    """Return a still of so many seconds after BEGIN_NS."""
    minutes, seconds = divmod(second, 60)
    hours, minutes = divmod(int(minutes), 60)
    text = f"2024:05:10 {8 + hours:02}:{minutes:02}:{seconds:09.6f}"
    return still(UTCAtExposure=text, **fields)


@pytest.fixture
def folder(tmp_path):
    def of(files: dict[str, bytes]):
        for name, data in files.items():
            path = tmp_path / "DCIM" / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
        return tmp_path / "DCIM"

    return of


def of_kind(contents, kind):
    return [sample for sample in contents.samples if isinstance(sample, kind)]


def refusals(contents) -> dict[str, str]:
    """Return the reason of each refused file, after checking that each has one line."""
    reasons = dict(contents.refused.keys())
    assert len(reasons) == contents.refused.total()
    return reasons


@pytest.mark.parametrize("elements", [False, True])
def test_a_still_gives_place_attitudes_and_its_own_bytes(folder, elements):
    path = (
        folder({"DJI_0001_T.JPG": at(1.25, elements=elements, GimbalPitchDegree="-60.00")})
        / "DJI_0001_T.JPG"
    )
    assert form_of(path) is STILLS
    contents = read_stills(path, LogOptions())
    (position,), (gimbal,), (imu,) = (
        of_kind(contents, kind) for kind in (PositionSample, CameraAttitudeSample, ImuSample)
    )
    assert position.stamp_ns == gimbal.stamp_ns == imu.stamp_ns == BEGIN_NS + 1_250_000_000
    assert (position.source, position.status) == (Source.RTK_POSITION, FixStatus.FIXED)
    assert np.sqrt(position.covariance_n.diagonal()) == pytest.approx([0.01, 0.02, 0.03])
    place = position.latitude_rad, position.longitude_rad
    assert (*np.degrees(place), position.height_m) == pytest.approx((51.366, 12.309, 230.25))
    assert np.degrees(euler_from_quat(gimbal.q_ng)) == pytest.approx([0, -60, 30])
    assert np.degrees(euler_from_quat(imu.autopilot_q_nb)) == pytest.approx([1, -3, 28])
    assert imu.is_attitude_alone
    (taken,) = contents.pictures
    assert taken.data == path.read_bytes()
    assert (taken.name, taken.stamp_ns) == ("DJI_0001_T.JPG", position.stamp_ns)
    assert taken.camera.fx == pytest.approx(758.3, abs=0.1)
    assert contents.parameters == {"confidence.focal_sigma": 0.02, "north.sigma_deg": 3.0}


@pytest.mark.parametrize(
    ("names", "form"),
    [
        (["a.jpg"], STILLS),
        (["100MEDIA/a.JPG"], STILLS),
        (["a.tif"], STILLS),
        (["a.txt"], None),
        *((["a.jpg", bag], None) for bag in ("metadata.yaml", "a_0.mcap", "a.db3")),
    ],
)
def test_a_folder_with_pictures_is_stills_but_a_bag_stays_one(folder, names, form):
    assert form_of(folder(dict.fromkeys(names, b"x"))) is form


def test_each_bad_file_is_a_line_and_the_others_are_read(folder):
    wide = at(2, ImageSource="WideCamera", size=(800, 600))
    files = {
        "100/1_T.JPG": at(1),
        "100/1_T.TIFF": picture("TIFF"),
        "100/2_T.JPG": at(2),
        **{f"100/{k}_W.JPG": wide for k in range(3)},
        "cut.JPG": at(3)[:-3000],
        "holiday.jpg": picture("JPEG"),
        "large_T.JPG": at(4, size=(1280, 1024)),
        "nothing.jpg": b"",
        "notes.txt": b"notes",
        "other_T.JPG": at(5, model="M30T"),
        "timeless.JPG": still(UTCAtExposure=None),
        "without.JPG": at(6, GimbalYawDegree=None, GpsLatitude="0", GpsLongitude="0"),
        ".hidden.jpg": b"x",
    }
    contents = read_stills(folder(files), LogOptions())
    reasons = refusals(contents)
    assert [still.name for still in contents.pictures] == ["100/1_T.JPG", "100/2_T.JPG"]
    assert contents.read == {"still": 2, "TIFF beside a still": 1}
    words = {
        **{
            f"100/{k}_W.JPG": "another camera, DJI M3T WideCamera 800x600, not DJI M3T thermal"
            for k in range(3)
        },
        "cut.JPG": "cut off",
        "holiday.jpg": "no XMP",
        "large_T.JPG": "thermal 1280x1024, not DJI M3T thermal 640x512",
        "nothing.jpg": "empty",
        "notes.txt": "no JPEG",
        "other_T.JPG": "another camera",
        "timeless.JPG": "no time",
        "without.JPG": "no angles of the camera, no position",
    }
    assert reasons.keys() == words.keys()
    assert all(words[name] in reason for name, reason in reasons.items())


def test_stills_of_one_second_are_spread_in_it_by_name(folder):
    names = ["a.JPG", "b.JPG", "c.JPG", "d.JPG"]
    path = folder({name: still(**LOCAL) for name in names})
    contents = read_stills(path, LogOptions(utc_offset_s=7200))
    pictures = list(contents.pictures)
    assert [each.name for each in pictures] == names
    after_ns = [each.stamp_ns - BEGIN_NS - 1800 * 10**9 for each in pictures]
    assert after_ns == [0, 25e7, 5e8, 75e7]
    assert any("4 stills share their second" in note for note in contents.notes)


@pytest.mark.parametrize(
    ("fields", "options", "height_m"),
    [
        ({}, {"takeoff_height_m": 100.0, "height": "sea"}, 230.25),  # RTK's says what it is
        ({"AltitudeType": "PressureAlt"}, {"takeoff_height_m": 100.0}, 175.0),
        ({"AltitudeType": "PressureAlt"}, {"height": "sea", "geoid_undulation_m": 44.0}, 274.25),
        ({"AltitudeType": "PressureAlt"}, {"height": "ellipsoid"}, 230.25),
        ({"AltitudeType": "GpsFusionAlt"}, {}, 230.25),
        ({"AltitudeType": None, "model": "FLIR"}, {"geoid_undulation_m": 44.0}, 274.25),
        ({"AltitudeType": "GpsFusionAlt"}, {"height": "sea", "geoid_undulation_m": 44.0}, 274.25),
    ],
)
def test_heights_become_ellipsoidal(folder, fields, options, height_m):
    contents = read_stills(folder({"a.JPG": still(**fields)}), LogOptions(**options))
    assert of_kind(contents, PositionSample)[0].height_m == pytest.approx(height_m)


@pytest.mark.parametrize(
    ("fields", "options", "option"),
    [
        (LOCAL, {}, "--utc-offset"),
        ({"AltitudeType": "PressureAlt"}, {}, "--height ellipsoid"),
        ({"AltitudeType": None, "model": "MAVIC2"}, {}, "--height ellipsoid"),
        ({"AltitudeType": "PressureAlt"}, {"height": "sea"}, "--geoid-undulation"),
        ({"AltitudeType": "PressureAlt"}, {"height": "takeoff"}, "--takeoff-height"),
    ],
)
def test_a_zone_or_a_datum_that_is_not_known_is_asked_for(folder, fields, options, option):
    with pytest.raises(LogError, match=option):
        read_stills(folder({"a.JPG": still(**fields)}), LogOptions(**options))


@pytest.mark.parametrize(
    ("flag", "source", "status"),
    [
        ("50", Source.RTK_POSITION, FixStatus.FIXED),
        ("34", Source.RTK_POSITION, FixStatus.FLOAT),
        ("16", Source.GPS_POSITION, FixStatus.SINGLE),
        ("0", Source.GPS_POSITION, FixStatus.SINGLE),
        (None, Source.GPS_POSITION, FixStatus.SINGLE),
    ],
)
def test_rtk_s_flag_is_the_status(folder, flag, source, status):
    fields = {"RtkStdLat": None} if flag is None else {}
    contents = read_stills(folder({"a.JPG": still(RtkFlag=flag, **fields)}), LogOptions())
    (position,) = of_kind(contents, PositionSample)
    assert (position.source, position.status) == (source, status)
    assert position.covariance_n.any() == (flag is not None)  # zero: unknown


def test_without_the_aircraft_s_attitude_a_note_says_so(folder):
    contents = read_stills(folder({"a.JPG": still(FlightYawDegree=None)}), LogOptions())
    assert np.degrees(euler_from_quat(of_kind(contents, ImuSample)[0].autopilot_q_nb)) == (
        pytest.approx([0, 0, 30])
    )
    assert any("attitude is not recorded" in note for note in contents.notes)


@pytest.mark.parametrize(
    ("name", "second", "flag", "status"),
    [
        ("DJI_20240510080001_0001_W.JPG", 1.4, "50", FixStatus.FIXED),
        ("DJI_20240510080001_0001_W.JPG", 1.4, "0", FixStatus.SINGLE),
        ("DJI_20240510080001_0002_W.JPG", 1.4, "50", FixStatus.SINGLE),
        ("DJI_20240510080001_0001_W.JPG", 9.0, "50", FixStatus.SINGLE),  # of another card
        ("100/DJI_20240510080001_0001_W.JPG", 1.4, "50", FixStatus.SINGLE),
    ],
)
def test_a_still_without_rtk_has_the_position_of_its_exposure_s_wide_one(
    folder, name, second, flag, status
):
    """As an M30T writes them."""
    wide = {"ImageSource": "WideCamera", "size": (800, 600), "RtkFlag": flag}
    normal = {"AltitudeType": "GpsFusionAlt", "RtkFlag": None, "GpsLatitude": "51.3"}
    files = {name: at(second, **wide), "DJI_20240510080001_0001_T_A1.JPG": at(1, **normal)}
    contents = read_stills(folder(files), LogOptions())
    (position,) = of_kind(contents, PositionSample)
    assert position.status == status
    is_wide_s = status == FixStatus.FIXED
    assert math.degrees(position.latitude_rad) == pytest.approx(51.366 if is_wide_s else 51.3)
    assert contents.read["position of another camera's still"] == is_wide_s


def test_stills_that_are_too_large_to_be_drawn_are_imported_and_it_is_said(folder):
    """Wide stills of 48 megapixels are; one of 100 is refused."""
    sizes = {"a.JPG": (8064, 6048), "b.JPG": (12_000, 9000)}
    path = folder({name: at(1, size=size, ImageSource="W") for name, size in sizes.items()})
    contents = read_stills(path, LogOptions())
    assert contents.read["still"] == 1
    assert any("8.4 million pixels: a map is not drawn" in note for note in contents.notes)
    assert refusals(contents) == {"b.JPG": "it has more than 50 million pixels"}


@pytest.mark.parametrize(
    ("second", "latitude", "flights"),
    [(10, "51.3670", 1), (10, "51.3700", 2), (1900, "51.3660", 2), (1700, "51.3660", 1)],
)
def test_a_landing_or_a_jump_begins_another_flight(folder, second, latitude, flights):
    """A thousandth of a degree are 111 m: 11 m/s, then 44 m/s."""
    path = folder({"a.JPG": at(0), "b.JPG": at(second, GpsLatitude=latitude)})
    contents = read_stills(path, LogOptions())
    noted = [note for note in contents.notes if "flights" in note]
    assert noted == (["2 flights, all imported: a.JPG to a.JPG; b.JPG to b.JPG"] * (flights - 1))
    assert contents.read["still"] == 2


def test_pictures_are_read_one_by_one_and_a_lost_one_is_named(folder):
    path = folder({"a.JPG": at(1), "b.JPG": at(2)})
    pictures = iter(read_stills(path, LogOptions()).pictures)
    assert next(pictures).name == "a.JPG"
    (path / "b.JPG").unlink()
    with pytest.raises(LogError, match=r"b\.JPG: cannot be read"):
        next(pictures)


@pytest.mark.parametrize(
    ("name", "stills", "refused"),
    [
        ("real_pictures/h20t_strip", 64, 0),
        ("real_pictures/m2ea_strip", 17, 1),  # its licence
        ("thermal_samples", 0, 6),  # pictures without metadata, and a text
        ("foreign_logs/dji/rjpeg", 2, 1),  # of two cameras
    ],
)
def test_every_real_file_is_imported_or_refused_by_name(shared, name, stills, refused):
    folder = shared / name
    options = LogOptions(utc_offset_s=0, takeoff_height_m=0.0)
    contents = read_stills(folder, options)
    names = {each.name for each in contents.pictures} | refusals(contents).keys()
    assert (contents.read["still"], len(contents.refused)) == (stills, refused)
    assert names == {path.name for path in folder.iterdir()}


def test_our_ray_through_the_middle_meets_the_laser_s_place(shared):
    """The laser shares the attitude and looks beside the lens: geometry alone, at 63 to 97 m."""
    apart_m = []
    for path in (shared / "real_pictures" / "h20t_strip").glob("*.JPG"):
        data, (size, _, xmp) = still_metadata(path), embedded_metadata(path)
        plane = TangentPlane(*data.position[:3])
        pose = CameraPose(0, np.zeros(3), quat_multiply(data.camera_q_ng, Q_BODY_OPTICAL), UNKNOWN)
        middle = (np.array([size]) - 1) / 2
        latitude, longitude, height_m = (
            float(xmp[f"LRFTarget{x}"]) for x in ("Lat", "Lon", "AbsAlt")
        )
        (ground_n,), _ = locate(data.camera, pose, middle, plane, height_m)
        laser_n = plane.ned_from_geodetic(*np.radians([latitude, longitude]), height_m)
        apart_m.append(math.hypot(*(ground_n - laser_n)[:2]))
    assert len(apart_m) == 64
    assert np.median(apart_m) <= 0.35
    assert np.percentile(apart_m, 95) <= 0.75


def test_a_note_says_at_which_heights_the_laser_met_the_ground(shared):
    """In the datum of the positions: 24 m above the take-off in the first still's own words."""
    options = LogOptions(takeoff_height_m=100.0)
    notes = read_stills(shared / "real_pictures/h20t_strip", options).notes
    (note,) = (note for note in notes if note.startswith("the laser"))
    low_m, high_m, middle_m = map(float, re.findall(r"\d+\.\d", note))
    assert 95.0 < low_m < middle_m < high_m < 135.0
    one = shared / "real_pictures/h20t_strip/DJI_20220602143532_0191_T.JPG"
    (note,) = (x for x in read_stills(one, options).notes if x.startswith("the laser"))
    assert "at 123.9 to 123.9 m" in note  # LRFTargetAlt +23.917

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
"""DJI's subtitles: every variant, against regular expressions of the test's own."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from foreign_logs import OPTIONS, SRT

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, PositionSample
from tirgeo_ros.io.logs.dji_srt import is_srt, read_srt
from tirgeo_ros.io.logs.log_contents import LogOptions

#: Name -> cues, positions, attitudes; and whether latitude stands first in GPS(...).
FILES = {
    "air2s": (17, 17, 0),
    "air3s": (5, 5, 0),
    "avata360_gimbal": (5, 5, 5),
    "broken_incomplete": (20, 19, 0),
    "broken_incomplete2": (6, 4, 0),
    "matrice_300": (300, 300, 0),
    "mavic3": (300, 300, 0),
    "mavic_2_style": (300, 0, 0),
    "mavic_2pro": (300, 0, 0),
    "mavic_2zoom": (300, 300, 0),
    "mavic_air2": (25, 25, 0),
    "mavic_air_no_gps": (2, 0, 0),
    "mavic_mini": (117, 117, 0),
    "mavic_pro": (300, 300, 0),
    "mavic_pro_buggy": (300, 284, 0),
    "mini5pro": (5, 5, 0),
    "mini_folsom_DJI_0031": (39, 39, 0),
    "neo2": (5, 5, 0),
    "neo2_no_gps": (6, 6, 0),  # three of 0, 0, which the import refuses
    "old_format": (300, 300, 0),
    "p4_rtk": (55, 55, 55),
    "p4p": (5, 5, 0),
    "p4rtk_mix_mavic2pro": (12, 12, 6),
}
NUMBER = r"(-?[\d.]+)"


def places(text, name):
    """Latitudes and longitudes, deg, in the order of the file."""
    result = []
    for line in text.splitlines():
        brackets = re.search(rf"latitude ?: {NUMBER}\] \[longt?itude ?: {NUMBER}\]", line)
        gps = re.search(rf"GPS ?\({NUMBER}, ?{NUMBER},", line)
        if brackets:
            result.append((float(brackets[1]), float(brackets[2])))
        elif gps and name == "matrice_300":
            result.append((float(gps[1]), float(gps[2])))
        elif gps:
            result.append((float(gps[2]), float(gps[1])))
    return result


def heights(text, takeoff_m, undulation_m):
    """Ellipsoidal heights: above the take-off where it is written, else above sea level."""
    result = []
    for line in text.splitlines():
        relative = re.search(rf"(?:rel_alt: |BAROMETER:|Hb:| H ){NUMBER}", line)
        plain = re.search(rf"\[altitude: {NUMBER}\]", line)
        if "GPS(N/A" in line:
            continue
        if relative:
            result.append(float(relative[1]) + takeoff_m)
        elif plain:
            result.append(float(plain[1]) + undulation_m)
    return result


def read(folder, text, **options):
    path = folder / "DJI_0001.SRT"
    path.write_text(text, encoding="utf-8")
    return read_srt(path, LogOptions(**options))


def of(contents, kind):
    return [sample for sample in contents.samples if isinstance(sample, kind)]


@pytest.mark.parametrize("name", FILES)
def test_each_real_variant(shared, name):
    path = shared / "foreign_logs" / "dji" / "srt" / f"{name}.srt"
    text = path.read_text(encoding="utf-8-sig")
    assert is_srt(path.read_bytes()[:4096])
    contents = read_srt(path, OPTIONS)
    positions, attitudes = of(contents, PositionSample), of(contents, CameraAttitudeSample)
    assert (contents.read["cue"], len(positions), len(attitudes)) == FILES[name]
    assert contents.refused.total() == FILES[name][0] - len(positions)
    if positions:
        result = np.degrees([(p.latitude_rad, p.longitude_rad) for p in positions])
        np.testing.assert_allclose(result, places(text, name), atol=1e-12)
        expected = heights(text, OPTIONS.takeoff_height_m, OPTIONS.geoid_undulation_m)
        np.testing.assert_allclose([p.height_m for p in positions], expected[: len(positions)])
    gimbals = re.findall(rf"G\.PRY \({NUMBER}°, {NUMBER}°, {NUMBER}°\)", text)
    angles = np.degrees([euler_from_quat(a.q_ng) for a in attitudes])
    if gimbals:  # pitch, roll, yaw
        np.testing.assert_allclose(angles[:, [1, 0, 2]], np.array(gimbals, float), atol=1e-9)
    stamps = [sample.stamp_ns for sample in positions]
    assert stamps == sorted(stamps)


def test_times_are_local(tmp_path):
    contents = read(tmp_path, SRT, utc_offset_s=7200, geoid_undulation_m=45.0)
    first, second = of(contents, PositionSample)
    assert first.stamp_ns == 1_718_091_879_125_000_000  # 07:44:39.125 UTC
    assert second.stamp_ns - first.stamp_ns == 33_000_000
    assert first.height_m == pytest.approx(585.25)
    assert not first.covariance_n.any()  # unknown
    roll, pitch, yaw = np.degrees(euler_from_quat(of(contents, CameraAttitudeSample)[0].q_ng))
    assert (roll, pitch, yaw) == pytest.approx((1.5, -30.0, -162.5))


def test_cues_before_the_first_date_are_placed_by_the_video(shared):
    """The mixed file: six cues of a second each without a date, then dated ones."""
    path = shared / "foreign_logs" / "dji" / "srt" / "p4rtk_mix_mavic2pro.srt"
    stamps = [p.stamp_ns for p in of(read_srt(path, OPTIONS), PositionSample)]
    begins = re.findall(r"00:15:(\d\d),(\d\d\d) -->", path.read_text(encoding="utf-8-sig"))
    times_ns = [int(second) * 10**9 + int(milli) * 10**6 for second, milli in begins]
    assert stamps[0] - stamps[6] == times_ns[0] - times_ns[6]


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (SRT, {"geoid_undulation_m": 45.0}, "local, without a zone: give --utc-offset"),
        (SRT, {"utc_offset_s": 0}, "above mean sea level: give .*--geoid-undulation"),
        (SRT.replace("abs_alt", "x"), {"utc_offset_s": 0}, "take-off: give .*--takeoff-height"),
        (
            re.sub(r"\[rel_alt.*?\]", "[altitude: 9.5]", SRT),
            {"utc_offset_s": 0},
            "what its altitude is above: give --height sea",
        ),
        (SRT.replace("2024-06-11", ""), {}, "no date in it: give .* --start-time"),
    ],
)
def test_what_it_leaves_open_is_asked_for(tmp_path, text, options, message):
    with pytest.raises(LogError, match=rf"DJI_0001\.SRT: .*{message}"):
        read(tmp_path, text, **options)


@pytest.mark.parametrize(
    "line",
    [
        "RTK (120.083799, -30.213635, 28), HOME (120.084146, -30.214243, 103.55m), H 76.2m",
        "GPS (+120.083799, -30.213635, 28.5), D 75.36m, H 76.2m",
        "GPS(-30.213635,120.083799,0.0M) BAROMETER:76.2M",
    ],
)
def test_ways_to_write_a_place(tmp_path, line):
    text = f"1\n00:00:00,000 --> 00:00:01,000\n{line}\n"
    (result,) = of(read(tmp_path, text, start_ns=0, takeoff_height_m=100.0), PositionSample)
    assert math.degrees(result.latitude_rad) == pytest.approx(-30.213635)
    assert math.degrees(result.longitude_rad) == pytest.approx(120.083799)
    assert result.height_m == pytest.approx(176.2)


def test_other_subtitles_are_none(tmp_path):
    assert not is_srt(b"WEBVTT\n\n00:00.000 --> 00:01.000\n")
    film = "1\n00:00:01,000 --> 00:00:02,000\nGood evening.\n"
    contents = read(tmp_path, film, start_ns=0)
    assert not contents.samples
    assert contents.refused == {("cue", "no position in it"): 1}


@pytest.mark.parametrize("byte", [0xFF, 0x80])
def test_one_byte_that_is_not_utf_8_costs_its_cue_alone(shared, tmp_path, byte):
    """At the degree sign of the first cue: the angles of all others are read as before."""
    whole = shared / "foreign_logs" / "dji" / "srt" / "p4_rtk.srt"
    content = bytearray(whole.read_bytes())
    content[content.index("°".encode(), content.index(b"G.PRY"))] = byte
    path = tmp_path / "damaged.srt"
    path.write_bytes(content)
    result, right = read_srt(path, OPTIONS), read_srt(whole, OPTIONS)
    assert len(of(result, CameraAttitudeSample)) == 54
    assert result.refused == {("cue", "its gimbal angles cannot be read"): 1}
    for kind, lost in ((CameraAttitudeSample, 1), (PositionSample, 0)):
        assert [repr(item) for item in of(result, kind)] == [
            repr(s) for s in of(right, kind)[lost:]
        ]


def test_one_wrong_digit_in_the_first_date_or_begin_moves_no_other_cue(shared, tmp_path):
    folder = shared / "foreign_logs" / "dji" / "srt"
    for name, right, wrong in (
        ("p4rtk_mix_mavic2pro", "2020-10-07 12:00:10,123", "2020-10-07 12:00:40,123"),
        ("mini_folsom_DJI_0031", "00:00:00,000 -->", "00:00:50,000 -->"),
    ):
        text = (folder / f"{name}.srt").read_text(encoding="utf-8-sig")
        assert right in text
        path = tmp_path / f"{name}.srt"
        path.write_text(text.replace(right, wrong, 1))
        moved = [
            abs(result.stamp_ns - expected.stamp_ns)
            > 100_000_000  # dates and video differ by 40 ms
            for result, expected in zip(
                of(read_srt(path, OPTIONS), PositionSample),
                of(read_srt(folder / f"{name}.srt", OPTIONS), PositionSample),
                strict=True,
            )
        ]
        assert sum(moved) == 1

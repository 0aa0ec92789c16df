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
"""RTKLIB's solutions: against an independent parse, in all ways in which it writes them."""

from __future__ import annotations

import math
import re
from datetime import datetime, timezone

import numpy as np
import pytest
from foreign_logs import OPTIONS, POS

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import FixStatus, PositionSample, VelocitySample
from tirgeo_ros.io.logs.forms import form_of
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.rtklib_pos import is_pos, read_pos

#: The two epochs of every variant; simulated, GPST 10:00 and 14:00, here in UTC.
EPOCHS = [datetime(2023, 1, 8, hour, 59, 42, tzinfo=timezone.utc) for hour in (9, 13)]
VARIANTS = (
    *("ecef__ecef_gpst2_111_dd", "lla__lla_gpst2_111_dd", "lla__lla_gpst2_111_ds"),
    *("lla__lla_gpst_000_dd", "lla__lla_jst_111_dd", "lla__lla_utc_111_dd"),
    "corrupt__header_missing",
)


def kinds(contents):
    return tuple(
        [s for s in contents.samples if isinstance(s, kind)]
        for kind in (PositionSample, VelocitySample)
    )


def written(folder, text):
    path = folder / "rover.pos"
    path.write_text(text)
    return path


def test_the_walk_is_what_its_columns_say(shared):
    """GPST, seconds from numpy's own parse; heights above sea level; sigmas north, east, up."""
    path = shared / "foreign_logs" / "rtklib" / "walk_0827_120s.pos"
    table = [line.split() for line in path.read_text().splitlines()[1:]]
    numbers = np.array([row[2:] for row in table], float)
    utc_ns = [
        np.datetime64(f"{row[0].replace('/', '-')}T{row[1]}000000").astype(int) - 18 * 10**9
        for row in table
    ]
    positions, velocities = kinds(read_pos(path, OPTIONS))
    assert [p.stamp_ns for p in positions] == [v.stamp_ns for v in velocities] == utc_ns
    places = [(p.latitude_rad, p.longitude_rad) for p in positions]
    np.testing.assert_allclose(np.degrees(places), numbers[:, :2], atol=1e-12)
    np.testing.assert_allclose([p.height_m for p in positions], numbers[:, 2] - 21.387, atol=1e-9)
    assert [p.status for p in positions] == [{1: 2, 2: 1}[int(q)] for q in numbers[:, 3]]
    sigmas = np.sqrt([p.covariance_n.diagonal() for p in positions])
    np.testing.assert_allclose(sigmas, numbers[:, 5:8])
    flown = np.array([v.velocity_n for v in velocities]) * [1, 1, -1]
    np.testing.assert_allclose(flown, numbers[:, 13:16])
    sigmas = np.sqrt([v.covariance_n.diagonal() for v in velocities])
    np.testing.assert_allclose(sigmas, numbers[:, 16:19])


@pytest.mark.parametrize("name", VARIANTS)
def test_all_variants_are_the_same_solution(shared, name):
    """Formats round: a place to 1e-5 arc seconds or 0.1 mm, a sigma to 0.1 mm."""
    path = shared / "foreign_logs" / "rtklib" / "variants" / f"{name}.pos"
    assert is_pos(path.read_bytes())
    positions, velocities = kinds(read_pos(path, OPTIONS))
    assert [p.stamp_ns for p in positions] == [round(t.timestamp()) * 10**9 for t in EPOCHS]
    # two have no line that tells the datum, so that of the options (sea level) holds
    is_open = name in {"corrupt__header_missing", "lla__lla_gpst_000_dd"}
    offset_m = OPTIONS.geoid_undulation_m if is_open else 0.0
    first = positions[0]
    assert math.degrees(first.latitude_rad) == pytest.approx(29.999994371, abs=3e-9)
    assert math.degrees(first.longitude_rad) == pytest.approx(94.999992812, abs=3e-9)
    assert first.height_m - offset_m == pytest.approx(-9.3615, abs=2e-4)
    assert first.status is FixStatus.SINGLE
    if "gpst_000" not in name:
        expected = [0.01216, 0.00473, 0.00324]
        np.testing.assert_allclose(velocities[0].velocity_n, expected, atol=1e-5)
    # sdn, sde, sdu = 2.5813, 2.2781, 7.1259; sdne 0.7786, sdeu -2.0020, sdun -2.6572; up is -down
    north_east, east_down, down_north = 0.7786**2, 2.0020**2, 2.6572**2
    variances = np.square([2.5813, 2.2781, 7.1259])
    expected = np.array(
        [
            [variances[0], north_east, down_north],
            [north_east, variances[1], east_down],
            [down_north, east_down, variances[2]],
        ]
    )
    # 0.05 mm of each root: d(r^2) = 2 r dr, through a rotation at most three terms of it
    atol = 6 * 7.1259 * 5e-5 if name.startswith("ecef") else 1e-9
    np.testing.assert_allclose(first.covariance_n, expected, rtol=0, atol=atol)


def test_a_corrupt_line_is_refused_and_the_rest_read(shared):
    path = shared / "foreign_logs" / "rtklib" / "variants" / "corrupt__inside_data.pos"
    contents = read_pos(path, OPTIONS)
    assert len(kinds(contents)[0]) == 2
    assert contents.refused == {("solution", "its columns are not those of the header"): 1}


def test_signed_roots_become_a_covariance(tmp_path):
    first, second = kinds(read_pos(written(tmp_path, POS), LogOptions()))[0]
    expected = np.array([[1e-4, 25e-6, -49e-6], [25e-6, 4e-4, 36e-6], [-49e-6, 36e-6, 9e-4]])
    np.testing.assert_allclose(first.covariance_n, expected, atol=1e-15)
    assert (first.status, second.status) == (FixStatus.FIXED, FixStatus.FLOAT)
    assert first.stamp_ns == 1_718_091_879 * 10**9  # 07:44:57 GPST is 07:44:39 UTC


def test_a_header_holds_until_the_next(tmp_path):
    """Files that were joined: the second part is in UTC."""
    joined = POS + POS.replace("GPST", " UTC").replace("2024/06/11", "2024/06/12")
    stamps = [p.stamp_ns for p in kinds(read_pos(written(tmp_path, joined), LogOptions()))[0]]
    assert stamps[2] - stamps[0] == (86400 + 18) * 10**9


def test_south_of_the_equator_by_less_than_a_degree(tmp_path):
    text = POS.replace("latitude(deg)", "latitude(d'\")").replace("48.137154000", "-00 30 36.0")
    text = text.replace("11.576124000", "-11 34 34.0464").replace("48.137155000", "corrupt")
    (position,) = kinds(read_pos(written(tmp_path, text), LogOptions()))[0]
    assert math.degrees(position.latitude_rad) == pytest.approx(-0.51)
    assert math.degrees(position.longitude_rad) == pytest.approx(-11.576124)


@pytest.mark.parametrize("separator", [",", ";", "\t", " , "])
@pytest.mark.parametrize("header", [True, False])
def test_columns_with_another_separator(tmp_path, separator, header):
    """RTKPOST asks for it; date and time of day stay separated by a blank."""
    lines = [re.sub(r"(?<=[^\s%]) +(?!\d\d:)", separator, line) for line in POS.splitlines()]
    lines[0] = POS.splitlines()[0]
    path = written(tmp_path, "\ufeff" + "\n".join(lines if header else lines[2:]))
    assert form_of(path, columns=True).name == "RTKLIB .pos"
    result = read_pos(path, LogOptions(time_scale="gpst", height="ellipsoid"))
    expected = read_pos(written(tmp_path, POS), LogOptions())
    assert not result.refused
    for item, other in zip(result.samples, expected.samples, strict=True):
        assert (item.stamp_ns, item.latitude_rad) == (other.stamp_ns, other.latitude_rad)
        assert item.height_m == other.height_m
        np.testing.assert_array_equal(item.covariance_n, other.covariance_n)


def test_a_solution_in_utf16(tmp_path):
    """As PowerShell writes what a program prints."""
    path = tmp_path / "rover.pos"
    path.write_text(POS, encoding="utf-16")
    assert form_of(path).name == "RTKLIB .pos"
    assert len(kinds(read_pos(path, LogOptions()))[0]) == 2


def test_weeks_and_seconds_of_another_table_are_none():
    """An INS writes them too, and more columns than a solution has."""
    assert is_pos(b"2316 200697.000 48.137 11.576 560.1 1 20" + b" 0.01" * 8)
    assert is_pos(b"2316,200697,48.137,11.576,560.1,1,20" + b",0.01" * 8)
    assert not is_pos(b"2316 200697.000 48.137 11.576 560.1 1.25 -0.02" + b" 0.01" * 12)


@pytest.mark.parametrize(
    ("change", "options", "message"),
    [
        (("height=WGS84/ellipsoidal", ""), {}, "give --height ellipsoid, or --height sea"),
        (("ellipsoidal", "geodetic"), {}, "above mean sea level: give .* --geoid-undulation"),
        (("% ", "# "), {}, "no header with the time scale: give --time-scale gpst or utc"),
        (("latitude(deg)", "e-baseline(m)"), {}, "e-baseline.* relative to a base"),
    ],
)
def test_what_it_leaves_open_is_asked_for(tmp_path, change, options, message):
    path = written(tmp_path, POS.replace(*change))
    with pytest.raises(LogError, match=rf"rover\.pos: .*{message}"):
        read_pos(path, LogOptions(**options))


@pytest.mark.parametrize(
    "said", ["height=WGS74/ellipsoidal", "height=WGS84/ellipsoidAl", "height=Tokyo/geodetic"]
)
def test_a_datum_that_is_not_known_is_not_taken_from_the_options(tmp_path, said):
    """Else one damaged byte would move every height by the undulation."""
    path = written(tmp_path, POS.replace("height=WGS84/ellipsoidal", said))
    with pytest.raises(LogError, match=r"has not height=WGS84/.* mend the line"):
        read_pos(path, OPTIONS)

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
"""DJI's marks of stills, against what their lines say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tirgeo_ros.core.types.measurements import FixStatus, Source
from tirgeo_ros.io.logs.dji_mrk import is_mrk, read_mrk
from tirgeo_ros.io.logs.forms import form_of
from tirgeo_ros.io.logs.log_contents import LogOptions

LINE = (
    "{0}\t200697.125000\t[2318]\t   -40,N\t     0,E\t    86,V\t48.13715400,Lat\t11.57612400,Lon\t"
    "560.100,Ellh\t0.010, 0.020, 0.030\t{1},Q\n"
)


def test_marks_become_positions(tmp_path):
    path = tmp_path / "Timestamp.MRK"
    qualities = (50, 34, 16, 0)
    path.write_text("".join(LINE.format(n, q) for n, q in enumerate(qualities)) + "5\t20\n\n")
    assert form_of(path).read is read_mrk
    contents = read_mrk(path, LogOptions())
    statuses = [FixStatus.FIXED, FixStatus.FLOAT, FixStatus.SINGLE]
    assert [sample.status for sample in contents.samples] == statuses
    (fixed, *_) = contents.samples
    assert fixed.source is Source.RTK_POSITION
    assert fixed.stamp_ns == 1_718_091_879_125_000_000  # 07:44:57.125 of GPS, 18 s ahead
    assert math.degrees(fixed.latitude_rad) == pytest.approx(48.137154)
    assert math.degrees(fixed.longitude_rad) == pytest.approx(11.576124)
    assert fixed.height_m == pytest.approx(560.1)
    np.testing.assert_allclose(fixed.covariance_n, np.diag([1e-4, 4e-4, 9e-4]))
    assert contents.read == {"mark": 5}
    assert contents.refused == {
        ("mark", "no position in it"): 1,
        ("mark", "not a whole line"): 1,
    }


def test_without_rtk_they_are_ordinary_positions(tmp_path):
    path = tmp_path / "a.MRK"
    path.write_text(LINE.format(1, 16))
    assert [sample.source for sample in read_mrk(path, LogOptions()).samples] == [
        Source.GPS_POSITION
    ]
    assert not is_mrk(b"1\t200697.125000\tx")

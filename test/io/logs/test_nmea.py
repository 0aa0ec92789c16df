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
"""NMEA: positions and headings of real receivers, and of made sentences."""

from __future__ import annotations

import math
import re
from functools import reduce

import numpy as np
import pytest

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import FixStatus, HeadingSample, PositionSample, Source
from tirgeo_ros.io.logs.forms import NMEA, UBX, form_of
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.nmea import read_nmea

pytest.importorskip("pynmeagps")


def line(body):
    """Return a sentence with its checksum, the XOR of its characters."""
    return f"${body}*{reduce(lambda a, b: a ^ b, body.encode()):02X}\r\n"


def gga(time, quality=4, height="520.0,M,45.0,M", latitude="4808.22924,N"):
    return line(f"GNGGA,{time},{latitude},01134.56744,E,{quality},20,0.6,{height},1.0,0001")


def rmc(time, date="110624"):
    return line(f"GNRMC,{time},A,4808.22924,N,01134.56744,E,0.0,,{date},,,R")


def of(contents, kind):
    return [sample for sample in contents.samples if isinstance(sample, kind)]


def read(folder, text, **options):
    path = folder / "log.nmea"
    path.write_bytes(text.encode())
    return read_nmea(path, LogOptions(**options))


def test_gst_has_the_covariance_of_its_epoch(tmp_path):
    gst = line("GNGST,074439.20,1.0,0.02,0.01,10.0,0.010,0.020,0.030")
    contents = read(tmp_path, rmc("074439.00") + gga("074439.00", 5) + gga("074439.20") + gst)
    first, second = of(contents, PositionSample)
    assert second.stamp_ns == 1_718_091_879_200_000_000
    assert (first.status, second.status) == (FixStatus.FLOAT, FixStatus.FIXED)
    assert second.source is Source.RTK_POSITION
    assert math.degrees(second.latitude_rad) == pytest.approx(48.137154)
    assert math.degrees(second.longitude_rad) == pytest.approx(11.576124)
    assert second.height_m == pytest.approx(565.0)
    np.testing.assert_allclose(second.covariance_n, np.diag([1e-4, 4e-4, 9e-4]))
    assert not first.covariance_n.any()  # unknown


def test_midnight_before_and_long_after_the_only_date(tmp_path):
    """The date is behind the first sentence, of the day after; another midnight has none."""
    times = ("120000.00", "235959.50", "000000.50", "110000.00", "220000.00", "040000.00")
    first, *others = map(gga, times)
    text = first + rmc("120000.00") + "".join(others)
    stamps = [position.stamp_ns for position in of(read(tmp_path, text), PositionSample)]
    hours = (np.array(stamps) - 1_718_107_200 * 10**9) / 3.6e12  # from 2024-06-11 12:00
    np.testing.assert_allclose(hours, [0, 12, 12, 23, 34, 40], atol=1e-3)
    text = gga("235959.50") + rmc("000000.00", "120624") + gga("000000.50")
    stamps = [position.stamp_ns for position in of(read(tmp_path, text), PositionSample)]
    assert stamps == [1_718_150_399_500_000_000, 1_718_150_400_500_000_000]


def test_what_is_refused_is_counted(tmp_path):
    bad = gga("074440.00").replace("20,0.6", "21,0.6")
    text = rmc("074439.00") + bad + gga("074441.00", 0) + gga("074442.00", 6) + gga("07")[:-9]
    contents = read(tmp_path, text + gga("074443.00", 1) * 2)
    (position,) = of(contents, PositionSample)
    assert position.source is Source.GPS_POSITION
    assert contents.refused == {
        ("GGA", "cut off, or its checksum is wrong"): 2,
        ("GGA", "no fix, or none of satellites"): 2,
        ("GGA", "another one of its epoch is used"): 1,
    }
    assert not of(read(tmp_path, gga("074439.00")), PositionSample)  # no date
    with pytest.raises(LogError, match=r"mean sea level: give .*--geoid-undulation"):
        read(tmp_path, rmc("074439.00") + gga("074439.00", height="520.0,M,,"))


def test_a_right_checksum_over_damaged_fields_is_refused(tmp_path):
    """One in 256 has one by chance."""
    cut = line("GNGGA,074440.00,4808.22924,N"), line("GNGST,074440.00,x"), line("PSTI,035,074440")
    contents = read(tmp_path, rmc("074439.00") + "".join(cut) + line("GNHDT,2p.5,T"))
    assert not contents.samples
    assert {name for name, _ in contents.refused} == {"GGA", "GST", "PSTI,035", "HDT"}


def test_a_real_moving_base(shared, tmp_path):
    """SkyTraq at rest: 0.17 deg, and a baseline of 0.906 m; PSTI,036 repeats its direction."""
    path = shared / "real_pictures" / "gnss_heading" / "skytraq-PX1172RH_DS.log"
    assert form_of(path) is NMEA
    contents = read_nmea(path, LogOptions(baseline_m=0.9))
    headings = np.degrees([heading.heading_rad for heading in of(contents, HeadingSample)])
    written = re.findall(r"\$PSTI,036,[\d.]+,\d+,([\d.]+)", path.read_text(errors="replace"))
    np.testing.assert_allclose(headings, np.array(written, float))
    assert np.std(headings) == pytest.approx(0.17, abs=0.01)
    turned = LogOptions(baseline_rad=math.radians(90), rover_first=True)
    others = np.degrees([h.heading_rad for h in of(read_nmea(path, turned), HeadingSample)])
    np.testing.assert_allclose((others - headings) % 360, 90.0)
    direction = read(tmp_path, path.read_text(errors="replace").replace("$PSTI,035", "$PSTI,x35"))
    alone = np.degrees([heading.heading_rad for heading in of(direction, HeadingSample)])
    np.testing.assert_allclose(alone, headings)  # of PSTI,036
    wrong = read_nmea(path, LogOptions(baseline_m=1.2))
    assert not of(wrong, HeadingSample)  # nor those of PSTI,036 and THS
    assert wrong.refused["PSTI,035", "its length is more than 0.1 m from the baseline's"] == 9


def test_a_real_ins_in_a_turn(shared):
    path = shared / "real_pictures" / "gnss_heading" / "rst39.log"
    headings = of(read_nmea(path, LogOptions(geoid_undulation_m=-34.0)), HeadingSample)
    assert len(headings) == 100
    assert set(np.diff([heading.stamp_ns for heading in headings])) == {40_000_000}
    assert math.degrees(headings[0].heading_rad) == pytest.approx(10.51)
    assert math.degrees(headings[0].variance_rad2 ** 0.5) == pytest.approx(0.555)


def test_a_heading_without_a_time_has_that_of_its_epoch(shared, tmp_path):
    """It is before the GGA in Hemisphere's log, and behind it in another."""
    path = shared / "real_pictures" / "gnss_heading" / "hemi.log"
    contents = read_nmea(path, LogOptions())
    stamps = {position.stamp_ns for position in of(contents, PositionSample)}
    assert {heading.stamp_ns for heading in of(contents, HeadingSample)} <= stamps
    hdt = line("GNHDT,244.28,T")
    text = rmc("074439.00") + gga("074439.00") + hdt + gga("074440.00") + hdt
    contents = read(tmp_path, text)
    stamps = [position.stamp_ns for position in of(contents, PositionSample)]
    assert [heading.stamp_ns for heading in of(contents, HeadingSample)] == stamps


def test_every_real_log(shared):
    """Positions agree with the text; one that has both protocols is read as the one with a fix."""
    folder = shared / "foreign_logs" / "ublox"
    path = folder / "nmea_rtk.nmea"
    contents = read_nmea(path, LogOptions())
    assert len(of(contents, PositionSample)) == path.read_text().count("GGA,") == 122
    fixed = [p for p in of(contents, PositionSample) if p.status is FixStatus.FIXED]
    assert len(fixed) == len(re.findall(r"GGA,(?:[^,]*,){5}4,", path.read_text()))
    assert form_of(folder / "walk_0827_pvt_nmea.ubx") is UBX
    folder = shared / "real_pictures" / "gnss_heading"
    both = folder / "ublox-zed-f9p_hpg1.11.log"  # no NAV-PVT in it
    assert form_of(both) is NMEA
    assert len(of(read_nmea(both, LogOptions()), PositionSample)) == 655

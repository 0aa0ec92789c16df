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
"""Small logs of other makers with known values, the real ones, and what an import made of them."""

from __future__ import annotations

from collections import defaultdict
from dataclasses import replace

from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.logs.csv_log import read_csv
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.messages import SENSED_SAMPLES, topic_of

CDR = Cdr()
#: Everything that a log may leave open.
OPTIONS = LogOptions(
    geoid_undulation_m=-21.387,
    baseline_m=1.2,
    takeoff_height_m=100.0,
    height="sea",
    time_scale="utc",
    utc_offset_s=7200,
    start_ns=1_700_000_000_000_000_000,
)

SRT = """\
1
00:00:00,000 --> 00:00:00,033
<font size="28">FrameCnt: 1, DiffTime: 33ms
2024-06-11 09:44:39.125
[iso: 180] [latitude: 48.137154] [longitude: 11.576124] [rel_alt: 20.500 abs_alt: 540.250] \
[gb_yaw: -162.5 gb_pitch: -30.0 gb_roll: 1.5] </font>

2
00:00:00,033 --> 00:00:00,066
<font size="28">FrameCnt: 2, DiffTime: 33ms
2024-06-11 09:44:39.158
[iso: 180] [latitude: 48.137155] [longitude: 11.576126] [rel_alt: 20.600 abs_alt: 540.350] \
[gb_yaw: -162.4 gb_pitch: -30.0 gb_roll: 1.5] </font>
"""

POS = """\
% (lat/lon/height=WGS84/ellipsoidal,Q=1:fix,2:float,3:sbas,4:dgps,5:single,6:ppp)
%  GPST   latitude(deg) longitude(deg)  height(m)   Q  ns   sdn(m)   sde(m)   sdu(m)  sdne(m)
2024/06/11 07:44:57.000 48.137154000 11.576124000 560.1000 1 20 0.0100 0.0200 0.0300 0.0050 \
-0.0060 0.0070 0.20 99.0
2024/06/11 07:44:58.000 48.137155000 11.576126000 560.2000 2 20 0.0100 0.0200 0.0300 0.0050 \
-0.0060 0.0070 0.20 9.0
"""

IMU = "".join(
    f"{1718091879 + k / 100:.2f},0.0,0.0,1.0,0.001,0.002,{'x' if k == 7 else 0.003}\n"
    for k in range(20)
)
IMU_COLUMNS = """\
table: {header: false}
time: {counts: utc, column: 1, unit: s}
imu:
  accel: {columns: [2, 3, 4], unit: g}
  gyro: {columns: [5, 6, 7], unit: deg/s}
  axes: flu
"""


#: Of a table with the columns t and p.
PRESSURE = "time: {counts: utc, column: t, unit: s}\npressure: {column: p, unit: Pa}\n"


def read_table(folder, table, columns, options=OPTIONS):
    """Return the contents of a table, as a columns file explains it."""
    (folder / "log.csv").write_text(table, encoding="utf-8")
    (folder / "columns.yaml").write_text(columns)
    return read_csv(folder / "log.csv", replace(options, columns=folder / "columns.yaml"))


def pvt(**changed):
    """Return a NAV-PVT of u-blox with an RTK fix, as bytes."""
    from pyubx2 import GET, UBXMessage  # noqa: PLC0415  an extra

    values = {
        "iTOW": 200_697_000,
        "year": 2024,
        "month": 6,
        "day": 11,
        "hour": 7,
        "min": 44,
        "second": 39,
        "validDate": 1,
        "validTime": 1,
        "fullyResolved": 1,
        "nano": 125,
        "fixType": 3,
        "gnssFixOk": 1,
        "diffSoln": 1,
        "carrSoln": 2,
        "lon": 11.576124,
        "lat": 48.137154,
        "height": 560_100,
        "hMSL": 515_000,
        "hAcc": 14,
        "vAcc": 10,
        "velN": 1000,
        "velE": -2000,
        "velD": 30,
        "sAcc": 50,
    }
    return UBXMessage("NAV", "NAV-PVT", GET, **values | changed).serialize()


def relposned(**changed):
    """Return a NAV-RELPOSNED, version 1, of a moving base with a baseline of 1.2 m, as bytes."""
    from pyubx2 import GET, UBXMessage  # noqa: PLC0415  an extra

    values = {
        "version": 1,
        "iTOW": 200_697_000,
        "relPosLength": 120,
        "relPosHeading": 200.0,
        "accHeading": 0.5,
        "gnssFixOK": 1,
        "diffSoln": 1,
        "relPosValid": 1,
        "carrSoln": 2,
        "isMoving": 1,
        "relPosHeadingValid": 1,
    }
    return UBXMessage("NAV", "NAV-RELPOSNED", GET, **values | changed).serialize()


def by_topic(contents):
    """Return the samples of a log by topic, in its order."""
    result = defaultdict(list)
    for sample in contents.samples:
        result[topic_of(sample)].append(sample)
    return result


def samples(path, topics=None):
    """Return the samples of a bag by topic (of these; None: all), in order of log time."""
    result = defaultdict(list)
    for message in BagReader(path).messages(topics and [f"/{topic}" for topic in topics]):
        topic = message.topic.removeprefix("/")
        result[topic].append(
            SENSED_SAMPLES[topic](CDR.deserialize(message.data, message.typename))
        )
    return result


def by_source(contents):
    """Return a log's samples by their source, in the order of the log."""
    result = defaultdict(list)
    for sample in contents.samples:
        result[sample.source].append(sample)
    return result

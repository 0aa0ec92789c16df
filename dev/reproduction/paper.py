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
"""The tables of Ren et al., Remote Sensing 2022, 14, 2205 (CC BY 4.0), as printed.

For comparison alone: nothing is computed from them but what a reader would compute. Methods bear
this package's names: ``raw`` (original GPS and attitude), ``rtk`` (RTK, original attitude),
``ekf`` (the authors' previous method), ``ekf_heading`` (the proposed method).
"""

from __future__ import annotations

from collections.abc import Mapping

#: Table 2: registration errors due to Table 1's, means over the field of view, m.
TABLE_2_M: Mapping[str, float] = {
    "CamPosition": 1.5884,
    "CamHeight": 5.6036,
    "CamPosition3D": 5.8243,
    "CamYaw": 1.2497,
}

#: Table 5: the IMU's noise by Allan variance, along x, y, z.
TABLE_5: Mapping[str, tuple[float, float, float]] = {
    "angle_random_walk_rad_sqrt_s": (1.6828e-4, 1.9601e-4, 1.6542e-4),
    "velocity_random_walk_m_s_sqrt_s": (1.2917e-2, 1.2996e-2, 1.2921e-2),
    "gyro_dynamic_bias_rad_s": (1.5289e-6, 37.010e-6, 2.2793e-6),
    "accel_dynamic_bias_m_s2": (6.0546e-3, 2.8561e-3, 7.9284e-3),
    "gyro_correlation_time_s": (7000.0, 100.0, 9000.0),
    "accel_correlation_time_s": (20.0, 600.0, 10000.0),
}

_TABLE_6_METHODS = ("raw", "rtk", "ekf", "ekf_heading")
_TABLE_6_ROWS = (
    (4.15, 2.86, 1.37, 1.02),
    (4.84, 3.74, 2.38, 1.17),
    (3.18, 3.59, 2.00, 1.40),
    (2.93, 2.45, 1.32, 0.95),
    (1.92, 2.67, 1.40, 0.93),
    (2.37, 2.78, 1.53, 0.80),
    (2.96, 2.99, 1.55, 0.55),
    (3.83, 3.11, 1.34, 1.06),
    (1.93, 2.01, 2.03, 0.93),
    (3.30, 1.90, 1.67, 0.87),
    (2.70, 2.27, 1.23, 1.39),
    (2.77, 2.58, 1.24, 0.95),
    (3.46, 1.58, 1.61, 0.87),
    (2.82, 1.58, 1.35, 1.41),
    (2.42, 1.86, 1.37, 1.56),
    (4.03, 2.03, 1.35, 1.23),
    (4.32, 2.92, 1.30, 1.52),
    (2.62, 2.17, 1.20, 0.77),
    (3.90, 1.93, 1.46, 1.20),
    (3.84, 2.26, 1.22, 1.25),
)
#: Table 6: RMSE of each ground point, m, by method, then by the point's number.
TABLE_6_M: Mapping[str, Mapping[str, float]] = {
    method: {str(number): row[column] for number, row in enumerate(_TABLE_6_ROWS, 1)}
    for column, method in enumerate(_TABLE_6_METHODS)
}
#: Table 6's last row, m.
TABLE_6_AVERAGE_M: Mapping[str, float] = {
    "raw": 3.21,
    "rtk": 2.46,
    "ekf": 1.50,
    "ekf_heading": 1.09,
}

#: Table 7: p-values of the paired t-test on Table 6; the other pairs are not printed.
TABLE_7: Mapping[tuple[str, str], float] = {
    ("raw", "rtk"): 0.0008,
    ("rtk", "ekf"): 0.0001,
    ("rtk", "ekf_heading"): 0.0001,
    ("ekf", "ekf_heading"): 0.0005,
}

#: Table 8: standard deviation of the gimbal's attitude while the airframe turns, deg.
TABLE_8_DEG: Mapping[str, float] = {"pitch": 0.4839, "yaw": 13.8857, "roll": 0.2704}

#: Table 9: the thermal camera's lens; lengths in px.
TABLE_9: Mapping[str, float] = {
    "k1": 0.0540,
    "k2": 0.3462,
    "p1": -0.0037,
    "p2": 0.0076,
    "cx": 349.3325,
    "cy": 251.8215,
    "fx": 803.5593,
    "fy": 797.6270,
}

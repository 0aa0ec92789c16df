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
"""Filter the tables of a bag through the public interface."""

from __future__ import annotations

import tirgeo_ros

#: filter_flight's argument -> the topic of its table.
ARGUMENTS = {
    "rtk_fix": "rtk/fix",
    "rtk_velocity": "rtk/vel",
    "heading": "rtk/heading",
    "gps_fix": "gps/fix",
    "gps_velocity": "gps/vel",
    "joints": "gimbal/joint_states",
    "camera_attitude": "gimbal/attitude",
}


def filtered(tables, **others):
    """Filter all tables of a bag."""
    given = {name: tables[topic] for name, topic in ARGUMENTS.items() if topic in tables}
    return tirgeo_ros.filter_flight(tables["imu/data"], **(given | others))

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
"""Locate pixels of the sample flight's pictures on the ground, as GeoJSON with 95 % ellipses.

Run it in any folder: it writes ``points.geojson`` into ``examples_output`` there. The pixels are
of surveyed points, so the true errors are known too.
"""

from __future__ import annotations

import math
from pathlib import Path

import tirgeo_ros

SAMPLE = Path(__file__).resolve().parents[1] / "bags" / "sample"
BAG = SAMPLE / "flight.mcap"
OUTPUT = Path("examples_output")  # in the folder where you run this


def main() -> None:
    """Filter, locate, write, and compare with the survey."""
    config = tirgeo_ros.load_config(SAMPLE / "params.yaml")
    bag, camera = tirgeo_ros.read_bag(BAG), tirgeo_ros.read_camera(BAG)
    flight = tirgeo_ros.filter_flight(
        bag["imu/data"],
        rtk_fix=bag["rtk/fix"],
        rtk_velocity=bag["rtk/vel"],
        heading=bag["rtk/heading"],
        joints=bag["gimbal/joint_states"],
        config=config,
    )
    survey = {one.id: one for one in tirgeo_ros.load_survey(SAMPLE / "survey.geojson")}
    ids, answers = [], []
    for seen in tirgeo_ros.load_observations(SAMPLE / "observations.csv"):
        if seen.stamp_ns < flight.stamp_ns[100]:
            continue  # the filter was not aligned yet
        pose = flight.picture_pose(seen.stamp_ns)
        ground_m = config.overlay.ground_height_m
        answers += tirgeo_ros.locate((seen.u, seen.v), pose, camera, ground_m, config=config)
        ids.append(seen.id)
    OUTPUT.mkdir(exist_ok=True)
    tirgeo_ros.save_located(OUTPUT / "points.geojson", answers, ids)
    for name, answer in zip(ids, answers, strict=True):
        if isinstance(answer, tirgeo_ros.Refusal):
            print(f"{name}: {answer.reason.value}")
            continue
        true = survey[name]
        place = true.latitude_rad, true.longitude_rad, true.height_m
        error_m = math.dist(answer.point_n[:2], flight.plane.ned_from_geodetic(*place)[:2])
        print(
            f"{name}: {error_m:.2f} m from the survey, 95 % within {answer.ellipse.major_m:.2f} m"
        )


if __name__ == "__main__":
    main()

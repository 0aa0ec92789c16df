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
"""Draw surveyed points, with their 95 % ellipses, into a picture of the sample flight.

Run it in any folder: it writes ``survey.png`` into ``examples_output`` there.
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

import tirgeo_ros

SAMPLE = Path(__file__).resolve().parents[1] / "bags" / "sample"
BAG, PARAMS = SAMPLE / "flight.mcap", SAMPLE / "params.yaml"
OUTPUT = Path("examples_output")  # in the folder where you run this
CHI2_95 = 5.991  # 95 % quantile of chi-square with two degrees of freedom
ORANGE = (0, 140, 255)


def main() -> None:
    """Filter, find the picture that shows most points, project and draw."""
    bag = tirgeo_ros.read_bag(BAG)
    flight = tirgeo_ros.filter_flight(
        bag["imu/data"],
        rtk_fix=bag["rtk/fix"],
        rtk_velocity=bag["rtk/vel"],
        heading=bag["rtk/heading"],
        joints=bag["gimbal/joint_states"],
        config=PARAMS,
    )
    camera, config = tirgeo_ros.read_camera(BAG), tirgeo_ros.load_config(PARAMS)
    survey = tirgeo_ros.load_survey(SAMPLE / "survey.geojson")
    places = [(one.latitude_rad, one.longitude_rad, one.height_m) for one in survey]
    points_n = flight.plane.ned_from_geodetic(*np.transpose(places))

    def projected(picture: tirgeo_ros.Picture) -> tirgeo_ros.Projected:
        pose = flight.picture_pose(picture.stamp_ns)
        return tirgeo_ros.project(points_n, pose, camera, sigma_m=0.02, config=config)

    navigated = (p for p in tirgeo_ros.read_pictures(BAG) if p.stamp_ns > flight.stamp_ns[100])
    best = max(navigated, key=lambda picture: projected(picture).visible.sum())
    found = projected(best)
    canvas = (
        cv2.cvtColor(best.pixels, cv2.COLOR_GRAY2BGR) if best.pixels.ndim == 2 else best.pixels
    )
    canvas = cv2.resize(canvas, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    for row in np.flatnonzero(found.visible & found.linear):
        draw(canvas, survey[row].id, 2 * found.pixels[row] + 0.5, 4 * found.covariance[row])
    OUTPUT.mkdir(exist_ok=True)
    cv2.imwrite(str(OUTPUT / "survey.png"), canvas)
    print(f"{found.visible.sum()} points in the picture of {best.stamp_ns} ns")


def draw(canvas: np.ndarray, name: str, pixel: np.ndarray, covariance: np.ndarray) -> None:
    """Draw a point, its 95 % ellipse and its name."""
    variances, axes = np.linalg.eigh(covariance)
    semi_axes = np.sqrt(CHI2_95 * variances)[::-1]
    angle_deg = np.degrees(np.arctan2(axes[1, 1], axes[0, 1]))
    cv2.ellipse(
        canvas, (pixel.tolist(), (2 * semi_axes).tolist(), angle_deg), ORANGE, 2, cv2.LINE_AA
    )
    column, row = np.round(pixel).astype(int).tolist()
    cv2.drawMarker(canvas, (column, row), ORANGE, cv2.MARKER_CROSS, 12, 1, cv2.LINE_AA)
    cv2.putText(
        canvas,
        name,
        (column + 12, row - 12),
        cv2.FONT_HERSHEY_SIMPLEX,
        0.6,
        ORANGE,
        2,
        cv2.LINE_AA,
    )


if __name__ == "__main__":
    main()

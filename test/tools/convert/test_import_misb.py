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
"""Our own video with metadata, imported again; every foreign stream, imported or refused."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from klv_reader import demuxed, step_of, values_in
from process_bags import CAMERA_POSE, IMAGES, messages_of

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import GimbalConfig
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import (
    BODY_OPTICAL,
    matrix_from_euler,
    matrix_from_quat,
    quat_from_matrix,
    rotvec_from_quat,
)
from tirgeo_ros.core.gimbal.camera_pose import Mount, from_joints
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.ground.frame_geometry import Sight, frame_geometry
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import ImuSample, JointSample, PositionSample
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.io.logs.misb import read_misb
from tirgeo_ros.tools.convert.import_flight import import_flight
from tirgeo_ros.tools.replay.process import process

#: Half a step of each angle, and turning while the stamp's part of a microsecond passes.
ANGLE_RAD = math.radians(0.5 * sum(map(step_of, (5, 6, 7, 18, 19, 20)))) + 2e-6
EARTH_M = 6.4e6  # not less than its radii of curvature


@pytest.fixture(scope="module")
def film(cut, options, tmp_path_factory):
    """The folder of a run's bag and video, made from the sample's first seconds."""
    folder = tmp_path_factory.mktemp("film")
    process(cut, folder / "out.mcap", video=folder / "out.ts", **options)
    return folder


def written_poses(bag):
    """The camera's poses of a bag, and their plane."""
    _, origin = next(messages_of(bag, "/tirgeo/origin"))
    poses = PoseBuffer(span_s=1e6)
    for _, message in messages_of(bag, CAMERA_POSE):
        poses.add(convert.camera_pose(message))
    return poses, convert.tangent_plane(origin)


def test_our_own_video_gives_the_poses_that_it_was_drawn_with(film):
    """To half a step of the packet, through the joints' order and the picture's middle ray."""
    contents = read_misb(film / "out.ts", LogOptions())
    poses, plane = written_poses(film / "out.mcap")
    mount = Mount.from_config(GimbalConfig(joint_order=contents.parameters["joint_order"]))
    places, attitudes, joints = (
        {sample.stamp_ns: sample for sample in contents.samples if isinstance(sample, kind)}
        for kind in (PositionSample, ImuSample, JointSample)
    )
    assert places.keys() == attitudes.keys() == joints.keys()
    assert len(places) > 15
    half_n = 0.5 * np.array([*np.radians([step_of(13), step_of(14)]) * EARTH_M, step_of(75)])
    for stamp_ns, fix in places.items():
        pose = poses.at(stamp_ns)
        place_n = plane.ned_from_geodetic(fix.latitude_rad, fix.longitude_rad, fix.height_m)
        assert (np.abs(place_n - pose.position_n) < half_n + 1e-4).all()
        # In the axes north, east, down at the sensor, as the packet has them.
        body = BodyPose(stamp_ns, place_n, attitudes[stamp_ns].autopilot_q_nb, np.zeros((6, 6)))
        ours = from_joints(mount, body, joints[stamp_ns])
        sight = frame_geometry(Sight(XT2, pose, plane, math.nan), ConfidenceConfig())
        wanted = matrix_from_euler(*sight.sight_rpy) @ BODY_OPTICAL
        error = quat_from_matrix(matrix_from_quat(ours.q_nc).T @ wanted)
        assert np.linalg.norm(rotvec_from_quat(error)) < ANGLE_RAD


def test_our_own_video_gives_its_pictures_and_frame_centre(film, cut):
    contents = read_misb(film / "out.ts", LogOptions())
    stamps = [picture.stamp_ns for picture in contents.pictures]
    packets = [values_in(entry)[2] * 1000 for entry in demuxed(film / "out.ts").packets]
    assert stamps == packets
    assert len(stamps) == len([*messages_of(cut, IMAGES)])
    (note,) = (each for each in contents.notes if each.startswith("frame centre"))
    median_deg, p90_deg = map(float, re.findall(r"([\d.]+) deg", note))
    # A step of the heights, 0.3 m, over the slant range of 50 m and more.
    assert median_deg <= p90_deg < math.degrees(step_of(25) / 50)


REAL = {
    "h264_klv.ts": None,
    "st0902_dynamic_only.bin": None,
    "st0902_dynamic_constant.bin": "1 packet: wrong checksum",
    "aphill_10s_legacy_klv.ts": "300 universal set of EG 0104, older than ST 0601: only",
    "st0903.bin": "moving targets of ST 0903: only ST 0601 is read",
}


@pytest.mark.parametrize("name", REAL)
def test_each_real_stream_is_imported_or_refused_by_name(name, shared, tmp_path):
    path, output = shared / "foreign_logs" / "misb" / name, tmp_path / "out.mcap"
    options = LogOptions(geoid_undulation_m=0.0)
    if words := REAL[name]:
        with pytest.raises(LogError, match=rf"^{re.escape(str(path))}: .*{re.escape(words)}"):
            import_flight(path, output, logs=options)
        return
    result = import_flight(path, output, logs=options)
    assert result["written"]["/gimbal/joint_states"]["messages"] > 0
    assert result["parameters"]["joint_order"] == "yaw-pitch-roll"


def test_no_real_stream_is_left_out(shared):
    assert {path.name for path in (shared / "foreign_logs" / "misb").iterdir()} == REAL.keys()

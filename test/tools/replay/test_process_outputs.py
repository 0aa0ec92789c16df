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
"""What process writes besides poses: transforms, footprints, the track, video, located clicks."""

from __future__ import annotations

import math

import numpy as np
import pytest
from flights import flight
from klv_reader import by_klvdata, demuxed, step_of, values_in
from process_bags import CAMERA_POSE, CDR, IMAGES, messages_of, write_hover
from transform_chains import Chains, rigid

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import EkfConfig, OverlayConfig
from tirgeo_ros.core.frames.rotations import heading_of, wrapped
from tirgeo_ros.core.navigation.estimator.track import MOST_POINTS
from tirgeo_ros.core.types.measurements import SetHeading
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.messages import TOPIC_TYPES, body_pose, pictures as picture_messages
from tirgeo_ros.io.parameters.parameter_file import ParameterFile
from tirgeo_ros.tools.replay.process import process

#: Interpolating on a globe of attitudes and chaining, twice: positions of order 100 m.
ROUNDING = 1e-10


def contents(path, *topics):
    return [message for _, message in messages_of(path, *topics)]


def test_through_tf_the_camera_is_at_its_pose(whole):
    bag = whole[0] / "out.mcap"
    chains, poses = Chains(contents(bag, "/tf")), contents(bag, CAMERA_POSE)
    assert chains.parents == {"base_link": "map", "tir_optical_frame": "base_link"}
    assert len(poses) > 100
    for pose in poses:
        wanted = rigid(pose.pose.pose.position, pose.pose.pose.orientation)
        result = chains.pose("tir_optical_frame", convert.stamp_ns(pose))
        np.testing.assert_allclose(result, wanted, rtol=0, atol=ROUNDING)
    (fixed,) = contents(bag, "/tf_static")
    assert {entry.header.frame_id for entry in fixed.transforms} == {"base_link"}
    assert "rtk_antenna" in {entry.child_frame_id for entry in fixed.transforms}


def test_each_picture_has_its_calibration_and_some_their_footprint(whole):
    bag = whole[0] / "out.mcap"
    pictures = contents(bag, "/tirgeo/overlay/image/compressed")
    infos = contents(bag, "/tirgeo/overlay/camera_info")
    assert [*map(convert.stamp_ns, infos)] == [*map(convert.stamp_ns, pictures)]
    result = picture_messages.camera(infos[0])
    assert (result.matrix == XT2.matrix).all()
    assert result.distortion == (*XT2.distortion, 0.0)  # plumb_bob has five
    stamps = {convert.stamp_ns(entry) for entry in pictures}
    outlines = contents(bag, "/tirgeo/footprint")
    assert {convert.stamp_ns(entry) for entry in outlines} <= stamps
    sizes = [len(entry.polygon.points) for entry in outlines]
    assert sizes[0] == 0  # no pose yet
    assert sizes[-1] > 20
    steps_s = np.diff([convert.stamp_ns(entry) for entry in outlines]) * 1e-9
    assert 0.2 <= np.median(steps_s) < 0.35  # 5 Hz of pictures at 9 Hz: every second or third


def test_the_track_follows_the_odometry(whole):
    bag = whole[0] / "out.mcap"
    path, odometry = contents(bag, "/tirgeo/path")[-1], contents(bag, "/tirgeo/odometry")
    assert len(path.poses) <= MOST_POINTS + 1
    assert path.poses[0].pose == odometry[0].pose.pose
    assert path.poses[-1].pose == odometry[-1].pose.pose
    assert {entry.header.frame_id for entry in path.poses} == {path.header.frame_id} == {"map"}


def test_names_of_frames_and_without_tf(cut, params, tmp_path):
    names = tmp_path / "names.yaml"
    names.write_text(
        "/**: {ros__parameters: {frame_prefix: uav1/, map_frame: field}}\n"
        "/**/ekf_node: {ros__parameters: {publish_tf: false}}\n"
    )
    summary = process(cut, tmp_path / "out.mcap", params=[params, names], images=False)
    assert "/tf_static" not in summary["written"]
    chains = Chains(contents(tmp_path / "out.mcap", "/tf"))  # gimbal_node's
    assert chains.parents == {"uav1/tir_optical_frame": "uav1/base_link"}
    first = contents(tmp_path / "out.mcap", "/tirgeo/odometry")[0]
    assert (first.header.frame_id, first.child_frame_id) == ("uav1/field", "uav1/base_link")


LATENCY_NS = 50_000_000
DRAWN = {5, 6, 7, *range(13, 34), 45, 46, 75, 78, *range(82, 90)}


@pytest.fixture(scope="module")
def film(cut, options, tmp_path_factory):
    """The summary of a run, and what its video holds."""
    folder = tmp_path_factory.mktemp("film")
    summary = process(cut, folder / "out.mcap", video=folder / "out.ts", **options)
    return summary, demuxed(folder / "out.ts")


def test_a_packet_to_each_frame_at_its_exposure(film, cut):
    summary, result = film
    stamps = [convert.stamp_ns(m) for _, m in messages_of(cut, IMAGES)]
    assert summary["video"]["frames"] == len(stamps) == len(result.frame_s)
    assert result.packet_s == result.frame_s
    times = [values_in(entry)[2] for entry in result.packets]
    assert times == [(stamp - LATENCY_NS) // 1000 for stamp in stamps]


def test_drawn_frames_have_all_metadata_and_others_only_the_time(film):
    summary, result = film
    tags = [values_in(entry).keys() - {2} for entry in result.packets]
    assert [entry for entry in tags if entry] == [DRAWN] * summary["overlay"]["drawn"]
    assert tags.count(set()) == summary["overlay"]["notices"] > 0
    for entry in result.packets:
        by_klvdata(entry)


def test_places_are_those_of_the_flight(film, sample):
    """Within a metre of the true camera; heights above the sea by dji_node's undulation, -9 m."""
    truth = sample / "truth.mcap"
    _, origin = next(messages_of(truth, "/tirgeo/origin"))
    plane = convert.tangent_plane(origin)
    poses = [convert.camera_pose(message) for _, message in messages_of(truth, CAMERA_POSE)]
    stamps = np.array([pose.stamp_ns for pose in poses])
    placed = [entry for entry in map(values_in, film[1].packets) if 13 in entry]
    for values in placed:
        nearest = poses[np.abs(stamps - values[2] * 1000).argmin()]
        here_n = plane.ned_from_geodetic(*np.radians([values[13], values[14]]), values[75])
        assert np.linalg.norm(here_n - nearest.position_n) < 1.0
        assert values[15] - values[75] == pytest.approx(9.0, abs=step_of(75))
        assert 0.1 < values[45] < 5.0


PIXEL = "tirgeo/locate/pixel"
UV = (320.0, 300.0)


def click(stamp_ns):
    kind, header = CDR.types(TOPIC_TYPES[PIXEL]), CDR.types("std_msgs/msg/Header")
    time, point = (
        CDR.types("builtin_interfaces/msg/Time"),
        CDR.types("geometry_msgs/msg/Point"),
    )
    stamp = time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
    return kind(header=header(stamp=stamp, frame_id=""), point=point(x=UV[0], y=UV[1], z=0.0))


@pytest.fixture(scope="module")
def clicked(cut, tmp_path_factory):
    """The sample's first seconds with a click on its 20th picture, and that picture's stamp."""
    path = tmp_path_factory.mktemp("clicked") / "flight.mcap"
    stamp_ns = [convert.stamp_ns(message) for _, message in messages_of(cut, IMAGES)][19]
    with BagWriter(path) as writer:
        for item in BagReader(cut).messages():
            writer.write(item.topic, item.typename, item.data, item.log_time_ns)
        writer.write(f"/{PIXEL}", TOPIC_TYPES[PIXEL], click(stamp_ns), item.log_time_ns)
    return path, stamp_ns


def located(path):
    """The one point in a bag of outputs, as a pose whose rotation is unknown."""
    ((_, message),) = messages_of(path, "/tirgeo/locate/point")
    return convert.camera_pose(message)


def test_a_click_in_the_bag_becomes_a_point(clicked, options, tmp_path):
    bag, stamp_ns = clicked
    output = tmp_path / "out.mcap"
    summary = process(bag, output, **options)
    point = located(output)
    point_n = point.position_n
    assert point.stamp_ns == stamp_ns
    # The ground is the plane's own height there: the Earth's bend over 100 m is below 1 mm.
    assert point_n[2] == pytest.approx(0.0, abs=0.001)
    assert 10 < np.linalg.norm(point_n[:2]) < 300
    assert np.linalg.eigvalsh(point.covariance[:3, :3])[0] > 0
    assert summary["overlay"]["drawn"] > 10
    assert summary["written"]["/tirgeo/locate/fix"] == 1


def test_an_elevation_model_stands_before_the_parameters_height(clicked, options, tmp_path):
    """The model is level, ellipsoidal, 2 m above the parameter's height."""
    rasterio = pytest.importorskip("rasterio", reason="elevation models need rasterio")
    params, dem = options["params"], tmp_path / "dem.tif"
    ground_m = ParameterFile(params).config("overlay_node", OverlayConfig).ground_height_m
    latitude, longitude, _ = ParameterFile(params).config("ekf_node", EkfConfig).origin_lat_lon_h
    place = rasterio.transform.from_origin(longitude - 0.01, latitude + 0.01, 1e-4, 1e-4)
    shape = {"height": 200, "width": 200, "count": 1, "dtype": "float32", "crs": "EPSG:4979"}
    with rasterio.open(dem, "w", driver="GTiff", transform=place, **shape) as target:
        target.write(np.full((1, 200, 200), ground_m + 2.0, np.float32))
    output = tmp_path / "out.mcap"
    process(clicked[0], output, dem=dem, **options)
    # 1 mm of the Earth's bend, and what float32 leaves of the height
    assert located(output).position_n[2] == pytest.approx(-2.0, abs=0.002)


SIGMA = math.radians(2.0)


def test_a_set_heading_in_a_bag_begins_the_filter(tmp_path):
    flown = flight(1, 6.0, "hover")
    begin_ns, true_rad = flown.truth.stamp_ns[0], heading_of(flown.truth.q_nb[0])
    reports = SetHeading(begin_ns + 3_000_000_000, true_rad + SIGMA, SIGMA**2)
    poses = []
    for name, given in (("without", ()), ("with", (reports,))):
        bag = write_hover(tmp_path / f"{name}.mcap", flown, *given)
        out = tmp_path / f"{name}_out.mcap"
        process(bag, out, method="ekf", images=False)
        poses.append([body_pose(entry) for _, entry in messages_of(out, "/tirgeo/odometry")])
    silent, flying = poses
    assert not silent
    assert flying[0].stamp_ns - reports.stamp_ns < 1_500_000_000
    off_rad = wrapped(heading_of(flying[0].q_nb) - true_rad)
    assert abs(off_rad - SIGMA) < 0.5 * SIGMA  # it is what was said, turned with the aircraft

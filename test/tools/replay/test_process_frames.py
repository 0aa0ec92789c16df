"""tirgeo process: transforms, footprints, calibrations and the track in its bag."""

from __future__ import annotations

import numpy as np
from process_bags import CAMERA_POSE, messages_of
from transform_chains import Chains, rigid

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.navigation.track import MOST_POINTS
from tirgeo_ros.io import messages as convert
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
        found = chains.pose("tir_optical_frame", convert.stamp_ns(pose))
        np.testing.assert_allclose(found, wanted, rtol=0, atol=ROUNDING)
    (fixed,) = contents(bag, "/tf_static")
    assert {one.header.frame_id for one in fixed.transforms} == {"base_link"}
    assert "rtk_antenna" in {one.child_frame_id for one in fixed.transforms}


def test_each_picture_has_its_calibration_and_some_their_footprint(whole):
    bag = whole[0] / "out.mcap"
    pictures = contents(bag, "/tirgeo/overlay/image/compressed")
    infos = contents(bag, "/tirgeo/overlay/camera_info")
    assert [*map(convert.stamp_ns, infos)] == [*map(convert.stamp_ns, pictures)]
    found = convert.camera(infos[0])
    assert (found.matrix == XT2.matrix).all()
    assert found.distortion == (*XT2.distortion, 0.0)  # plumb_bob has five
    stamps = {convert.stamp_ns(one) for one in pictures}
    outlines = contents(bag, "/tirgeo/footprint")
    assert {convert.stamp_ns(one) for one in outlines} <= stamps
    sizes = [len(one.polygon.points) for one in outlines]
    assert sizes[0] == 0  # no pose yet
    assert sizes[-1] > 20
    steps_s = np.diff([convert.stamp_ns(one) for one in outlines]) * 1e-9
    assert 0.2 <= np.median(steps_s) < 0.35  # 5 Hz of pictures at 9 Hz: every second or third


def test_the_track_follows_the_odometry(whole):
    bag = whole[0] / "out.mcap"
    path, odometry = contents(bag, "/tirgeo/path")[-1], contents(bag, "/tirgeo/odometry")
    assert len(path.poses) <= MOST_POINTS + 1
    assert path.poses[0].pose == odometry[0].pose.pose
    assert path.poses[-1].pose == odometry[-1].pose.pose
    assert {one.header.frame_id for one in path.poses} == {path.header.frame_id} == {"map"}


def test_names_of_frames_and_without_tf(cut, sample, tmp_path):
    names = tmp_path / "names.yaml"
    names.write_text(
        "/**: {ros__parameters: {frame_prefix: uav1/, map_frame: field}}\n"
        "/**/ekf_node: {ros__parameters: {publish_tf: false}}\n"
    )
    params = [sample / "params.yaml", names]
    summary = process(cut, tmp_path / "out.mcap", params=params, images=False)
    assert "/tf_static" not in summary["written"]
    chains = Chains(contents(tmp_path / "out.mcap", "/tf"))  # gimbal_node's
    assert chains.parents == {"uav1/tir_optical_frame": "uav1/base_link"}
    first = contents(tmp_path / "out.mcap", "/tirgeo/odometry")[0]
    assert (first.header.frame_id, first.child_frame_id) == ("uav1/field", "uav1/base_link")

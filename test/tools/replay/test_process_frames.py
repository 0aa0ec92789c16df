"""tirgeo process: transforms, footprints, calibrations, the track, and video with its packets."""

from __future__ import annotations

import numpy as np
import pytest
from klv_reader import by_klvdata, demuxed, step_of, values_in
from process_bags import CAMERA_POSE, IMAGES, messages_of
from transform_chains import Chains, rigid

from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.core.navigation.estimator.track import MOST_POINTS
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


LATENCY_NS = 50_000_000
DRAWN = {5, 6, 7, *range(13, 34), 45, 46, 75, 78, *range(82, 90)}


@pytest.fixture(scope="module")
def film(cut, options, tmp_path_factory):
    """The summary of a run, and what its video holds."""
    folder = tmp_path_factory.mktemp("film")
    summary = process(cut, folder / "out.mcap", video=folder / "out.ts", **options)
    return summary, demuxed(folder / "out.ts")


def test_a_packet_to_each_frame_at_its_exposure(film, cut):
    summary, found = film
    stamps = [convert.stamp_ns(m) for _, m in messages_of(cut, IMAGES)]
    assert summary["video"]["frames"] == len(stamps) == len(found.frame_s)
    assert found.packet_s == found.frame_s
    times = [values_in(one)[2] for one in found.packets]
    assert times == [(stamp - LATENCY_NS) // 1000 for stamp in stamps]


def test_everything_of_drawn_frames_and_nothing_of_others(film):
    summary, found = film
    tags = [values_in(one).keys() - {2} for one in found.packets]
    assert [one for one in tags if one] == [DRAWN] * summary["overlay"]["drawn"]
    assert tags.count(set()) == summary["overlay"]["notices"] > 0
    for one in found.packets:
        by_klvdata(one)


def test_a_film_needs_no_map(film, cut, options, tmp_path):
    """Without one: the same poses, the clicks' points, and no word of a map."""
    params = options["params"]
    summary = process(cut, tmp_path / "out.mcap", video=tmp_path / "out.ts", params=params)
    assert summary["overlay"] == film[0]["overlay"]
    assert demuxed(tmp_path / "out.ts").packets == film[1].packets
    topics = ("/tirgeo/overlay/camera_info", "/tirgeo/footprint", "/tirgeo/locate/point")
    written = [summary["written"].get(one, 0) for one in topics]
    assert written == [film[0]["written"].get(one, 0) for one in topics]
    assert written[0] == summary["video"]["frames"]
    assert not [one for one in summary["findings"] if "map" in str(one)]


def test_places_are_those_of_the_flight(film, sample):
    """Within a metre of the true camera; heights above the sea by dji_node's undulation, -9 m."""
    truth = sample / "truth.mcap"
    _, origin = next(messages_of(truth, "/tirgeo/origin"))
    plane = convert.tangent_plane(origin)
    poses = [convert.camera_pose(message) for _, message in messages_of(truth, CAMERA_POSE)]
    stamps = np.array([pose.stamp_ns for pose in poses])
    placed = [one for one in map(values_in, film[1].packets) if 13 in one]
    for values in placed:
        nearest = poses[np.abs(stamps - values[2] * 1000).argmin()]
        here_n = plane.ned_from_geodetic(*np.radians([values[13], values[14]]), values[75])
        assert np.linalg.norm(here_n - nearest.position_n) < 1.0
        assert values[15] - values[75] == pytest.approx(9.0, abs=step_of(75))
        assert 0.1 < values[45] < 5.0

"""tirgeo process --video out.ts: a packet to each frame, from the run's own poses."""

from __future__ import annotations

import numpy as np
import pytest
from klv_reader import by_klvdata, demuxed, step_of, values_in
from process_bags import CAMERA_POSE, IMAGES, messages_of

from tirgeo_ros.io import messages as convert
from tirgeo_ros.tools.replay.process import process

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

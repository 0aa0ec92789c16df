"""A .ts file: the pictures' video, and with each of them its packet at the same time."""

from __future__ import annotations

import av
import numpy as np
import pytest
from klv_reader import by_klvdata, demuxed

from tirgeo_ros.io.video.frame_metadata import packet
from tirgeo_ros.io.video.video_file import VideoFile

START_NS = 1_634_731_264_000_000_000
STEP_NS = 111_111_111


def write(path, count, size=(48, 64)):
    packets = []
    with VideoFile(path) as video:
        for k in range(count):
            stamp_ns = START_NS + k * STEP_NS
            packets.append(packet(stamp_ns, {13: k / 10, 10: "x" * (k % 100)}))
            video.add(stamp_ns, np.full((*size, 3), 5 * (k % 50), np.uint8), packets[-1])
    return packets


@pytest.mark.parametrize(("count", "size"), [(1, (48, 64)), (60, (48, 64)), (12, (47, 63))])
def test_as_many_packets_as_frames_at_the_same_times(tmp_path, count, size):
    packets = write(tmp_path / "out.ts", count, size)
    found = demuxed(tmp_path / "out.ts")
    assert found.packets == packets
    assert found.packet_s == found.frame_s
    steps = np.subtract(found.frame_s, found.frame_s[0])
    np.testing.assert_allclose(steps, np.arange(count) * STEP_NS * 1e-9, atol=1 / 90_000)
    for one in found.packets:
        by_klvdata(one)


def test_what_players_look_for(tmp_path):
    """H.264 as browsers take it, and the registration KLVA by which FFmpeg knows metadata."""
    write(tmp_path / "out.ts", 30)
    with av.open(str(tmp_path / "out.ts")) as container:
        video, data = container.streams
        assert (video.codec_context.name, video.codec_context.pix_fmt) == ("h264", "yuv420p")
        assert data.type == "data"
        assert len([*container.decode(video=0)]) == 30
    content = (tmp_path / "out.ts").read_bytes()
    assert len(content) % 188 == 0
    assert bytes.fromhex("05044b4c5641") in content


def test_same_frames_same_bytes(tmp_path):
    for name in ("a.ts", "b.ts"):
        write(tmp_path / name, 40)
    assert (tmp_path / "a.ts").read_bytes() == (tmp_path / "b.ts").read_bytes()


def test_without_metadata_there_is_the_video_alone(tmp_path):
    with VideoFile(tmp_path / "out.ts") as video:
        assert video.takes_metadata
        video.add(START_NS, np.zeros((48, 64, 3), np.uint8))
    with av.open(str(tmp_path / "out.ts")) as container:
        assert [one.type for one in container.streams] == ["video"]
    assert not VideoFile(tmp_path / "out.mp4").takes_metadata

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
"""DJI's videos: pictures at the times of their cues, and what is refused in words."""

from __future__ import annotations

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
from dji_videos import BEGUN, GROUP, cue, inside, level, made_subtitles, made_video
from hypothesis import HealthCheck, given, settings, strategies as st

from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, ImuSample, PositionSample
from tirgeo_ros.io.logs.dji_video import is_dji_video, read_dji_video
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.tools.convert.import_flight import import_flight

COUNT = 4 * GROUP
OPTIONS = LogOptions(utc_offset_s=0, geoid_undulation_m=-5.0)


@pytest.fixture
def video(tmp_path):
    """A video with one cue for each picture beside it."""
    (tmp_path / "DJI_0001_T.SRT").write_text(made_subtitles(COUNT))
    return made_video(tmp_path / "DJI_0001_T.MP4", COUNT)


def of(contents, kind):
    return [sample for sample in contents.samples if isinstance(sample, kind)]


def numbers(pictures):
    """The numbers of pictures by their grey level, which JPEG keeps within one step."""
    greys = [cv2.imdecode(np.frombuffer(p.data, np.uint8), -1).mean() for p in pictures]
    levels = np.array([level(number) for number in range(50)])
    return [int(np.abs(levels - grey).argmin()) for grey in greys]


def test_each_picture_has_the_time_of_its_cue(video):
    contents = read_dji_video(video, OPTIONS)
    assert is_dji_video(video.read_bytes()[:64])
    assert not contents.read["picture"]  # they are decoded later
    pictures = list(contents.pictures)
    stamps = [attitude.stamp_ns for attitude in of(contents, CameraAttitudeSample)]
    assert [picture.stamp_ns for picture in pictures] == stamps
    assert stamps[0] == BEGUN * 10**6
    assert numbers(pictures) == list(range(COUNT))
    assert cv2.imdecode(np.frombuffer(pictures[0].data, np.uint8), -1).ndim == 2  # grey
    assert contents.read == {"cue": COUNT, "picture": COUNT}
    assert not contents.damaged
    assert not contents.refused
    assert any("--camera" in note and "40 mm" in note for note in contents.notes)
    assert len(of(contents, PositionSample)) == len(of(contents, ImuSample)) == COUNT


def test_a_picture_each_so_many_seconds(video):
    contents = read_dji_video(video, replace(OPTIONS, every_s=0.5))
    assert numbers(contents.pictures) == [0, 15, 30, 45]
    assert contents.read["picture"] == 4
    assert not contents.damaged


def test_a_known_model_has_its_lens(tmp_path):
    """DJI's encoder is called by the model; the digital zoom makes pixels smaller."""
    path = made_video(tmp_path / "a.mp4", 4, size=(640, 512))
    named = re.sub(rb"Lavf[\d.]+", lambda m: b"DJI M3T".ljust(len(m[0])), path.read_bytes())
    path.write_bytes(named)
    first, _, rest = made_subtitles(4).partition("dzoom_ratio: 1.00")
    path.with_suffix(".SRT").write_text(first + "dzoom_ratio: 2.00" + rest)
    contents = read_dji_video(path, OPTIONS)
    focals_px = [picture.camera.fx for picture in contents.pictures]
    assert focals_px == pytest.approx([2 * 758.3, *[758.3] * 3], abs=0.1)
    assert contents.parameters == {"north.sigma_deg": 3.0, "confidence.focal_sigma": 0.02}
    assert not any("--camera" in note for note in contents.notes)


def test_colours_stay(tmp_path):
    (tmp_path / "a.srt").write_text(made_subtitles(GROUP))
    contents = read_dji_video(made_video(tmp_path / "a.mov", GROUP, colour=30), OPTIONS)
    pixels = cv2.imdecode(np.frombuffer(next(iter(contents.pictures)).data, np.uint8), -1)
    assert pixels.shape == (48, 64, 3)
    assert np.ptp(pixels.mean((0, 1))) > 30


def test_of_fewer_cues_the_times_are_interpolated(tmp_path):
    (tmp_path / "a.SRT").write_text(made_subtitles(4, 1000))
    contents = read_dji_video(made_video(tmp_path / "a.mp4", 120), OPTIONS)
    stamps_ms = [picture.stamp_ns / 1e6 - BEGUN for picture in contents.pictures]
    np.testing.assert_allclose(stamps_ms, np.arange(120) / 0.03, atol=0.1)
    assert contents.read["picture"] == 120


def test_a_wrong_date_moves_no_picture(video):
    file = video.with_suffix(".SRT")
    file.write_text(file.read_text().replace("15:24:10.100", "15:34:10.100"))
    stamps_ms = [p.stamp_ns / 1e6 - BEGUN for p in read_dji_video(video, OPTIONS).pictures]
    np.testing.assert_allclose(stamps_ms, np.arange(COUNT) / 0.03, atol=1)


def test_subtitles_inside_the_file(video, tmp_path):
    text = made_subtitles(COUNT)
    within = read_dji_video(made_video(tmp_path / "in.mp4", COUNT, beside=inside(text)), OPTIONS)
    beside = read_dji_video(video, OPTIONS)
    assert list(map(repr, within.samples)) == list(map(repr, beside.samples))
    assert [p.stamp_ns for p in within.pictures] == [p.stamp_ns for p in beside.pictures]


def test_without_subtitles_it_says_what_is_needed(tmp_path):
    path = made_video(tmp_path / "DJI_0002_T.MP4", GROUP)
    with pytest.raises(LogError, match=r"neither subtitles in it nor DJI_0002_T\.SRT beside it"):
        read_dji_video(path, OPTIONS)
    for text in ("", "words\n"):
        path.with_suffix(".SRT").write_text(text)
        with pytest.raises(LogError, match=r"DJI_0002_T\.SRT: no subtitles in it"):
            read_dji_video(path, replace(OPTIONS, start_ns=10**18))


def test_subtitles_whose_times_do_not_fit(tmp_path):
    path, file = made_video(tmp_path / "a.mp4", GROUP), tmp_path / "a.SRT"
    years = (1979, 2005, 1980, 2003, 1993, 1983)  # all but one far from its neighbours
    dates = [f"{k}\n{year}-12-09 15:24:09\n" for k, year in enumerate(years)]
    dates[4] = dates[4].replace("1993", "10:00:00,000 --> 10:00:00,500\n1993")  # and that here
    file.write_text("\n".join(dates))
    with pytest.raises(LogError, match=r"a\.SRT: no two of its times fit together"):
        read_dji_video(path, OPTIONS)


def test_subtitles_of_another_video(tmp_path):
    path = made_video(tmp_path / "a.mp4", 180)
    path.with_suffix(".SRT").write_text(made_subtitles(300))
    with pytest.raises(LogError, match=r"a\.SRT: subtitles of another video: they last 10\.\d s"):
        read_dji_video(path, OPTIONS)
    path.with_suffix(".SRT").write_text(made_subtitles(180).replace("2024-12-09", "2024-12-05"))
    notes = read_dji_video(path, OPTIONS).notes
    assert any("the video is 4 days from its subtitles" in note for note in notes)


def test_a_video_without_its_index_is_refused(video):
    whole = video.read_bytes()
    video.write_bytes(whole[: whole.index(b"moov") - 4])  # it is at the end
    with pytest.raises(LogError, match=r"DJI_0001_T\.MP4: not a whole video.*moov"):
        read_dji_video(video, OPTIONS)


@pytest.mark.parametrize("is_cut_off", [True, False])
def test_lost_pictures_are_counted_and_the_rest_keep_their_times(video, is_cut_off):
    content = bytearray(made_video(video, COUNT, movflags="+faststart").read_bytes())
    start = content.index(b"mdat") + 4
    half = start + (len(content) - start) // 2
    content[half:] = b"" if is_cut_off else content[half + 99 :] + bytes(99)
    video.write_bytes(content)
    contents = read_dji_video(video, OPTIONS)
    pictures = list(contents.pictures)
    stamps = [attitude.stamp_ns for attitude in of(contents, CameraAttitudeSample)]
    assert {picture.stamp_ns for picture in pictures} <= set(stamps)
    assert contents.damaged
    assert 0 < contents.read["picture"] == COUNT - sum(contents.refused.values())


@settings(max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_flipped_bits_give_one_line_or_pictures(tmp_path, data):
    """In the index too, with its sizes, names and codecs."""
    path = tmp_path / "whole.mp4"
    if not path.exists():
        text = made_subtitles(GROUP)
        made_video(path, GROUP, beside=inside(text), movflags="+faststart")
    content = bytearray(path.read_bytes())
    for place in data.draw(st.lists(st.integers(0, len(content) - 1), min_size=1, max_size=30)):
        content[place] ^= 1 << data.draw(st.integers(0, 7))
    damaged = tmp_path / "damaged.mp4"
    damaged.write_bytes(content)
    stamps, message = [], ""
    try:
        stamps = [picture.stamp_ns for picture in read_dji_video(damaged, OPTIONS).pictures]
    except LogError as error:
        message = str(error)
    assert stamps == sorted(set(stamps))
    assert message.startswith(str(damaged)) or not message
    assert "\n" not in message


def test_the_import_reads_the_subtitles_once(video, tmp_path):
    done = []
    report = lambda *amounts: done.append(amounts)  # noqa: E731
    result = import_flight(video, tmp_path / "a.mcap", logs=OPTIONS, progress=report)
    import_flight([video, video.with_suffix(".SRT")], tmp_path / "b.mcap", logs=OPTIONS)
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert {topic: row["messages"] for topic, row in result["written"].items()} == dict.fromkeys(
        ("/gps/fix", "/gimbal/attitude", "/imu/data", "/thermal/image_raw/compressed"), COUNT
    )
    assert done[-1] == pytest.approx(((COUNT - 1) / 30, (COUNT - 1) / 30), abs=0.01)


def test_the_aircraft_is_level_below_the_camera(video):
    """A roll of 180 deg at a pitch of -90 is the same attitude with the yaw turned by 180."""
    turned = cue(COUNT, 1567, yaw_deg=-51.0).replace("-48.7 gb_roll: 0.0", "-90.0 gb_roll: 180.0")
    video.with_suffix(".SRT").write_text(made_subtitles(COUNT - 1) + "\n" + turned)
    attitudes = [s.autopilot_q_nb for s in of(read_dji_video(video, OPTIONS), ImuSample)]
    angles_deg = np.degrees([euler_from_quat(q) for q in (attitudes[0], attitudes[-1])])
    np.testing.assert_allclose(angles_deg, [(0, 0, 129)] * 2, atol=1e-9)

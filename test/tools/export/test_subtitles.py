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
"""Subtitles of the sample flight, as FFmpeg and readers of DJI's find them."""

from __future__ import annotations

import dataclasses
import math
import re
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import av
import numpy as np
import pytest
from exported_flight import GROUND_M, UNDULATION_M

from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.types.errors import ExportError
from tirgeo_ros.core.types.measurements import PositionSample
from tirgeo_ros.io.logs.dji_srt import read_srt
from tirgeo_ros.io.logs.log_contents import LogOptions
from tirgeo_ros.tools.export.subtitles import Subtitles

_DATE = re.compile(r"^(\d{4})-(\d\d)-(\d\d) (\d\d):(\d\d):(\d\d)[.,](\d{3})", re.MULTILINE)
_BRACKET = re.compile(r"\[([^\[\]]*)\]")
_FIELD = re.compile(r"(\w+) ?: ?([^\s\],]+)")


class Cue(NamedTuple):
    """Begin and end, s; the fields in brackets and in the lines before them; the whole text."""

    begin_s: float
    end_s: float
    fields: dict[str, str]
    text: str

    def numbers(self, *names: str) -> list[float]:
        return [float(self.fields[name]) for name in names]


def cues_of(path: Path) -> list[Cue]:
    """The cues as FFmpeg's reader of SubRip finds them."""
    cues = []
    with av.open(str(path)) as container:
        for packet in container.demux(subtitles=0):
            if packet.pts is None:
                continue
            text = bytes(packet).decode()
            parts = [text.partition("[")[0].partition("\n")[0], *_BRACKET.findall(text)]
            fields = dict(_FIELD.findall(" ".join(parts)))
            if date := _DATE.search(text):
                fields["date"] = date.group()
            begin, length = (float(x * packet.time_base) for x in (packet.pts, packet.duration))
            cues.append(Cue(begin, begin + length, fields, text))
    return cues


ABOVE = "20 m above the ground, 40 m above sea level, camera to 200 deg, 30 deg down"


@pytest.fixture
def written(flight, tmp_path):
    """Writes the subtitles of some frames, and reads them."""

    def write(frames=None, **options):
        path = tmp_path / "flight.srt"
        product = Subtitles(path, stamps_ns=flight.stamps_ns, **options)
        for frame in flight.frames if frames is None else frames:
            product.take(frame)
        assert not path.exists()  # before it is complete
        summary = product.finish()
        cues = cues_of(path)
        assert summary == {"file": str(path), "cues": len(cues)}
        return cues

    return write


def test_each_picture_has_its_cue_at_its_time_in_the_video(written, flight):
    cues = written()
    assert len(cues) == len(flight.frames)
    first_ns = flight.stamps_ns[0]
    for cue, frame in zip(cues, flight.frames, strict=True):
        # A millisecond is the format's step, half of it the rounding.
        assert cue.begin_s == pytest.approx((frame.stamp_ns - first_ns) * 1e-9, abs=0.51e-3)
        assert cue.end_s - cue.begin_s == pytest.approx(1 / 9, abs=1.1e-3)
        assert cue.fields["FrameCnt"] == f"{frame.number + 1}"
        assert cue.fields["DiffTime"] == "111ms"


def test_cues_have_the_cameras_position_and_attitude(written, flight):
    cues = written(undulation_m=UNDULATION_M)
    for cue, frame in zip(cues, flight.frames, strict=True):
        latitude, longitude, height = frame.plane.geodetic_from_ned(frame.pose.position_n)
        result = cue.numbers("latitude", "longitude")
        assert result == pytest.approx(np.degrees([latitude, longitude]), abs=0.51e-8)
        result = cue.numbers("abs_alt", "rel_alt")
        assert result == pytest.approx([height - UNDULATION_M, height - GROUND_M], abs=1e-3)
        yaw, pitch = np.radians(cue.numbers("gb_yaw", "gb_pitch"))
        forward = [math.cos(pitch) * c for c in (math.cos(yaw), math.sin(yaw))]
        expected = matrix_from_quat(frame.pose.q_nc)[:, 2]
        # Half of a hundredth of a degree, for each of two angles.
        assert [*forward, -math.sin(pitch)] == pytest.approx(expected, abs=2e-4)
    cue = cues[39 - 14]
    assert cue.text.splitlines()[-1] == ABOVE
    assert cue.fields["date"] == "2021-10-20 12:00:39.333"


def test_unknown_heights_are_left_out(written, flight):
    bare = [dataclasses.replace(item, ground=None) for item in flight.frames[:20]]
    cue = written(bare)[7]
    assert "rel_alt" not in cue.fields
    assert cue.text.splitlines()[-1].startswith("31 m above the ellipsoid, camera to")
    height = bare[7].plane.geodetic_from_ned(bare[7].pose.position_n)[2]
    assert cue.numbers("abs_alt") == pytest.approx([height], abs=1e-3)


def test_cues_of_chosen_pictures_last_until_the_next(written, flight):
    cues = written(flight.frames[::9], every_s=1.0)
    assert len(cues) == 29
    for before, after in pairwise(cues):
        assert before.end_s == pytest.approx(after.begin_s, abs=1e-9)
    assert cues[-1].end_s == pytest.approx(30.0, abs=1e-3)  # the last picture's end


def test_no_cue_while_the_pose_is_lost(written, flight):
    frames = [item for item in flight.frames[::9] if not 100 <= item.number < 140]
    cues = written(frames, every_s=1.0)
    last = max(item.number for item in frames if item.number < 100)
    assert not [c for c in cues if last + 1.5 < c.end_s * 9 and c.begin_s * 9 < 139.5]
    (before,) = [c for c in cues if c.fields["FrameCnt"] == f"{last + 1}"]
    assert before.end_s == pytest.approx((last + 1) / 9, abs=1e-3)


def test_an_empty_file_is_not_written_and_one_that_cannot_be_is_named(flight, tmp_path):
    product = Subtitles(tmp_path / "flight.srt", stamps_ns=[])
    assert product.finish() == {"file": str(tmp_path / "flight.srt"), "cues": 0}
    assert not list(tmp_path.iterdir())
    product = Subtitles(tmp_path / "absent" / "flight.srt", stamps_ns=flight.stamps_ns)
    product.take(flight.frames[0])
    with pytest.raises(ExportError, match=r"absent/flight.srt: cannot be written: No such file"):
        product.finish()


def test_import_reads_them_back(written, flight, tmp_path):
    written(undulation_m=UNDULATION_M)
    options = LogOptions(geoid_undulation_m=UNDULATION_M, height="sea", utc_offset_s=0)
    result = read_srt(tmp_path / "flight.srt", options)
    places = [item for item in result.samples if isinstance(item, PositionSample)]
    assert len(places) == len(flight.frames)
    for place, frame in zip(places, flight.frames, strict=True):
        # Stamps to a millisecond; degrees to 8 decimals, heights to a millimetre.
        assert abs(place.stamp_ns - frame.pose.stamp_ns) < 1.01e6
        geodetic = (place.latitude_rad, place.longitude_rad, place.height_m)
        off_m = frame.plane.ned_from_geodetic(*geodetic) - frame.pose.position_n
        assert np.abs(off_m).max() < 2e-3


@pytest.mark.parametrize("name", ["mavic3", "avata360_gimbal"])
def test_the_form_is_that_of_real_ones(written, shared, name):
    """The same reader finds the same fields in what DJI's cameras wrote."""
    real = cues_of(shared / f"foreign_logs/dji/srt/{name}.srt")
    ours = written()[0]
    fields = ["FrameCnt", "DiffTime", "date", "latitude", "longitude", "rel_alt", "abs_alt"]
    fields += ["gb_yaw", "gb_pitch", "gb_roll"] if name == "avata360_gimbal" else []
    for field in fields:
        form = re.sub(r"\d+", "0", ours.fields[field].lstrip("-"))
        assert {re.sub(r"\d+", "0", item.fields[field].lstrip("-")) for item in real} == {form}
    head = re.escape('<font size="28">FrameCnt: ')
    assert all(re.match(head, item.text) for item in (ours, *real))

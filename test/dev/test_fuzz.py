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
"""The fuzz itself: 1e7 bytes without a difference, and differences that it must find."""

from __future__ import annotations

import math
import random
import re

import numpy as np
import pytest

from dev import fuzz
from dev.fuzz import KEY, damaged_stream
from tirgeo_ros.core.types.measurements import CameraAttitudeSample, ImuSample, PositionSample
from tirgeo_ros.dji.interpret.interpreter import Interpreter
from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame, encode_frame
from tirgeo_ros.tools.presentation.progress import silent

FRAME = encode_frame(b"\x02\x00\x00\x00")


@pytest.mark.slow
def test_ten_million_bytes_of_damage(monkeypatch):
    kinds = set()

    class Watched(Interpreter):
        def take(self, reading):
            samples = super().take(reading)
            kinds.update(map(type, samples))
            return samples

    monkeypatch.setattr(fuzz, "Interpreter", Watched)
    result = fuzz.fuzz(10_000_000, 1000, silent)
    assert result.difference == ""
    assert result.bytes == 10_000_000
    assert result.frames > 20_000
    # Else there would be nothing that could be found not finite.
    assert kinds > {ImuSample, PositionSample, CameraAttitudeSample}


def test_the_damage_holds_everything_that_matters():
    reader = FrameReader(KEY)
    frames = reader.feed(damaged_stream(random.Random(3), 300_000))
    assert {f.encryption for f in frames} == {0, 1}
    assert {f.is_ack for f in frames} == {False, True}
    assert any(f.length == 12 for f in frames)
    assert max(f.length for f in frames) > 900
    counts = reader.counts
    assert min(counts["bad_headers"], counts["bad_crc32"], counts["encrypted"]) > 50
    assert {(f.cmd_set, f.cmd_id) for f in frames} >= {(2, 0), (2, 5)}


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (FRAME, [(0, 20)]),
        (b"\xaa" + FRAME + b"\xaa", [(1, 20)]),
        (FRAME[:-1], []),
        (FRAME[:12] + FRAME + FRAME[:12], [(12, 20)]),
        (encode_frame(b"") + encode_frame(FRAME), [(0, 12), (12, 36)]),
        (bytes([0xAA, 20, 4]) + FRAME[3:], []),
    ],
)
def test_the_rules_read_one_byte_at_a_time(data, expected):
    assert fuzz.literal_frames(data) == expected


class ThrowsAway(FrameReader):
    """Takes a damaged frame's length for true."""

    def _frame(self, at, length):
        frame = super()._frame(at, length)
        if frame is None and at + length <= len(self._buffer):
            self._buffer = self._buffer[:at] + bytes(length) + self._buffer[at + length :]
        return frame


class Hoards(FrameReader):
    """Keeps all that it is given, until the end."""

    def feed(self, data):
        self._buffer += data
        return []


class MakesUp(FrameReader):
    """Finds a frame whenever the line is silent."""

    def rescan(self):
        end = self.counts["bytes"]
        return [*super().rescan(), ProtocolFrame(end, 12, 0, False, 0, 0, 0, b"", False)]


@pytest.mark.parametrize(
    ("reader", "message"),
    [
        (ThrowsAway, r"at \d+ the rules give another frame"),
        (Hoards, r"\d+ bytes are buffered, in pieces of up to \d+"),
        (MakesUp, r"at \d+ the rules give another frame"),
    ],
)
def test_a_wrong_reader_is_found_out(reader, message, monkeypatch, capsys):
    monkeypatch.setattr(fuzz, "FrameReader", reader)
    assert fuzz.main(["--bytes", "2e6", "--seed", "7"]) == 1
    reports = capsys.readouterr().out
    assert re.search(rf"{message} \(again: --seed \d+ --bytes 1\)\n$", reports)
    again = re.search(r"--seed (\d+)", reports)
    assert again
    assert fuzz.main(["--bytes", "1", "--seed", again[1]]) == 1


class Spreads(Interpreter):
    """Hands on what is not a number."""

    def take(self, reading):
        wrong = np.array([0.0, math.nan, -9.8])
        return [*super().take(reading), ImuSample(reading.stamp_ns, wrong, np.zeros(3))]


def test_what_raises_is_told_with_its_seed(monkeypatch, capsys):
    monkeypatch.setattr(Interpreter, "take", lambda *_: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        fuzz.main(["--bytes", "1", "--seed", "9"])
    assert "raised by --seed 9 --bytes 1" in capsys.readouterr().err


def test_what_is_not_finite_is_found_out(monkeypatch, capsys):
    monkeypatch.setattr(fuzz, "Interpreter", Spreads)
    assert fuzz.main(["--bytes", "1"]) == 1
    assert re.search(r"not finite: ImuSample\(.*nan.*--seed 0", capsys.readouterr().out)

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
"""tirgeo process on several cores: the bytes of one, in order, and no half work."""

from __future__ import annotations

import os
import signal
from collections import deque

import numpy as np
import pytest
from process_bags import IMAGES, rewritten
from project import child_of

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.overlay.frame_shapes import DrawingVerdict, Unpainted
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.types.errors import PictureError
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.tools.replay.picture_stage import Painted
from tirgeo_ros.tools.replay.process import process
from tirgeo_ros.tools.replay.process_outputs import PictureOutputs

_STAGE = "tirgeo_ros.tools.replay.picture_stage"
#: Of the summary: what differs from run to run.
_CLOCK = {"elapsed_s", "speed", "output"}


@pytest.fixture(scope="module")
def flown(sample, tmp_path_factory):
    """Three seconds, one of them aligning, with a picture that is cut off and one that is none."""
    count = iter(range(100))

    def damaged(item):
        number = next(count) if item.topic == IMAGES else -1
        cut_off = {12: len(item.data) // 2, 14: 100}.get(number)
        return item.topic, item.data[:cut_off]

    path = tmp_path_factory.mktemp("flown") / "flight.mcap"
    return rewritten(sample / "flight.mcap", path, damaged, seconds=2.8)


def outputs(flown, folder, cores, options, **more):
    """What a run leaves: its files' bytes, and its summary."""
    folder.mkdir()
    files = {"raw_images": True, "video": folder / "out.ts"}
    summary = process(flown, folder / "out.mcap", cores=cores, **files, **options, **more)
    reports = {name: summary[name] for name in summary.keys() - _CLOCK}
    return {one.name: one.read_bytes() for one in folder.iterdir()}, reports


def test_the_same_bytes_on_any_number_of_cores(flown, options, sample, tmp_path):
    overlay = tmp_path / "overlay.yaml"
    overlay.write_text("/**/overlay_node: {ros__parameters: {rectify: true, palette: iron}}\n")
    given = options | {"params": [sample / "params.yaml", overlay]}
    one, several = (outputs(flown, tmp_path / f"{n}", n, given) for n in (1, 3))
    assert one[1] == several[1]
    assert one[1]["overlay"]["drawn"] > 8
    assert sum(one[1]["undecodable"].values()) == 2
    assert one[0].keys() == {"out.mcap", "out.ts"}
    assert one[0] == several[0]


@pytest.mark.parametrize("at_s", [pytest.param(0.2, marks=pytest.mark.slow), 1.5])
def test_a_painter_that_is_killed_is_one_line_and_no_file(flown, options, tmp_path, at_s):
    def kill(done_s, _total_s):
        if done_s > at_s and not killed:
            killed.append(child_of(os.getpid(), _STAGE))
            os.kill(killed[0], signal.SIGKILL)

    killed: list[int] = []
    with pytest.raises(
        PictureError, match=r"draws the pictures ended \(exit code -9\); if memory"
    ):
        process(flown, tmp_path / "out.mcap", cores=2, progress=kill, **options)
    assert [*tmp_path.iterdir()] == []


@pytest.mark.slow
def test_ctrl_c_ends_the_painter_too(flown, options, tmp_path):
    painters = []

    def interrupt(done_s, _total_s):
        if done_s > 1.0:
            painters.append(child_of(os.getpid(), _STAGE))
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process(flown, tmp_path / "out.mcap", cores=2, progress=interrupt, **options)
    assert [*tmp_path.iterdir()] == []
    with pytest.raises(ProcessLookupError):
        os.kill(painters[0], 0)


class _SlowStage:
    """Hands out a picture only when it must."""

    def __init__(self):
        self.most_under_way, self.sent = 3, deque()

    def send(self, picture, _scene, **_options):
        self.sent.append(picture.stamp_ns)

    def receive(self):
        return Painted(b"%d" % self.sent.popleft(), None, None)


def unpainted(stamp_ns):
    grey = np.zeros((2, 2), np.uint8)
    rest = 0.0, (), DrawingVerdict(), None, 0.0, 9.0, 0
    return Unpainted(stamp_ns, grey, XT2, None, None, "", *rest)


def test_messages_wait_for_the_picture_before_them_and_not_for_ever():
    written: list[tuple[str, int]] = []

    def write(topic, message, log_time_ns):
        written.append((topic, log_time_ns))

    stage = _SlowStage()
    made = PictureOutputs(stage, Messages(), write, None, 1.0, raw_images=False)
    overlay = Overlay(OverlayConfig(), None)

    def picture(stamp_ns):
        made.add(unpainted(stamp_ns), overlay, lambda _: None, stamp_ns)

    made.put("a", None, 0)
    for stamp_ns in (1, 3, 5):
        picture(stamp_ns)
        made.put("a", None, stamp_ns + 1)
    assert written == []  # no picture is finished, and messages are written in blocks
    picture(7)  # one too many
    jpeg, info = "tirgeo/overlay/image/compressed", "tirgeo/overlay/camera_info"
    assert written == [("a", 0), (jpeg, 1), (info, 1), ("a", 2)]
    for number in range(20_000):
        made.put("a", None, 8 + number)
    assert len(written) > 15_000  # the video has stopped: what follows is written
    made.finish()
    assert written == sorted(written, key=lambda one: one[1])
    assert len(written) == 1 + 3 + 20_000 + 4 * 2

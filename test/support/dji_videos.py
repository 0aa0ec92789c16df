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
"""Videos as DJI's cameras write them, with subtitles beside them or inside."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest

RATE_HZ, WIDTH, HEIGHT, GROUP = 30, 64, 48, 12
BEGUN = 1_733_757_849_500  # of the first cue, ms of Unix time: 2024-12-09 15:24:09.5 UTC
#: What the encoder of subtitles needs.
_STYLES = b"[V4+ Styles]\r\nFormat: Name, Fontname\r\nStyle: Default,Arial\r\n\r\n[Events]\r\n"


def level(number):
    """Return the grey level (0 to 255) of a picture of ``made_video``."""
    return (number % 50) * 4 * 255 / 219


def cue(number, time_ms, *, yaw_deg=129.0):
    """Return a cue of a thermal camera, as a Mavic 3T writes it, in the local time of UTC."""
    clock = f"00:{time_ms // 60_000:02}:{time_ms // 1000 % 60:02},{time_ms % 1000:03}"
    date = np.datetime64(BEGUN + time_ms, "ms").astype(str).replace("T", " ")
    return (
        f'{number}\n{clock} --> {clock}\n<font size="28">FrameCnt: {number}\n{date}\n'
        f"[focal_len: 40.00] [dzoom_ratio: 1.00], [latitude: {-22.9 + number * 1e-6:.6f}] "
        f"[longitude: -43.221529] [rel_alt: 40.182 abs_alt: 52.584] "
        f"[gb_yaw: {yaw_deg} gb_pitch: -48.7 gb_roll: 0.0] </font>\n"
    )


def made_subtitles(count, step_ms=1000 / RATE_HZ):
    """Return an SRT with a cue each ``step_ms``."""
    return "\n".join(cue(k + 1, round(k * step_ms)) for k in range(count))


def inside(srt):
    """Return the cues of an SRT as ``made_video`` puts them into a video."""
    texts = [part.split("\n", 2)[2].encode() for part in srt.split("\n\n")]
    return [len(text).to_bytes(2, "big") + text for text in texts]


def made_video(path, count, *, beside=(), colour=0, size=(WIDTH, HEIGHT), **options):
    """Write a video of uniform pictures (see ``level``); of a second stream one packet a picture.

    ``beside`` are its packets: KLV in a .ts, else subtitles. ``colour`` is the pictures' chroma,
    from grey; ``options`` are the container's.
    """
    width, height = size
    av = pytest.importorskip("av")
    with av.open(str(path), "w", options=options) as container:
        container.metadata["creation_time"] = "2024-12-09T15:24:10Z"
        video = container.add_stream("libx264", rate=RATE_HZ, options={"g": str(GROUP)})
        video.width, video.height, video.pix_fmt = width, height, "yuv420p"
        if beside and path.suffix == ".ts":
            track = container.add_data_stream("klv")
        elif beside:
            track = container.add_stream("mov_text")
            track.codec_context.subtitle_header = _STYLES
        for number in range(count):
            planes = np.full((height * 3 // 2, width), 128 + colour, np.uint8)
            planes[:height] = 16 + number % 50 * 4
            frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            frame.pts, frame.time_base = number, Fraction(1, RATE_HZ)
            container.mux(video.encode(frame))
            for data in beside[number : number + 1]:
                packet = av.Packet(data)
                packet.stream, packet.time_base = track, Fraction(1, 1000)
                packet.pts = packet.dts = round(number * 1000 / RATE_HZ)
                packet.duration = 33
                container.mux(packet)
        container.mux(video.encode(None))
    return path

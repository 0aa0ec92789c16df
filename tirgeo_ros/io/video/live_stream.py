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
"""Send the video live with its metadata: H.264 and KLV in MPEG-TS over UDP."""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import threading
import time
import urllib.parse
from collections import Counter
from typing import NamedTuple, final

import cv2
import numpy as np

from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import VideoError, shown
from tirgeo_ros.core.types.missing_package import needed
from tirgeo_ros.io.messages.pictures import MOST_OF_VIDEO, unpacked
from tirgeo_ros.io.video.frame_metadata import FrameMetadata
from tirgeo_ros.io.video.video_file import Encoder, Form, FrameTimes

#: A viewer that joins waits for a key frame, so key frames come often.
_FORM = Form(
    "mpegts",
    {"preset": "veryfast", "tune": "zerolatency", "crf": "26", "g": "15"},
    {"flush_packets": "1"},
)
#: Seven packets of 188 bytes: a datagram of this size needs no fragments on any network.
_DATAGRAM = {"pkt_size": "1316"}
_RETRY_S = 1.0


class _Frame(NamedTuple):
    time_ns: int
    picture: Pixels | bytes
    sight: Sight | None


def stream_url(address: str) -> str:
    """Return FFmpeg's address for ``udp://HOST:PORT``; raise VideoError for any other form.

    ``?ttl=N`` says over how many routers a multicast goes, ``localaddr=IP`` from which of this
    computer's addresses it is sent.
    """
    try:
        # urlsplit would remove line breaks silently.
        parts = urllib.parse.urlsplit(address if address.isprintable() else "")
        options = dict(urllib.parse.parse_qsl(parts.query, keep_blank_values=True))
        ipaddress.ip_address(options.get("localaddr", "127.0.0.1"))
        good = parts.scheme == "udp" and parts.hostname and parts.port
        good = good and options.keys() <= {"ttl", "localaddr"}
        good = good and int(options.get("ttl", "1")) in range(1, 256)
    except ValueError:
        good = False
    if not good or parts.path or parts.fragment or parts.username is not None:
        raise VideoError(
            f"stream {shown(address)}: give udp://HOST:PORT, and after a question mark ttl (1 to "
            "255) or localaddr (an address of this computer): udp://239.1.1.1:5004?ttl=4"
        )
    return parts._replace(query=urllib.parse.urlencode(options | _DATAGRAM, safe=":")).geturl()


@final
class LiveStream:
    """Send pictures from a thread of its own, the newest first; the caller never waits.

    A picture that comes while an earlier one waits replaces it. If nothing can be sent (no route,
    an unknown host), it tries again every second. It sends even if nobody receives.
    ``counts``: ``sent``, ``replaced``, ``failed`` (not sent, see ``error``) and ``invalid``
    pictures. ``error`` is the reason why the newest picture was not sent; empty if it was.
    """

    def __init__(self, address: str, metadata: FrameMetadata) -> None:
        self._address, self._url = address, stream_url(address)
        needed("av", f"sending video to {address}", VideoError)
        self.counts: Counter[str] = Counter(sent=0, replaced=0, failed=0, invalid=0)
        self.error = ""
        self._metadata = metadata
        self._waiting: _Frame | None = None
        self._closed = False
        self._changed = threading.Condition()
        self._times = FrameTimes()
        self._encoder: Encoder | None = None
        self._shape: tuple[int, ...] = ()
        self._retry_s = 0.0
        self._thread = threading.Thread(target=self._run, name="live_stream", daemon=True)
        self._thread.start()

    def add(self, time_ns: int, picture: Pixels | bytes, sight: Sight | None) -> None:
        """Send a picture, (h, w, 3) BGR or JPEG; ``sight`` is None without a trusted pose."""
        with self._changed:
            self.counts["replaced"] += self._waiting is not None
            self._waiting = _Frame(time_ns, picture, sight)
            self._changed.notify()

    def close(self) -> None:
        """Stop sending; wait for the thread, at most 2 s."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(2.0)

    def _run(self) -> None:
        while (frame := self._next()) is not None:
            pixels = _pixels(frame.picture)
            if pixels is None:
                self.counts["invalid"] += 1
            elif time.monotonic() < self._retry_s:
                self.counts["failed"] += 1
            else:
                self._try(frame, pixels)
        self._drop()

    def _next(self) -> _Frame | None:
        """Wait for a picture and return it; None when the stream is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._waiting is not None)
            frame, self._waiting = self._waiting, None
            return None if self._closed else frame

    def _try(self, frame: _Frame, pixels: Pixels) -> None:
        packet = self._metadata.packet(frame.time_ns, frame.sight)
        if pixels.shape != self._shape:
            self._drop()
        try:
            if self._encoder is None:
                self._shape = pixels.shape
                size = pixels.shape[1], pixels.shape[0]
                self._encoder = Encoder(self._url, _FORM, size, metadata=True)
            self._encoder.add(self._times.at(frame.time_ns), pixels, packet)
        except OSError as error:
            self.counts["failed"] += 1
            unknown = "no computer of this name is known here; write its IP address"
            # FFmpeg's error for a name that nothing resolves.
            why = unknown if error.errno == errno.EIO else error.strerror or str(error)
            self.error = f"{self._address}: cannot be sent: {why}"
            self._retry_s = time.monotonic() + _RETRY_S
            self._drop()
        else:
            self.counts["sent"] += 1
            self.error = ""

    def _drop(self) -> None:
        if self._encoder is not None:
            with contextlib.suppress(OSError):
                self._encoder.close()
        self._encoder = None


def _pixels(picture: Pixels | bytes) -> Pixels | None:
    """Return a picture's pixels (h, w, 3) BGR; None if it is invalid."""
    if isinstance(picture, bytes):
        try:
            decoded = unpacked(picture, cv2.IMREAD_COLOR, MOST_OF_VIDEO)
        except ValueError:
            return None
        return None if decoded is None else np.asarray(decoded, np.uint8)
    return picture if picture.ndim == 3 and picture.shape[2] == 3 and picture.size else None

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
"""The live stream: another program receives it, and the sender never waits."""

from __future__ import annotations

import socket
import threading
import time

import cv2
import numpy as np
import pytest
from klv_reader import Demuxed, demuxed, values_in
from project import free_port, wait_until

from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.types.errors import VideoError
from tirgeo_ros.io.video import live_stream
from tirgeo_ros.io.video.frame_metadata import FrameMetadata
from tirgeo_ros.io.video.live_stream import LiveStream, stream_url

METADATA = FrameMetadata(ConfidenceConfig())
START_NS = 1_634_731_264_000_000_000
STEP_NS = 40_000_000
PIXELS = np.zeros((48, 64, 3), np.uint8)
LIMIT_S = 60.0  # a wait that ends long before, on any machine


@pytest.fixture
def opened():
    streams = []

    def make(address="udp://127.0.0.1:9"):
        streams.append(LiveStream(address, METADATA))
        return streams[-1]

    yield make
    for item in streams:
        item.close()


class Codec:
    """Stands in for the encoder: says what it got, waits or fails as the test wants."""

    def __init__(self, monkeypatch):
        self.times, self.sizes, self.errors, self.closed = [], [], [], 0
        self.go, self.busy = threading.Event(), threading.Event()
        self.go.set()
        monkeypatch.setattr(live_stream, "Encoder", self._opened)

    def _opened(self, _url, _form, size, *, metadata):
        assert metadata
        self.sizes.append(size)
        return self

    def add(self, _time_ns, _pixels, packet):
        self.busy.set()
        assert self.go.wait(LIMIT_S)
        if self.errors:
            raise self.errors.pop()
        self.times.append(values_in(packet)[2])

    def close(self):
        self.closed += 1


@pytest.fixture
def codec(monkeypatch):
    return Codec(monkeypatch)


def sent(stream, count):
    wait_until(lambda: stream.counts["sent"] == count)


@pytest.mark.parametrize("form", ["pixels", "jpeg"])
def test_another_program_receives_each_packet_with_its_frame(opened, form):
    address = f"udp://127.0.0.1:{free_port(socket.SOCK_DGRAM)}"
    got: list[Demuxed] = []
    reader = threading.Thread(target=lambda: got.append(demuxed(address, most=20)), daemon=True)
    reader.start()
    stream, number, end_s = opened(address), 0, time.monotonic() + LIMIT_S
    while reader.is_alive():  # however late the reader begins to listen
        assert time.monotonic() < end_s
        pixels = np.full((48, 64, 3), number % 250, np.uint8)
        jpeg = cv2.imencode(".jpg", pixels)[1].tobytes()
        stream.add(START_NS + number * STEP_NS, jpeg if form == "jpeg" else pixels, None)
        number += 1
        time.sleep(0.01)
    result = got[0]
    both = set(result.frame_s) & set(result.packet_s)
    assert len(both) >= 15  # the first and the last may be alone, for UDP has no beginning
    stamps_s = np.array([values_in(item)[2] for item in result.packets]) * 1e-6
    offsets = stamps_s - result.packet_s
    np.testing.assert_allclose(offsets, offsets[0], atol=1e-4)  # microseconds and 1/90000 s


def test_the_newest_picture_wins_and_nobody_waits(opened, codec):
    codec.go.clear()
    stream = opened()
    stream.add(START_NS, PIXELS, None)
    assert codec.busy.wait(LIMIT_S)
    for k in range(1, 100):  # returns at once, though the codec stands still
        stream.add(START_NS + k * STEP_NS, PIXELS, None)
    assert stream.counts["replaced"] == 98
    codec.go.set()
    sent(stream, 2)
    assert codec.times == [(START_NS + k * STEP_NS) // 1000 for k in (0, 99)]


def test_the_stream_goes_on_when_the_network_is_back(opened, codec, monkeypatch):
    monkeypatch.setattr(live_stream, "_RETRY_S", 0.0)
    codec.errors.append(OSError(101, "Network is unreachable"))
    stream = opened()
    stream.add(START_NS, PIXELS, None)
    wait_until(lambda: stream.counts["failed"] == 1)
    assert stream.error == "udp://127.0.0.1:9: cannot be sent: Network is unreachable"
    wait_until(lambda: codec.closed == 1)
    stream.add(START_NS + STEP_NS, PIXELS, None)
    sent(stream, 1)
    wait_until(lambda: not stream.error)
    for k, side in enumerate((1, 2), 2):
        stream.add(START_NS + k * STEP_NS, np.zeros((48 * side, 64 * side, 3), np.uint8), None)
        sent(stream, k)
    assert codec.sizes == [(64, 48), (64, 48), (128, 96)]  # another size is another video


def test_a_failure_is_not_tried_again_at_once(opened, codec):
    codec.errors.append(OSError(101, "Network is unreachable"))
    stream = opened()
    for k in range(3):
        stream.add(START_NS + k * STEP_NS, PIXELS, None)
        wait_until(lambda k=k: stream.counts["failed"] == k + 1)
    assert len(codec.sizes) == 1


@pytest.mark.parametrize("bad", [b"", b"no picture", np.zeros((4, 4), np.uint8), PIXELS[:0]])
def test_invalid_pictures_are_counted(opened, codec, bad):
    stream = opened()
    stream.add(START_NS, bad, None)
    wait_until(lambda: stream.counts["invalid"] == 1)
    stream.add(START_NS, PIXELS, None)
    sent(stream, 1)


def test_an_unknown_host_is_named(opened):
    stream = opened("udp://no-such-host.invalid:5004")
    stream.add(START_NS, PIXELS, None)
    wait_until(lambda: stream.counts["failed"] == 1)
    assert stream.error == (
        "udp://no-such-host.invalid:5004: cannot be sent: no computer of this name is known here; "
        "write its IP address"
    )


@pytest.mark.parametrize(
    "address",
    [
        *("", "out.ts", "file:///etc/x", "tcp://h:1", "udp://[::1:5", "udp://h:1?pkt_size=1"),
        *("udp://h", "udp://:5", "udp://h:0", "udp://h:99999", "udp://h:1/x", "udp://u@h:1"),
        *("udp://h:1#x", "udp://h:1?ttl=", "udp://h:1?ttl=0", "udp://h:1?ttl=256"),
        *("udp://h:1?ttl=many", "udp://h:1?localaddr=eth0", "udp://h\r\nx:1"),
    ],
)
def test_other_addresses_are_refused(address):
    with pytest.raises(VideoError, match=r"give udp://HOST:PORT.*udp://239\.1\.1\.1:5004\?ttl=4"):
        LiveStream(address, METADATA)


@pytest.mark.parametrize(
    "address", ["udp://239.1.1.1:5004?ttl=4", "udp://[ff15::1]:5004?ttl=255&localaddr=fe80::1"]
)
def test_multicast(address):
    assert stream_url(address) == f"{address}&pkt_size=1316"
    assert stream_url("udp://[ff15::1]:5004?") == "udp://[ff15::1]:5004?pkt_size=1316"

"""Encode pictures into a container, each at its own time, with metadata beside them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from fractions import Fraction
from typing import Any, NamedTuple, final

import numpy as np

from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.errors import VideoError

_CLOCK_HZ = 90_000
_FIRST_STEP_NS = 100_000_000
_SHORTEST_STEP_NS = 100_000  # nine ticks of the clock, so that no two frames share one
_LONGEST_STEP_NS = 10_000_000_000


class Form(NamedTuple):
    """Hold a container's name in FFmpeg, the codec, and the options of both."""

    container: str
    codec: str
    options: Mapping[str, str]
    container_options: Mapping[str, str]


class FrameTimes:
    """Turn stamps into times from 0, ns, that always increase.

    A step between stamps that is not between 0.1 ms and 10 s is replaced by the step before it.
    """

    def __init__(self) -> None:
        self.time_ns = 0
        self._last_stamp_ns: int | None = None
        self._step_ns = _FIRST_STEP_NS

    def at(self, stamp_ns: int) -> int:
        """Return the next frame's time, ns."""
        if self._last_stamp_ns is not None:
            step_ns = stamp_ns - self._last_stamp_ns
            if _SHORTEST_STEP_NS <= step_ns < _LONGEST_STEP_NS:
                self._step_ns = step_ns
            self.time_ns += self._step_ns
        self._last_stamp_ns = stamp_ns
        return self.time_ns


def require_av(name: str) -> None:
    """Raise VideoError, naming what is to be written, if PyAV is not installed."""
    try:
        import av  # noqa: F401, PLC0415  35 MB that only videos need
    except ImportError as error:
        raise VideoError(f"{name}: a video needs PyAV: pip install av ({error})") from error


@contextlib.contextmanager
def _as_os_errors() -> Iterator[None]:
    """Raise OSError for any error of PyAV: some are ValueErrors, OverflowErrors and others."""
    from av.error import FFmpegError  # noqa: PLC0415  35 MB that only videos need

    try:
        yield
    except FFmpegError as error:
        raise OSError(error.errno, error.strerror) from error


@final
class Encoder:
    """Write pictures (h, w, 3) BGR of one size to a file or an address; raise OSError.

    If a side has an odd number of pixels, its last pixel is repeated. With ``metadata`` there
    is a data stream of KLV beside the video: then each picture needs its packet, because the
    container waits for the stream that is behind.
    """

    @_as_os_errors()
    def __init__(
        self, target: str, form: Form, size: tuple[int, int], *, metadata: bool = False
    ) -> None:
        import av  # noqa: PLC0415  35 MB that only videos need

        self._av = av
        options = dict(form.container_options)
        self._container: Any = av.open(target, "w", format=form.container, options=options)
        self._video = self._video_stream(form, *size)
        self._klv: Any = self._container.add_data_stream("klv") if metadata else None

    def _video_stream(self, form: Form, width: int, height: int) -> Any:
        stream = self._container.add_stream(form.codec, rate=30, options=dict(form.options))
        stream.width, stream.height = width + width % 2, height + height % 2
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, _CLOCK_HZ)
        return stream

    @_as_os_errors()
    def add(self, time_ns: int, pixels: Pixels, metadata: bytes = b"") -> None:
        """Append a picture at a time from 0, ns, with its metadata."""
        height, width = pixels.shape[:2]
        if height % 2 or width % 2:
            pixels = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), "edge")
        frame = self._av.VideoFrame.from_ndarray(pixels, format="bgr24")
        frame.pts = round(time_ns * 1e-9 * _CLOCK_HZ)
        frame.time_base = Fraction(1, _CLOCK_HZ)
        self._write(frame)
        if self._klv is not None:  # after the picture, which then need not wait
            packet = self._av.Packet(metadata)
            packet.stream, packet.time_base = self._klv, frame.time_base
            packet.pts = packet.dts = frame.pts
            self._container.mux(packet)

    @_as_os_errors()
    def finish(self) -> None:
        """Write the pictures that the codec holds back, and the container's end."""
        self._write(None)
        self._container.close()

    @_as_os_errors()
    def close(self) -> None:
        """Free what it holds; without ``finish`` a file is not complete."""
        self._container.close()

    def _write(self, frame: Any) -> None:
        for packet in self._video.encode(frame):
            self._container.mux(packet)

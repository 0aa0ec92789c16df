"""Read the size of a recorded flight's pictures and compare it with the calibration's."""

from __future__ import annotations

from itertools import islice

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.checks.parameter_checks import size_fault
from tirgeo_ros.core.types.errors import CameraError, TirgeoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES
from tirgeo_ros.tools.replay.flight_topics import PICTURES, resolved

_TRIED = 10  # pictures to try, as the first ones may be damaged


def picture_size(reader: BagReader, namespace: str) -> tuple[int, int] | None:
    """Return (width, height) of the first picture that can be read, or None without one."""
    cdr, present = Cdr(), reader.topics()
    for topic in PICTURES:
        name = resolved(topic, namespace)
        if present.get(name) != TOPIC_TYPES[topic]:
            continue
        for message in islice(reader.messages([name]), _TRIED):
            try:
                pixels = convert.pixels(topic, cdr.deserialize(message.data, message.typename))
            except TirgeoError:
                continue
            return pixels.shape[1], pixels.shape[0]
    return None


def check_size(camera: Camera, size: tuple[int, int] | None, where: str) -> None:
    """Raise CameraError if a calibration has another size than the pictures (None: unknown)."""
    fault = size_fault(camera, *size) if size is not None else ""
    if fault:
        raise CameraError(
            f"{where}: {fault}: give the calibration of these pictures (--camera, or "
            "thermal/camera_info)"
        )

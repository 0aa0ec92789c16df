"""Draw map and control points on some of a flight's pictures, in the style of overlay_node."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.ground.backprojection import Ground
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.layers import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.overlay.map_renderer import MapRenderer
from tirgeo_ros.core.overlay.tone_mapping import ToneMapper
from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.io.surveys.survey import Observation
from tirgeo_ros.tools.evaluate.result import ControlPoint, Still
from tirgeo_ros.tools.replay.flight_poses import pose_at
from tirgeo_ros.tools.replay.flight_topics import PICTURES, resolved

#: Number of stills, spread over the flight.
STILLS = 4
_QUALITY = 85
_CLICK_BGR, _CLICK_PX = (0, 140, 255), 13
_CONTROL = LayerStyle(line_bgr=(120, 255, 120), width_px=2)
#: Largest time from a click's stamp to that of its picture.
_SAME_NS = 1_000_000


@dataclass(frozen=True)
class StillSource:
    """Hold the data from which the stills are drawn."""

    reader: BagReader
    namespace: str
    camera: Camera
    plane: TangentPlane
    poses: PoseBuffer[CameraPose]
    overlay: OverlayConfig
    ground: Ground
    layers: Sequence[MapLayer]
    method: str  # source of the poses


def overlay_stills(
    source: StillSource, control: Iterable[ControlPoint], observations: Sequence[Observation]
) -> list[Still]:
    """Return stills with clicks drawn; empty if the bag has no pictures."""
    drawing = _drawing(source, control)
    toner = ToneMapper(source.overlay.picture, source.overlay.palette)
    stills = []
    for stamp_ns, pixels in _pictures(source, _chosen(observations)):
        found = pose_at(source.poses, stamp_ns - round(source.overlay.video_latency_s * 1e9))
        if found is None or pixels.shape[:2] != (source.camera.height, source.camera.width):
            continue
        image = toner.tone(pixels, stamp_ns)
        drawing.draw(image, *found, ())
        clicks = [one for one in observations if abs(one.stamp_ns - stamp_ns) <= _SAME_NS]
        stills.append(_still(image, stamp_ns, clicks, source.method))
    return stills


def _drawing(source: StillSource, control: Iterable[ControlPoint]) -> MapRenderer:
    terrain = source.ground if isinstance(source.ground, Terrain) else None
    layers = [*source.layers, _control_layer(control)]
    drawing = MapRenderer(source.overlay, layers, terrain)
    drawing.set_plane(source.plane)
    drawing.set_camera(source.camera)
    return drawing


def _control_layer(control: Iterable[ControlPoint]) -> MapLayer:
    features = [
        GeoFeature(p.id, False, np.array([[p.latitude_rad, p.longitude_rad, p.height_m]]))
        for p in control
    ]
    return MapLayer("control points", features, _CONTROL)


def _chosen(observations: Sequence[Observation]) -> list[int]:
    """Return stamps of pictures: from each part of the flight the one with most clicks."""
    clicks = Counter(one.stamp_ns for one in observations)
    stamps = sorted(clicks)
    parts = np.array_split(np.array(stamps, np.int64), min(STILLS, len(stamps)))
    return [max(part.tolist(), key=clicks.__getitem__) for part in parts]


def _pictures(source: StillSource, stamps_ns: list[int]) -> Iterator[tuple[int, RawPixels]]:
    """Yield stamp and pixels of those pictures, as far as the bag has them."""
    there = source.reader.topics()
    topics = [t for name in PICTURES if (t := resolved(name, source.namespace)) in there]
    cdr = Cdr()
    for message in source.reader.messages(topics[:1]) if topics else ():
        with suppress(TirgeoError):  # errors are counted where the flight is read
            stamp_ns = header_stamp_ns(message.data)
            if any(abs(stamp_ns - one) <= _SAME_NS for one in stamps_ns):
                yield stamp_ns, _pixels(cdr.deserialize(message.data, message.typename))


def _pixels(message: Any) -> RawPixels:
    compressed = hasattr(message, "format")
    return convert.compressed_pixels(message) if compressed else convert.image_pixels(message)


def _still(image: Any, stamp_ns: int, clicks: Sequence[Observation], method: str) -> Still:
    for one in clicks:
        place = round(one.u), round(one.v)
        cv2.drawMarker(image, place, _CLICK_BGR, cv2.MARKER_TILTED_CROSS, _CLICK_PX, 2)
    _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    names = ", ".join(one.id for one in clicks)
    words = (
        f"{names} at {stamp_ns * 1e-9:.3f} s. Orange crosses: where it was clicked. Green "
        f"diamonds: where {method} puts the surveyed points. Yellow, or as its style says: the "
        f"map by {method}"
    )
    return Still(words, jpeg.tobytes())

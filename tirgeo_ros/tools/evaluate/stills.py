"""Draw map and control points on some of a flight's pictures, in the style of overlay_node."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress

import cv2
import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.layers import GeoFeature, LayerStyle, MapLayer
from tirgeo_ros.core.overlay.map_renderer import MapRenderer
from tirgeo_ros.core.overlay.tone_mapping import ToneMapper
from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.core.types.errors import TirgeoError
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.tools.evaluate.ground import Experiment
from tirgeo_ros.tools.evaluate.methods import MethodSetup
from tirgeo_ros.tools.replay.flight_poses import FlightPoses
from tirgeo_ros.tools.replay.flight_topics import PICTURES, resolved

_STILLS = 4  # spread over the flight
_QUALITY = 85
_CLICK_BGR, _CLICK_PX = (0, 140, 255), 13
_CONTROL = LayerStyle(line_bgr=(120, 255, 120), width_px=2)
_CAPTION = (
    "{names} at {time_s:.3f} s. Orange crosses: where it was clicked. Green diamonds: "
    "the surveyed points by {method}. Yellow, or as its style says: the map by {method}"
)


def overlay_stills(
    reader: BagReader,
    namespace: str,
    camera: Camera,
    poses: FlightPoses,
    setup: MethodSetup,
    layers: Sequence[MapLayer],
    given: Experiment,
) -> list[tuple[str, bytes]]:
    """Return captions and JPEG of a method with clicks drawn; empty without pictures."""
    overlay, plane = setup.configs.overlay, poses.plane
    assert plane is not None
    points = [
        GeoFeature(p.id, False, np.array([[p.latitude_rad, p.longitude_rad, p.height_m]]))
        for p in given.control.values()
    ]
    terrain = setup.ground if isinstance(setup.ground, Terrain) else None
    layers = [*layers, MapLayer("control points", points, _CONTROL)]
    drawing = MapRenderer(overlay, layers, terrain)
    drawing.set_plane(plane)
    drawing.set_camera(camera)
    toner = ToneMapper(overlay.picture, overlay.palette)
    stills = []
    for stamp_ns, pixels in _pictures(reader, namespace, _chosen(given)):
        found = poses.at(stamp_ns - setup.latency_ns)
        if found is None or pixels.shape[:2] != (camera.height, camera.width):
            continue
        image = toner.tone(pixels, stamp_ns)
        drawing.draw(image, *found, ())
        clicks = [one for one in given.observations if one.stamp_ns == stamp_ns]
        for one in clicks:
            at = round(one.u), round(one.v)
            cv2.drawMarker(image, at, _CLICK_BGR, cv2.MARKER_TILTED_CROSS, _CLICK_PX, 2)
        _, jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
        names = ", ".join(one.id for one in clicks)
        caption = _CAPTION.format(names=names, time_s=stamp_ns * 1e-9, method=setup.method)
        stills.append((caption, jpeg.tobytes()))
    return stills


def _chosen(given: Experiment) -> set[int]:
    """Return stamps of pictures: from each part of the flight the one with most clicks."""
    clicks = Counter(one.stamp_ns for one in given.observations)
    parts = np.array_split(np.array(sorted(clicks), np.int64), min(_STILLS, len(clicks)))
    return {max(part.tolist(), key=clicks.__getitem__) for part in parts}


def _pictures(
    reader: BagReader, namespace: str, stamps_ns: set[int]
) -> Iterator[tuple[int, RawPixels]]:
    """Yield stamp and pixels of those pictures, as far as the bag has them."""
    names = {resolved(name, namespace): name for name in PICTURES}
    topics = [topic for topic in names if topic in reader.topics()]
    cdr = Cdr()
    for message in reader.messages(topics[:1]) if topics else ():
        with suppress(TirgeoError):  # errors are counted where the flight is read
            stamp_ns = header_stamp_ns(message.data)
            if stamp_ns in stamps_ns:
                decoded = cdr.deserialize(message.data, message.typename)
                yield stamp_ns, convert.pixels(names[message.topic], decoded)

"""Process a recorded flight into its geo-registered flight: the work of ``tirgeo process``.

Messages go through the core objects of the nodes in the order of their log times, faster than real
time. The same input gives the same bytes.
"""

from __future__ import annotations

import contextlib
import math
import os
import time

from tirgeo_ros.core.ground.dem import Terrain
from tirgeo_ros.core.map.draping import Ground
from tirgeo_ros.core.map.layers import MapLayer
from tirgeo_ros.core.overlay.overlay import Overlay
from tirgeo_ros.core.types.errors import BagError, ConfigError
from tirgeo_ros.io.bags.bag import BagReader, BagWriter
from tirgeo_ros.io.elevation.elevation_model import ground_of
from tirgeo_ros.io.files.whole_files import PathLike, check_outputs
from tirgeo_ros.io.maps import load_layers, map_files
from tirgeo_ros.io.parameters.parameter_file import Files, paths_of
from tirgeo_ros.io.pictures.camera_file import given_camera
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.presentation.video import VideoFile
from tirgeo_ros.tools.replay.finding_lines import finding_items
from tirgeo_ros.tools.replay.flight_checks import FlightChecks
from tirgeo_ros.tools.replay.flight_topics import done_without, inputs_of, resolved
from tirgeo_ros.tools.replay.message_pipeline import Pipeline
from tirgeo_ros.tools.replay.node_configs import node_configs


def process(
    bag_in: PathLike,
    bag_out: PathLike,
    *,
    params: Files = None,
    map: PathLike | None = None,  # noqa: A002 the option's name
    method: str | None = None,
    dem: PathLike | None = None,
    ground_height: float | None = None,
    images: bool = True,
    raw_images: bool = False,
    video: PathLike | None = None,
    namespace: str = "",
    camera: PathLike | None = None,
    progress: Report = silent,
) -> dict[str, object]:
    """Process a bag and return a summary.

    ``error`` in the summary is None, or what of the bag was lost; ``warning`` is None, or which
    topics were missing. ``notes`` say what of the map is not drawn, and which method was chosen by
    the bag's topics because none was given. The gimbal is needed for ``images`` only. ``params``
    are ROS 2 parameter files of the nodes; ``map``, ``dem`` or ``ground_height`` (ellipsoidal m)
    and ``camera``, a calibration file, override those in them. ``progress`` is called with seconds
    of the flight. A file gets its name only when it is complete. Raise BagError (no bag, a needed
    topic absent, nothing readable), CameraError, ConfigError, MapError, ElevationError,
    VideoError.
    """
    configs = node_configs(
        params, namespace, method=method, dem=dem, ground_height=ground_height, camera=camera
    )
    map_path = (configs.overlay.map if map is None else os.fspath(map)) if images else ""
    if (raw_images or video is not None) and not map_path:
        raise ConfigError("overlay images need a map and images")
    given = [bag_in, *paths_of(params), *configs.files, *map_files(map_path)]
    check_outputs(given, (bag_out, video), BagError)
    reader = BagReader(bag_in)
    fitted, notes = configs.fitting(reader, namespace)
    ekf, gimbal, overlay, _ = fitted
    known = given_camera(overlay)
    topics = inputs_of(
        reader,
        ekf.method,
        gimbal.composition,
        namespace,
        pictures=bool(map_path),
        camera=known is None,
        gimbal=images,
    )
    layers: list[MapLayer] | None = None
    ground: Ground | None = None
    drawn: Overlay | None = None
    if map_path:
        layers = load_layers(map_path, overlay.style, overlay.label_field, network=overlay.network)
        ground = ground_of(overlay)
        terrain = ground if isinstance(ground, Terrain) else None
        drawn = Overlay(overlay, layers, terrain)
        if known is not None:
            drawn.set_camera(known)
        notes += [
            *(terrain.notes if terrain else ()),
            *(n for one in layers for n in one.left_out),
        ]
    checks = FlightChecks(
        fitted, reader, params, namespace, ground=ground, layers=layers, camera=known
    )
    begun_s = time.perf_counter()
    with contextlib.ExitStack() as stack:
        film = stack.enter_context(VideoFile(video)) if video is not None else None
        writer = stack.enter_context(BagWriter(bag_out))
        run = Pipeline(fitted, drawn, writer, film, namespace, checks, raw_images=raw_images)
        run.through(reader, topics, progress)
        if not run.read:
            because = f": {reader.damage}" if reader.damage else ""
            raise BagError(f"{bag_in}: no message could be read{because}")
    elapsed_s = time.perf_counter() - begun_s
    if not any(name.startswith("gimbal/") for name in topics.values()):
        notes.append("the bag has no gimbal topic: no camera poses")
    absent = [resolved(name, namespace) for name in done_without(topics.values(), ekf.method)]
    warning = (
        f"{reader.path} has no {', '.join(absent)}: continuing without it" if absent else None
    )
    status, composer = run.registration.navigation.status(), run.registration.composer
    error = None
    if reader.damage is not None:
        error = f"{reader.path}: {reader.damage}; the output is made from the rest"
    elif not any(name.endswith("tirgeo/odometry") for name in run.written):
        error = f"{reader.path}: no pose could be made: {status.reason or 'see verdicts'}"
    return {
        "input": os.fspath(bag_in),
        "output": os.fspath(bag_out),
        "warning": warning,
        "findings": finding_items(checks.findings()),  # damage is in the summary's error
        "method": status.method,
        "composition": composer.composition,
        "duration_s": run.duration_s,
        "elapsed_s": elapsed_s,
        "speed": run.duration_s / elapsed_s,
        "read": dict(run.read),
        "undecodable": dict(run.undecoded),
        "unreadable": dict(run.unreadable),
        "unreadable_because": dict(run.unreadable_because),
        "stamped_at_arrival": run.arrivals.counts,
        "written": dict(run.written),
        "state": status.state.value,
        "reason": status.reason,
        "states_s": dict(run.states_s),
        "verdicts": {f"{a} {b}": number for (a, b), number in status.counts.items()},
        "heading_sigma_deg": math.degrees(status.heading_sigma_rad),
        "gimbal": composer.counts,
        "overlay": drawn.counts if drawn is not None else {},
        "notes": [*notes, *(drawn.notes if drawn is not None else ())],
        "video": None if film is None else {"frames": film.frames, "rate_hz": film.rate_hz},
        "error": error,
    }

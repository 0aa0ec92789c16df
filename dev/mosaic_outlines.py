"""How well the outlines of a map lie on the mosaic of a simulated flight.

``python -m dev.mosaic_outlines`` exports the mosaic of the sample flight twice: with the poses of
the filter, and with the true ones of the simulation. A folder of ``tirgeo simulate`` may be given
in its place, whose ``dem.asc`` is used if there is one. The mosaic with the true poses shows what
the measurement itself contributes. An outline's edge is where the picture becomes brighter fastest
along the outline's normal, going outwards: the flower beds of the simulation have a bright kerb
outside their outline. Cold beds have that edge; beds as warm as the kerb have none, and are not
used.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import rasterio

from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.core.gimbal.pose_buffer import PoseBuffer
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.core.types.errors import MapError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.coordinates.crs import Plane
from tirgeo_ros.io.files.whole_files import made_folder
from tirgeo_ros.tools.export.frames import (
    FlightPictures,
    RegisteredFlight,
    Window,
    frames,
    register,
)
from tirgeo_ros.tools.export.rasters import Mosaic, RasterOptions, raster_setup
from tirgeo_ros.tools.presentation.progress import silent
from tirgeo_ros.tools.replay.flight import WHOLE_FLIGHT_S
from tirgeo_ros.tools.replay.node_configs import node_configs

SAMPLE = Path(__file__).resolve().parents[1] / "bags" / "sample"
#: Along an outline: distance between places, and how far they stay from its corners, m.
STEP_M, CORNER_M = 0.25, 0.75
#: Along the normal: how far the edge is looked for to either side, and in which steps, m.
REACH_M, FINE_M = 1.0, 0.02
#: The profile is the mean over this length of the outline, m.
MEAN_M = 0.4
#: A bed is cold if the middle grey level inside, farther than this from the outline, is less than
#: that of bare soil in the simulation: warmer ones are hardly darker than their kerbs.
COLD, INSIDE_M = 118.0, 0.3
#: An edge is clear if the grey level rises by this much over _RISE_M.
CLEAR, _RISE_M = 20.0, 0.2
#: It is ambiguous, and not used, if the profile rises by this share of it farther away than this.
AMBIGUOUS, APART_M = 0.6, 0.4


class Edges(NamedTuple):
    """Hold the distances of edges from the map's outlines, m, outwards positive."""

    offsets_m: Array  # (N,) of the places with a clear edge
    cold: int  # places at the outlines of cold beds
    places: int  # all places on the mosaic

    @property
    def rms_m(self) -> float:
        """Return the root mean square distance."""
        return float(rms(self.offsets_m))


def edges(mosaic: Path, outlines: Path) -> Edges:
    """Measure the outlines of a GeoJSON map's areas on a mosaic of one band and alpha."""
    with rasterio.open(mosaic) as source:
        grey = source.read(1).astype(np.float32)
        covered = source.read(2) > 0
        transform, plane = source.transform, Plane(source.crs.to_string(), np.zeros((1, 2)))
    grey[~covered] = np.nan
    by_ring, places, across = [], 0, _across_m()
    for ring in _rings(json.loads(outlines.read_text())):
        middles, normals, alongs = _places(plane.metres(ring))
        if not len(middles):
            continue
        profiles = _profiles(grey, ~transform, middles, normals, alongs)
        profiles = profiles[np.isfinite(profiles).all(axis=1)]
        places += len(profiles)
        if len(profiles) and np.median(profiles[:, across < -INSIDE_M]) < COLD:
            by_ring.append(edge_m(profiles))
    offsets = np.concatenate(by_ring)
    return Edges(offsets[np.isfinite(offsets)], len(offsets), places)


def _rings(collection: Any) -> Iterator[Array]:
    """Yield the closed outer rings (N, 2) of polygons, longitude and latitude, deg."""
    for feature in collection["features"]:
        if feature["geometry"]["type"] == "Polygon":
            yield np.array(feature["geometry"]["coordinates"][0])[:, :2]


def _places(ring: Array) -> tuple[Array, Array, Array]:
    """Return places along a counterclockwise ring (N, 2), m, normals outwards, directions."""
    middles, normals, alongs = [], [], []
    for begin, end in itertools.pairwise(ring):
        length = float(np.linalg.norm(end - begin))
        along = (end - begin) / length
        for way in np.arange(CORNER_M, length - CORNER_M, STEP_M):
            middles.append(begin + way * along)
            normals.append([along[1], -along[0]])
            alongs.append(along)
    return np.array(middles), np.array(normals), np.array(alongs)


def _across_m() -> Array:
    """Return the places (K,) of a profile, m along the outline's normal."""
    return np.arange(-REACH_M, REACH_M + FINE_M / 2, FINE_M)


def _profiles(grey: Any, to_pixel: Any, middles: Array, normals: Array, alongs: Array) -> Array:
    """Return grey levels (N, K) along the normals, from -REACH_M to REACH_M."""
    across = _across_m()
    aside = np.linspace(-MEAN_M / 2, MEAN_M / 2, 9)
    places = (
        middles[:, None, None]
        + across[:, None, None] * normals[:, None, None]
        + aside[:, None] * alongs[:, None, None]
    )
    a, b, c, d, e, f = tuple(to_pixel)[:6]
    x, y = places[..., 0], places[..., 1]
    columns, rows = (a * x + b * y + c - 0.5), (d * x + e * y + f - 0.5)
    shape = len(middles), -1
    columns, rows = (one.reshape(shape).astype(np.float32) for one in (columns, rows))
    values = cv2.remap(grey, columns, rows, cv2.INTER_LINEAR, None, cv2.BORDER_CONSTANT, (np.nan,))
    return np.asarray(values.reshape(places.shape[:3]).mean(axis=2))


def edge_m(profiles: Array) -> Array:
    """Return where profiles (N, K) rise fastest, m from their middle; nan if not clearly."""
    half = round(_RISE_M / 2 / FINE_M)
    rise = profiles[:, 2 * half :] - profiles[:, : -2 * half]
    across = _across_m()[half:-half]
    best, most = rise.argmax(axis=1), rise.max(axis=1)
    elsewhere = np.abs(across - across[best][:, None]) > APART_M
    second = np.where(elsewhere, rise, 0.0).max(axis=1)
    inside = (best > 0) & (best < rise.shape[1] - 1)
    clear = inside & (most >= CLEAR) & (second < AMBIGUOUS * most)
    return np.where(clear, across[best], np.nan)


def true_flight(flight: RegisteredFlight, truth: Path) -> RegisteredFlight:
    """Return a flight with the camera's true poses in place of the filter's."""
    cdr = Cdr()
    cameras: PoseBuffer[CameraPose] = PoseBuffer(WHOLE_FLIGHT_S)
    for item in BagReader(truth).messages(["/tirgeo/camera_pose"]):
        cameras.add(convert.camera_pose(cdr.deserialize(item.data, item.typename)))
    posed = {}
    for number, one in flight.posed.items():
        pose = cameras.at(one.pose.stamp_ns)
        assert isinstance(pose, CameraPose)
        posed[number] = one._replace(pose=pose)
    return flight._replace(posed=posed)


def mosaics(flown: Path, folder: Path, every_s: float = 1.0) -> dict[str, Path]:
    """Make a flight's mosaic in a folder with the filter's poses and with the true ones."""
    reader, params = BagReader(flown / "flight.mcap"), [flown / "params.yaml"]
    dem = flown / "dem.asc"
    configs = node_configs(params, dem=dem if dem.exists() else None)
    pictures = FlightPictures(reader, "")
    chosen = pictures.chosen(Window(every_s=every_s))
    flight = register(reader, configs, params, "", chosen, silent)
    made = {}
    flights = {"filter": flight, "truth": true_flight(flight, flown / "truth.mcap")}
    for name, one in flights.items():
        assert one.ground is not None
        poses = [posed.pose for posed in one.posed.values()]
        setup = raster_setup(RasterOptions(), one.camera, poses, one.plane, one.ground)
        mosaic = Mosaic(made_folder(folder / name, MapError), setup)
        for frame in frames(pictures, one, silent):
            mosaic.take(frame)
        mosaic.finish()
        made[name] = folder / name / "mosaic.tif"
    return made


def main() -> int:
    """Print a line for each of the two mosaics."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("flight", type=Path, nargs="?", default=SAMPLE, help="folder of a flight")
    parser.add_argument("--every", type=float, default=1.0, help="seconds between pictures")
    args = parser.parse_args()
    sys.stdout.write("poses   places  of cold beds  clear  mean m  rms m  within 0.25 m\n")
    with tempfile.TemporaryDirectory() as folder:
        for name, mosaic in mosaics(args.flight, Path(folder), args.every).items():
            measured = edges(mosaic, args.flight / "map.geojson")
            offsets = measured.offsets_m
            near = float(np.mean(np.abs(offsets) < 0.25))
            sys.stdout.write(
                f"{name:<7} {measured.places:>6}  {measured.cold:>12}  {len(offsets):>5}  "
                f"{offsets.mean():>6.3f}  {measured.rms_m:>5.3f}  {near:.1%}\n"
            )
    return 0


if __name__ == "__main__":
    sys.exit(main())

"""A map drawn into a picture, given the camera and its pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.clicks import Marker
from tirgeo_ros.core.confidence import CameraRates
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.decorations import (
    PlacedBar,
    PlacedRose,
    camera_heading_rad,
    ground_sample_m,
    place_rose,
    place_scale_bar,
)
from tirgeo_ros.core.draping import Ground, check_heights
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_layers import MapLayer
from tirgeo_ros.core.map_painting import MapPainter
from tirgeo_ros.core.marker_painting import PlacedMarkers
from tirgeo_ros.core.painting import status_box
from tirgeo_ros.core.samples import CameraPose
from tirgeo_ros.core.strokes import Painter
from tirgeo_ros.core.terrain import Terrain
from tirgeo_ros.core.text import Pixels
from tirgeo_ros.core.vector_map import VectorMap
from tirgeo_ros.core.view import View


@dataclass(frozen=True, slots=True)
class LaidMap:
    """Layers, and the map that they make in a plane; None where no plane is known yet."""

    layers: Sequence[MapLayer]
    plane: TangentPlane | None
    map: VectorMap | None


def lay_layers(layers: Sequence[MapLayer], plane: TangentPlane | None, ground: Ground) -> LaidMap:
    """Lay layers into a plane: the slow part of a change. Raises ConfigError as VectorMap."""
    check_heights(layers, ground)
    laid = None if plane is None else VectorMap.from_layers(layers, plane, ground)
    return LaidMap(layers, plane, laid)


class MapDrawing:
    """Layers of a map, laid into a plane, as a camera sees them.

    The map lies at ``ground_height_m`` where that is given, else on the terrain where there is
    one, else at its own heights. Raises ConfigError if these are unknown.
    """

    def __init__(
        self, config: OverlayConfig, layers: Sequence[MapLayer], terrain: Terrain | None
    ) -> None:
        self.view: View | None = None
        self.map: VectorMap | None = None
        self.ground = _ground(config.ground_height_m, terrain)
        check_heights(layers, self.ground)
        self._layers = layers
        self._level = self.ground
        self._plane: TangentPlane | None = None
        self._confidence = config.confidence
        self._painter = Painter()
        self._map_painting: MapPainter | None = None  # of the map, once it is drawn

    @property
    def empty(self) -> bool:
        """Whether there is nothing that could be drawn."""
        return not any(layer.features for layer in self._layers)

    @property
    def camera(self) -> Camera | None:
        """The camera of the picture that is drawn into."""
        return self.view.camera if self.view else None

    def laid(self, layers: Sequence[MapLayer]) -> LaidMap:
        """Another map, laid in the present plane. Raises ConfigError if heights are unknown."""
        return lay_layers(layers, self._plane, self.ground)

    def set_map(self, new: LaidMap) -> None:
        """Draw another map from here on."""
        self._layers = new.layers
        self._set(new.map)
        if new.plane != self._plane:  # it has moved since
            self._lay()

    def set_plane(self, plane: TangentPlane) -> None:
        """The plane in which poses are given."""
        self._plane = plane
        self._lay()

    def set_camera(self, camera: Camera) -> None:
        """The camera of the picture that is drawn into."""
        if self.view is None or camera != self.view.camera:
            self.view = View(camera)

    def _lay(self) -> None:
        if self._plane is not None:
            self._set(VectorMap.from_layers(self._layers, self._plane, self.ground))

    def _set(self, vector_map: VectorMap | None) -> None:
        self.map, self._map_painting = vector_map, None
        self._level = _level(self.ground, self._layers)

    def draw(
        self,
        image: Pixels,
        pose: CameraPose,
        rates: CameraRates | None = None,
        markers: Sequence[Marker] = (),
    ) -> None:
        """Draw map and markers into (h, w, 3) BGR; there must be a camera and a plane.

        ``rates`` are the camera's at the pose, None where they are not known.
        """
        assert self.view is not None
        assert self._plane is not None
        camera = self.view.camera
        seen = camera, pose, self._plane, self._level
        placed = PlacedMarkers(image, camera, pose, markers) if markers else None
        decorations = self._decorations(image, seen)
        taken = [status_box(image), *(decoration.box for decoration in decorations)]
        if placed:
            taken += placed.boxes
        painter = self._map_painter()
        scale_m_px = ground_sample_m(*seen) if painter.minds_scale else math.nan
        painter.paint(image, self.view, pose, rates, scale_m_px, taken)
        if placed:
            placed.paint(image, self._painter)
        for decoration in decorations:
            decoration.paint(image)

    def _decorations(
        self, image: Pixels, seen: tuple[Camera, CameraPose, TangentPlane, Ground]
    ) -> list[PlacedBar | PlacedRose]:
        bar = place_scale_bar(image, *seen) if self._confidence.scale_bar else None
        rose = None
        if self._confidence.heading_rose:
            rose = place_rose(image, camera_heading_rad(seen[1]))
        return [decoration for decoration in (bar, rose) if decoration]

    def _map_painter(self) -> MapPainter:
        assert self.map is not None
        if self._map_painting is None:
            self._map_painting = MapPainter(self._confidence, self.map, self._painter)
        return self._map_painting


def _ground(height_m: float, terrain: Terrain | None) -> Ground:
    if math.isfinite(height_m) or terrain is None:
        return height_m
    return terrain


def _level(ground: Ground, layers: Sequence[MapLayer]) -> Ground:
    """The ground, and for a map at its own heights the middle one of these."""
    if isinstance(ground, Terrain) or math.isfinite(ground):
        return ground
    heights = [feature.points[:, 2] for layer in layers for feature in layer.features]
    return float(np.median(np.concatenate(heights))) if heights else math.nan

"""A map drawn into a picture, given the camera and its pose."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.draping import Ground, check_heights
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_layers import MapLayer
from tirgeo_ros.core.painting import paint_labels, paint_lines
from tirgeo_ros.core.polylines import Polylines, joined
from tirgeo_ros.core.samples import CameraPose
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
        self._plane: TangentPlane | None = None

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
        self._layers, self.map = new.layers, new.map
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
            self.map = VectorMap.from_layers(self._layers, self._plane, self.ground)

    def draw(self, image: Pixels, pose: CameraPose) -> None:
        """Draw the map into (h, w, 3) BGR; there must be a camera and a plane."""
        assert self.view is not None
        assert self.map is not None
        lines = self.view.lines(self.map, pose)
        marks = self.view.marks(self.map, pose)
        paint_lines(image, lines, marks)
        self._label(image, joined(lines, marks), self.view, self.map)

    @staticmethod
    def _label(image: Pixels, lines: Polylines, view: View, vector_map: VectorMap) -> None:
        named = lines.select(np.flatnonzero(vector_map.labelled[lines.owner]))
        inside = view.inside(named.points)
        features, owner = np.unique(named.owner, return_inverse=True)
        owner = np.repeat(owner, np.diff(named.starts))[inside]
        labels = [vector_map.labels[feature] for feature in features]
        paint_labels(image, named.points.T[inside], owner, labels)


def _ground(height_m: float, terrain: Terrain | None) -> Ground:
    if math.isfinite(height_m) or terrain is None:
        return height_m
    return terrain

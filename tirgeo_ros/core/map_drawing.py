"""A map drawn into a picture, given the camera and its pose."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.camera import Camera
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.geodesy import TangentPlane
from tirgeo_ros.core.map_layers import GeoFeature, MapLayer
from tirgeo_ros.core.painting import paint_labels, paint_lines
from tirgeo_ros.core.polylines import Polylines, joined
from tirgeo_ros.core.samples import CameraPose
from tirgeo_ros.core.text import Pixels
from tirgeo_ros.core.vector_map import VectorMap, grounded
from tirgeo_ros.core.view import View


class MapDrawing:
    """Layers of a map, laid into a plane, as a camera sees them.

    Raises ConfigError if heights of the layers are unknown.
    """

    def __init__(self, config: OverlayConfig, layers: Sequence[MapLayer]) -> None:
        self.view: View | None = None
        self.map: VectorMap | None = None
        self._height_m = config.ground_height_m
        self._features = self._grounded(layers)
        self._plane: TangentPlane | None = None

    @property
    def empty(self) -> bool:
        """Whether there is nothing that could be drawn."""
        return not self._features

    def set_layers(self, layers: Sequence[MapLayer]) -> None:
        """Another map; the present one stays if this one raises ConfigError."""
        self._features = self._grounded(layers)
        self._lay()

    def set_plane(self, plane: TangentPlane) -> None:
        """The plane in which poses are given."""
        self._plane = plane
        self._lay()

    def set_camera(self, camera: Camera) -> None:
        """The camera of the picture that is drawn into."""
        if self.view is None or camera != self.view.camera:
            self.view = View(camera)

    def _grounded(self, layers: Sequence[MapLayer]) -> list[GeoFeature]:
        features = [feature for layer in layers for feature in layer.features]
        return grounded(features, self._height_m)

    def _lay(self) -> None:
        if self._plane is not None:
            self.map = VectorMap.from_geodetic(self._features, self._plane)

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

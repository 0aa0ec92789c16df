"""Draw the points that were located by a click at their present place in the picture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.camera.projection_covariance import ellipse_95, pixel_jacobian
from tirgeo_ros.core.frames.rotations import matrix_from_quat
from tirgeo_ros.core.map.layers import LayerStyle
from tirgeo_ros.core.map.polylines import Polylines
from tirgeo_ros.core.overlay.clicks import Marker
from tirgeo_ros.core.overlay.label_placement import FreeSpace, wish_beside
from tirgeo_ros.core.overlay.line_renderer import LineRenderer, mark_radius_px, marks_as_lines
from tirgeo_ros.core.overlay.text_rendering import Box, Colour, TextBitmap, stamp, text_px
from tirgeo_ros.core.overlay.uncertainty_rendering import ELLIPSE_BGR, MARK_TIMES, ellipse_dashes
from tirgeo_ros.core.types.arrays import Array, BoolArray, Pixels
from tirgeo_ros.core.types.poses import CameraPose

_MARKER_BGR: Colour = (255, 80, 255)
_STYLE = LayerStyle(line_bgr=_MARKER_BGR, width_px=2)
_LARGEST_PX = 2000.0  # semi-axis of an ellipse larger than any picture


class PlacedMarkers:
    """Hold the markers that are in a picture (h, w, 3), with the boxes of their labels, ``boxes``.

    Each marker has the 95 % confidence ellipse of the located ground point, drawn where it is
    clearly larger than the mark. Labels do not overlap the boxes in ``taken`` or each other. The
    newest marker's label is placed first; a label without room is left out.
    """

    def __init__(
        self,
        image: Pixels,
        camera: Camera,
        pose: CameraPose,
        markers: Sequence[Marker],
        taken: Sequence[Box] = (),
    ) -> None:
        points_n = np.array([marker.point_n for marker in markers]).reshape(-1, 3)
        uv, seen = _in_picture(camera, pose, points_n)
        self._uv = uv[seen]
        shown = [markers[i] for i in np.flatnonzero(seen).tolist()]
        _, by_point = pixel_jacobian(camera, pose, points_n[seen])
        covariance_n = np.array([marker.covariance_n for marker in shown]).reshape(-1, 3, 3)
        self._covariance = by_point @ covariance_n @ by_point.transpose(0, 2, 1)
        room, mark_px = FreeSpace(image, self._uv.T, taken), 1.5 * mark_radius_px(image)
        self._labels: list[tuple[TextBitmap, Box]] = []
        for marker, (u, v) in zip(shown[::-1], self._uv[::-1].tolist(), strict=True):
            text = stamp(marker.label, text_px(image), _MARKER_BGR)
            found = room.find(wish_beside(u, v, text.size, mark_px))
            if found is not None:
                self._labels.append((text, found[1]))
        self.boxes = [box for _, box in self._labels]

    def paint(self, image: Pixels, painter: LineRenderer) -> None:
        """Draw marks, ellipses and labels on the picture, in place."""
        if not len(self._uv):
            return
        count = len(self._uv)
        marks = Polylines(self._uv.T, np.arange(count + 1), np.zeros(count, np.int64))
        diamonds = marks_as_lines(marks, mark_radius_px(image))
        dashes = _ellipses(self._uv, self._covariance, mark_radius_px(image))
        painter.thin_strokes(image, dashes, ELLIPSE_BGR)
        painter.strokes(image, diamonds, np.zeros(count, np.int64), [_STYLE])
        for text, box in self._labels:
            text.lay(image, box.left, box.top)


def _in_picture(camera: Camera, pose: CameraPose, points_n: Array) -> tuple[Array, BoolArray]:
    uv, valid = camera.project((points_n - pose.position_n) @ matrix_from_quat(pose.q_nc))
    with np.errstate(invalid="ignore"):
        inside = (uv >= -0.5) & (uv < [camera.width - 0.5, camera.height - 0.5])
    return uv, np.asarray(valid & inside.all(axis=1))


def _ellipses(uv: Array, covariance: Array, mark_px: float) -> Polylines:
    """Return the dashed ellipses of the points whose ellipse is clearly larger than the mark."""
    semi_px, angle = ellipse_95(covariance)
    drawn = np.flatnonzero(semi_px[:, 0] >= MARK_TIMES * mark_px)  # nan compares false
    semi_px = np.minimum(semi_px[drawn], _LARGEST_PX)
    dotted = np.zeros(len(drawn), bool)
    return ellipse_dashes(uv[drawn].T, semi_px, angle[drawn], drawn, dotted)

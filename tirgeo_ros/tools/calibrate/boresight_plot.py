"""Plot the residuals of a boresight calibration over the picture, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.boresight.fit import BoresightFit
from tirgeo_ros.core.calibration.boresight.model import PointSighting
from tirgeo_ros.core.camera.camera_model import Camera
from tirgeo_ros.core.types.arrays import Array, BoolArray
from tirgeo_ros.tools.presentation.plots import COLOURS, arrows, figure, png

#: Length of a panel's longest arrow, px of the picture.
_LONGEST_PX = 60.0


def residual_plot(
    camera: Camera, sightings: Sequence[PointSighting], found: BoresightFit
) -> bytes:
    """Return a PNG: an arrow from each observation to its point's expected pixel, outliers too."""
    uv = np.array([one.uv for one in sightings])
    made, axes = figure(10.0, 5.2, 1, 2, sharex=True, sharey=True)
    for panel, title, residuals in zip(
        axes, ("before", "after"), (found.before, found.after), strict=True
    ):
        _panel(panel, uv, residuals, found.used)
        lengths = np.hypot(*residuals[found.used].T)
        rms = float(np.sqrt(np.nanmean(lengths**2)))
        panel.set_title(f"{title}: {rms:.2f} px rms")
        panel.set_xlabel("column, px")
    axes[0].set(xlim=(0, camera.width), ylim=(camera.height, 0), ylabel="row, px", aspect="equal")
    axes[1].set_aspect("equal")
    axes[1].legend(loc="upper left", bbox_to_anchor=(0.0, -0.12), ncols=2)  # under the picture
    return png(made)


def _panel(panel: Any, uv: Array, residuals: Array, used: BoolArray) -> None:
    longest = float(np.nanmax(np.hypot(*residuals[used].T), initial=1e-3))
    times = _LONGEST_PX / longest
    for part, colour, what in ((used, COLOURS[0], "used"), (~used, COLOURS[1], "left out")):
        shown = part & np.isfinite(residuals[:, 0])
        if not shown.any():
            continue
        # An outlier may be hundreds of pixels off: its arrow is cut.
        lengths = np.hypot(*residuals[shown].T)
        cut = np.minimum(1.0, longest / np.maximum(lengths, 1e-9))[:, None]
        panel.plot(*uv[shown].T, ".", color=colour, markersize=4, label=what)
        arrows(panel, uv[shown], -residuals[shown] * times * cut, colour, 0.003)
    panel.text(0.01, 0.03, f"longest arrow {longest:.1f} px", transform=panel.transAxes)

"""Plot the innovations of a flight before and after the calibration of the aircraft."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from tirgeo_ros.core.aircraft_calibration.filter_run import FilterRun
from tirgeo_ros.core.aircraft_calibration.fit import AircraftFit
from tirgeo_ros.core.frames.rotations import euler_from_quat
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png

_FAR = 15.0
_PANELS = {
    Source.RTK_POSITION: ("rtk/fix", 100.0, "cm"),
    Source.RTK_VELOCITY: ("rtk/vel", 100.0, "cm/s"),
    Source.RTK_HEADING: ("rtk/heading", float(np.degrees(1.0)), "deg"),
}


def innovation_plot(found: AircraftFit) -> bytes:
    """Return a PNG: innovations over time by source, and those of headings over the azimuth.

    A vertical axis is logarithmic beyond three times the remaining rms, if some innovations are
    far outside.
    """
    sources = [source for source in _PANELS if source in found.after.nis()]
    by_azimuth = Source.RTK_HEADING in sources
    made, axes = figure(10.0, 2.3 * (len(sources) + by_azimuth), len(sources) + by_azimuth, 1)
    panels, start_ns = np.atleast_1d(axes), found.before.attitude_ns[0]
    for panel, source in zip(panels, sources, strict=False):
        name, _, unit = _PANELS[source]
        _scatter(panel, found, source, lambda _, stamps_ns: (stamps_ns - start_ns) * 1e-9)
        before, after = found.before.nis()[source], found.after.nis()[source]
        panel.set_title(f"{name}: NIS {before:.3g} before, {after:.2f} after", loc="left")
        panel.set_ylabel(f"innovation, {unit}")
    panels[len(sources) - 1].set_xlabel("time, s")
    if by_azimuth:
        _scatter(panels[-1], found, Source.RTK_HEADING, _heading_deg)
        panels[-1].set(xlim=(0, 360), xlabel="heading of the nose, deg", ylabel="innovation, deg")
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, markerscale=4)
    return png(made)


def _scatter(
    panel: Any, found: AircraftFit, source: Source, place: Callable[[FilterRun, IntArray], Any]
) -> None:
    """Draw a source's innovations of both runs at the places (n,) of their stamps (n,)."""
    scale, usual = _PANELS[source][1], 0.0
    for run, colour, what in (
        (found.before, COLOURS[1], "before"),
        (found.after, COLOURS[0], "after"),
    ):
        white = [one for one in run.white if one.source is source]
        stamps_ns = np.array([one.stamp_ns for one in white])
        innovations = scale * np.array([one.innovation for one in white])
        usual = float(np.sqrt(np.mean(innovations**2)))
        spread = np.repeat(place(run, stamps_ns), innovations.shape[1])
        panel.plot(spread, innovations.ravel(), ".", color=colour, markersize=1.5, label=what)
    if max(map(abs, panel.get_ylim())) > _FAR * usual:
        panel.set_yscale("symlog", linthresh=3 * usual)


def _heading_deg(run: FilterRun, stamps_ns: IntArray) -> Array:
    """Return the headings (n,) at stamps (n,)."""
    yaw = np.unwrap(euler_from_quat(run.attitude_q_nb)[:, 2])
    at_ns, first_ns = np.array(run.attitude_ns), run.attitude_ns[0]
    return np.degrees(np.interp(stamps_ns - first_ns, at_ns - first_ns, yaw)) % 360

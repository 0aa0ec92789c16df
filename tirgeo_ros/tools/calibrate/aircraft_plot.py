"""Plot the innovations of a flight before and after the calibration of the aircraft."""

from __future__ import annotations

from typing import Any

import numpy as np

from tirgeo_ros.core.aircraft_calibration.filter_run import FilterRun
from tirgeo_ros.core.aircraft_calibration.fit import AircraftFit
from tirgeo_ros.core.frames.rotations import euler_from_quat
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
    panels = np.atleast_1d(axes)
    for panel, source in zip(panels, sources, strict=False):
        _panel(panel, found, source)
    panels[len(sources) - 1].set_xlabel("time, s")
    if by_azimuth:
        _over_azimuth(panels[-1], found)
    panels[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, markerscale=4)
    return png(made)


def _panel(panel: Any, found: AircraftFit, source: Source) -> None:
    name, scale, unit = _PANELS[source]
    start_ns = found.before.attitude_ns[0]
    usual = 0.0
    for run, colour, what in _runs(found):
        white = [one for one in run.white if one.source is source]
        times_s = np.array([(one.stamp_ns - start_ns) * 1e-9 for one in white])
        innovations = scale * np.array([one.innovation for one in white])
        usual = float(np.sqrt(np.mean(innovations**2)))
        spread = np.repeat(times_s, innovations.shape[1])
        panel.plot(spread, innovations.ravel(), ".", color=colour, markersize=1.5, label=what)
    _zoom(panel, usual)
    nis = [run.nis()[source] for run, _, _ in _runs(found)]
    panel.set_title(f"{name}: NIS {nis[0]:.3g} before, {nis[1]:.2f} after", loc="left")
    panel.set_ylabel(f"innovation, {unit}")


def _zoom(panel: Any, usual: float) -> None:
    """Make the axis logarithmic beyond 3 ``usual``, if anything exceeds 15 ``usual``."""
    if max(map(abs, panel.get_ylim())) > _FAR * usual:
        panel.set_yscale("symlog", linthresh=3 * usual)


def _over_azimuth(panel: Any, found: AircraftFit) -> None:
    usual = 0.0
    for run, colour, _ in _runs(found):
        white = [one for one in run.white if one.source is Source.RTK_HEADING]
        yaw = np.unwrap(euler_from_quat(run.attitude_q_nb)[:, 2])
        first = run.attitude_ns[0]
        stamps = np.array([one.stamp_ns - first for one in white], float)
        here = np.interp(stamps, np.array(run.attitude_ns) - first, yaw)
        off = np.degrees([one.innovation[0] for one in white])
        usual = float(np.sqrt(np.mean(off**2)))
        panel.plot(np.degrees(here) % 360, off, ".", color=colour, markersize=1.5)
    _zoom(panel, usual)
    panel.set(xlim=(0, 360), xlabel="heading of the nose, deg", ylabel="innovation, deg")


def _runs(found: AircraftFit) -> tuple[tuple[FilterRun, str, str], ...]:
    return (found.before, COLOURS[1], "before"), (found.after, COLOURS[0], "after")

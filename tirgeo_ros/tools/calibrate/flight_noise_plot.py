"""Plot the noise spectrum of each axis of an IMU in flight, with the densities read from it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.allan.flight_noise import MOTION_HZ, Pieces
from tirgeo_ros.tools.calibrate.flight_noise_table import DENSITIES, HIGH, LOW
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png

_TITLES = {"gyro": "Gyroscope", "accel": "Accelerometer"}
_LINES = 3  # marked on each axis, at most


def spectra_png(
    flying: Pieces, resting: Pieces, axes: Sequence[Mapping[str, Any]], what: str
) -> bytes:
    """Return a PNG: density over frequency, its spread over the flight, found densities."""
    made, panels = figure(12.0, 7.2, 2, 3, sharex=True, sharey="row")
    made.suptitle(what)
    for channel, (panel, axis) in enumerate(zip(panels.flat, axes, strict=True)):
        sensor, letter = axis["axis"].split()
        panel.set_title(f"{_TITLES[sensor]} {letter}")
        _draw(panel, flying, resting, axis, channel)
        if channel % 3 == 0:
            panel.set_ylabel(f"density [{DENSITIES[sensor]}]")
        if channel >= 3:
            panel.set_xlabel("frequency [Hz]")
    named = {
        label: handle
        for panel in panels.flat
        for handle, label in zip(*panel.get_legend_handles_labels(), strict=True)
    }
    # Below the panels; Matplotlib 3.6 does not know 'outside lower center'.
    made.supxlabel(" ", fontsize=12)
    made.legend(named.values(), named.keys(), loc="lower center", ncols=8, fontsize=8)
    return png(made)


def _draw(
    panel: Any, flying: Pieces, resting: Pieces, axis: Mapping[str, Any], channel: int
) -> None:
    # Without the mean, which was subtracted, and the last, which is half a bin.
    shown = slice(1, -1)
    hz = flying.frequencies_hz[shown]
    low, median, high = np.percentile(flying.spectra[:, shown, channel], (LOW, 50, HIGH), axis=0)
    panel.axvspan(0, MOTION_HZ, color="#eeeeee", lw=0, label="motion: not looked at")
    panel.fill_between(hz, low, high, color=COLOURS[0], alpha=0.25, lw=0, label="10 to 90 %")
    panel.semilogy(hz, median, color=COLOURS[0], lw=1.0, label="in flight")
    if len(resting.starts_s):
        still = np.median(resting.spectra[:, shown, channel], axis=0)
        panel.semilogy(hz, still, color="#999999", lw=1.0, label="at rest")
    for name, style, colour, label in (
        ("second_difference", ":", COLOURS[4], "second differences"),
        ("written", "-", COLOURS[1], "written"),
        ("configured", "--", COLOURS[6], "configured"),
    ):
        panel.axhline(axis[name], ls=style, color=colour, lw=1.4, label=label)
    panel.set_xlim(0, float(flying.frequencies_hz[-1]))
    for line in axis["lines"][:_LINES]:
        at = int(np.argmin(np.abs(hz - line["frequency_hz"])))
        place = line["frequency_hz"], 1.25 * high[at]
        panel.plot(*place, "v", color=COLOURS[2], ms=5, label="strongest lines")

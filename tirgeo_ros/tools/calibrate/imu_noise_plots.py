"""Plot the noise of each axis of an IMU: Allan deviation at rest, spectrum in flight."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.allan import (
    FLICKER_FLOOR,
    AllanCurve,
    NoiseFit,
    deviation_band,
)
from tirgeo_ros.core.calibration.flight_noise import MOTION_HZ, Pieces
from tirgeo_ros.io.files.whole_files import csv_text
from tirgeo_ros.tools.calibrate.imu_noise_result import DENSITIES, HIGH, LOW
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS, UNITS
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png

_TITLES = {"gyro": "Gyroscope", "accel": "Accelerometer"}
_LINES = 3  # marked on each axis, at most


def allan_png(curve: AllanCurve, fits: Sequence[NoiseFit]) -> bytes:
    """Return a PNG: deviations with 95 % bands, fit, its asymptotes and the filter's model."""
    made, panels = _panels("Allan deviation", UNITS, "averaging time [s]")
    for panel, fit in zip(panels.flat, fits, strict=True):
        _draw_deviation(panel, curve, fit)
    for row, three in zip(panels, (fits[:3], fits[3:]), strict=True):
        measured = np.sqrt(np.concatenate([fit.variances for fit in three]))
        row[0].set_ylim(0.5 * measured.min(), 2 * measured.max())
    panels.flat[0].legend(loc="upper right", fontsize=8)
    return png(made)


def spectra_png(
    flying: Pieces, resting: Pieces, axes: Sequence[Mapping[str, Any]], what: str
) -> bytes:
    """Return a PNG: density over frequency, its spread over the flight, found densities."""
    made, panels = _panels("density", DENSITIES, "frequency [Hz]")
    made.suptitle(what)
    for channel, (panel, axis) in enumerate(zip(panels.flat, axes, strict=True)):
        _draw_spectrum(panel, flying, resting, axis, channel)
    # Below the panels; Matplotlib 3.6 does not know 'outside lower center'.
    made.supxlabel(" ", fontsize=12)
    handles, labels = panels.flat[0].get_legend_handles_labels()
    made.legend(handles, labels, loc="lower center", ncols=8, fontsize=8)
    return png(made)


def _panels(what: str, units: Mapping[str, str], below: str) -> tuple[Any, Any]:
    """Return a figure and (2, 3) panels, one for each axis."""
    made, panels = figure(12.0, 7.2, 2, 3, sharex=True, sharey="row")
    for panel, name in zip(panels.flat, CHANNELS, strict=True):
        sensor, letter = name.split()
        panel.set_title(f"{_TITLES[sensor]} {letter}")
    for row, unit in zip(panels, units.values(), strict=True):
        row[0].set_ylabel(f"{what} [{unit}]")
    for panel in panels[1]:
        panel.set_xlabel(below)
    return made, panels


def _draw_deviation(axis: Any, curve: AllanCurve, fit: NoiseFit) -> None:
    tau_s = curve.tau_s
    low, high = deviation_band(curve, fit.variances)
    axis.fill_between(tau_s, low, high, color=COLOURS[0], alpha=0.25, lw=0, label="95 %")
    axis.loglog(tau_s, np.sqrt(fit.variances), ".", color=COLOURS[0], ms=4, label="measured")
    axis.loglog(tau_s, np.sqrt(fit.model), color=COLOURS[6], lw=1.0, label="N, B, K fitted")
    axis.loglog(
        tau_s, np.sqrt(fit.bias_model), "--", color=COLOURS[1], label="model of the filter"
    )
    for name, term, shape, at in (
        ("N", fit.white, tau_s**-0.5, len(tau_s) // 4),
        ("B", fit.flicker, np.full(len(tau_s), FLICKER_FLOOR), 1),
        ("K", fit.walk, np.sqrt(tau_s / 3), len(tau_s) - 2),
    ):
        if term.value is not None:
            line = term.value * shape
            axis.loglog(tau_s, line, ":", color="#777777", lw=1.0)
            place = tau_s[at], line[at]
            axis.annotate(name, place, textcoords="offset points", xytext=(0, 4))
    axis.plot(fit.minimum_at_s, fit.minimum, "v", color=COLOURS[2], ms=6, label="minimum")


def _draw_spectrum(
    panel: Any, flying: Pieces, resting: Pieces, axis: Mapping[str, Any], channel: int
) -> None:
    # Without the mean, which was subtracted, and the last, which is half a bin.
    shown = slice(1, -1)
    hz = flying.frequencies_hz[shown]
    low, median, high = np.percentile(flying.spectra[:, shown, channel], (LOW, 50, HIGH), axis=0)
    panel.axvspan(0, MOTION_HZ, color="#eeeeee", lw=0, label="motion: not looked at")
    panel.fill_between(hz, low, high, color=COLOURS[0], alpha=0.25, lw=0, label="10 to 90 %")
    panel.semilogy(hz, median, color=COLOURS[0], lw=1.0, label="in flight")
    if len(resting.floors):
        still = np.median(resting.spectra[:, shown, channel], axis=0)
        panel.semilogy(hz, still, color="#999999", lw=1.0, label="at rest")
    for name, style, colour, label in (
        ("second_difference", ":", COLOURS[4], "second differences"),
        ("written", "-", COLOURS[1], "written"),
        ("configured", "--", COLOURS[6], "configured"),
    ):
        panel.axhline(axis[name], ls=style, color=colour, lw=1.4, label=label)
    panel.set_xlim(0, float(flying.frequencies_hz[-1]))
    lines_hz = [line["frequency_hz"] for line in axis["lines"][:_LINES]]
    heights = 1.25 * np.interp(lines_hz, hz, high)
    panel.plot(lines_hz, heights, "v", color=COLOURS[2], ms=5, label="strongest lines")


def curves_csv(curve: AllanCurve, fits: Sequence[NoiseFit]) -> str:
    """Return CSV, a line per averaging time: of each axis deviation, band, fit."""
    columns: list[Any] = [curve.tau_s]
    header = ["tau_s"]
    for name, fit in zip(CHANNELS, fits, strict=True):
        low, high = deviation_band(curve, fit.variances)
        columns += [np.sqrt(fit.variances), low, high, np.sqrt(fit.model)]
        stem = name.replace(" ", "_")
        header += [f"{stem}_{part}" for part in ("deviation", "low", "high", "fit")]
    rows = ([f"{x:.6g}" for x in row] for row in zip(*columns, strict=True))
    return csv_text([header, *rows])

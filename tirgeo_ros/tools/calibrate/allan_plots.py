"""Write the Allan deviation of each axis as a picture and as a CSV table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.allan.noise_fit import (
    FLICKER_FLOOR,
    AllanAnalysis,
    NoiseFit,
    deviation_band,
)
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io.files.whole_files import csv_text
from tirgeo_ros.tools.calibrate.allan_table import UNITS
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS
from tirgeo_ros.tools.presentation.plots import COLOURS, figure, png

_TITLES = {"gyro": "Gyroscope", "accel": "Accelerometer"}


def curves_png(analysis: AllanAnalysis, fits: Sequence[NoiseFit]) -> bytes:
    """Return a PNG: deviations with 95 % bands, fit, its asymptotes and the filter's model."""
    made, axes = figure(12.0, 7.2, 2, 3, sharex=True, sharey="row")
    for channel, (axis, fit) in enumerate(zip(axes.flat, fits, strict=True)):
        _draw(axis, analysis.tau_s, fit)
        sensor, letter = CHANNELS[channel].split()
        axis.set_title(f"{_TITLES[sensor]} {letter}")
        if channel % 3 == 0:
            axis.set_ylabel(f"Allan deviation [{UNITS[sensor]}]")
        if channel >= 3:
            axis.set_xlabel("averaging time [s]")
    for row, three in zip(axes, (fits[:3], fits[3:]), strict=True):
        measured = np.sqrt(np.concatenate([fit.variances for fit in three]))
        row[0].set_ylim(0.5 * measured.min(), 2 * measured.max())
    axes.flat[0].legend(loc="upper right", fontsize=8)
    return png(made)


def _draw(axis: Any, tau_s: Array, fit: NoiseFit) -> None:
    measured = np.sqrt(fit.variances)
    low, high = deviation_band(fit.variances, np.maximum(fit.degrees, 1.0))
    axis.fill_between(tau_s, low, high, color=COLOURS[0], alpha=0.25, lw=0, label="95 %")
    axis.loglog(tau_s, measured, ".", color=COLOURS[0], ms=4, label="measured")
    axis.loglog(tau_s, np.sqrt(fit.model), color=COLOURS[6], lw=1.0, label="N, B, K fitted")
    axis.loglog(
        tau_s, np.sqrt(fit.bias_model), "--", color=COLOURS[1], label="model of the filter"
    )
    for name, term, shape in (
        ("N", fit.white, tau_s**-0.5),
        ("B", fit.flicker, np.full(len(tau_s), FLICKER_FLOOR)),
        ("K", fit.walk, np.sqrt(tau_s / 3)),
    ):
        if term.value is not None:
            _asymptote(axis, name, tau_s, term.value * shape)
    axis.plot(fit.minimum_at_s, fit.minimum, "v", color=COLOURS[2], ms=6, label="minimum")


def _asymptote(axis: Any, name: str, tau_s: Array, line: Array) -> None:
    axis.loglog(tau_s, line, ":", color="#777777", lw=1.0)
    at = {"N": len(tau_s) // 4, "B": 2, "K": len(tau_s) - 3}[name]
    axis.annotate(name, (tau_s[at], line[at]), textcoords="offset points", xytext=(0, 4))


def curves_csv(analysis: AllanAnalysis, fits: Sequence[NoiseFit]) -> str:
    """Return CSV, a line per averaging time: of each axis deviation, band, fit, freedom.

    The last of each axis is its number of degrees of freedom.
    """
    columns: list[Any] = [analysis.tau_s]
    header = ["tau_s"]
    for name, fit in zip(CHANNELS, fits, strict=True):
        low, high = deviation_band(fit.variances, np.maximum(fit.degrees, 1.0))
        columns += [np.sqrt(fit.variances), low, high, np.sqrt(fit.model), fit.degrees]
        stem = name.replace(" ", "_")
        header += [f"{stem}_{part}" for part in ("deviation", "low", "high", "fit", "degrees")]
    rows = ([f"{x:.6g}" for x in row] for row in zip(*columns, strict=True))
    return csv_text([header, *rows])

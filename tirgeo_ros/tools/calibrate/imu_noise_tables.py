"""Format the noise of each axis of an IMU, at rest and in flight, for programs and for people."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.allan.bias_instability import Term
from tirgeo_ros.core.calibration.allan.flight_noise import Pieces
from tirgeo_ros.core.calibration.allan.noise_fit import FLICKER_FLOOR, NoiseFit
from tirgeo_ros.core.config.filter import ImuConfig
from tirgeo_ros.core.navigation.imu_clipping import CHANNELS as CLIPPED
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS, DENSITIES, UNITS

Axis = Mapping[str, Any]
#: Percentiles of low and high.
LOW, HIGH = 10, 90
_NAMED_LINES = 3


def rest_axes(fits: Sequence[NoiseFit]) -> list[dict[str, Any]]:
    """Return the result of each axis at rest, in SI units; None for a term that is not shown."""
    return [_rest_axis(name, fit) for name, fit in zip(CHANNELS, fits, strict=True)]


def _rest_axis(name: str, fit: NoiseFit) -> dict[str, Any]:
    bias = fit.bias
    return {
        "axis": name,
        **_term("random_walk", fit.white),
        **_term("bias_instability", fit.flicker),
        "minimum": fit.minimum,
        "minimum_sigma": fit.minimum_sigma,
        "minimum_over_0.664": fit.minimum / FLICKER_FLOOR,
        "minimum_at_s": fit.minimum_at_s,
        "minimum_reached": fit.minimum_reached,
        **_term("rate_random_walk", fit.walk),
        **_term("quantisation", fit.quantisation),
        "bias_sigma": bias.sigma,
        "bias_sigma_sigma": bias.sigma_of_sigma,
        "correlation_time_s": bias.time_s,
        "correlation_time_factor": bias.time_factor if math.isfinite(bias.time_factor) else None,
        "bias_seen": bias.seen,
        "shortest_time_s": fit.shortest_s,
        "misfit": fit.misfit,
    }


def _term(name: str, term: Term) -> dict[str, Any]:
    sigma = None if term.value is None else term.sigma
    return {name: term.value, f"{name}_sigma": sigma, f"{name}_upper": term.upper}


def flight_axes(
    flying: Pieces,
    resting: Pieces,
    clipped: Mapping[str, int],
    imu: ImuConfig,
    written: Sequence[float],
) -> list[dict[str, Any]]:
    """Return the result of each axis in flight, in SI units."""
    low, median, high = np.percentile(flying.floors, (LOW, 50, HIGH), axis=0)
    columns: dict[str, Any] = {
        "density_low": low,
        "density": median,
        "density_high": high,
        "second_difference": np.median(flying.differences, axis=0),
        "density_at_rest": np.median(resting.floors, axis=0) if len(resting.starts_s) else None,
        "configured": np.array([*imu.angle_random_walk, *imu.velocity_random_walk]),
        "written": np.array(written),
        "vibration_rms": np.sqrt(np.mean(flying.rms**2, axis=0)),
        "vibration_peak": flying.peaks.max(axis=0),
    }
    return [
        {
            "axis": name,
            **{key: v if v is None else float(v[channel]) for key, v in columns.items()},
            "clipped": clipped.get(CLIPPED[(channel + 3) % 6], 0),
            "lines": [
                {"frequency_hz": line.frequency_hz, "amplitude": line.amplitude}
                for line in flying.lines(channel)
            ],
        }
        for channel, name in enumerate(CHANNELS)
    ]


def rest_table(axes: Sequence[Axis]) -> str:
    """Return the axes at rest as a text table, the gyroscope's above the accelerometer's."""
    heads = {
        sensor: f"N in {DENSITIES[sensor]}; B, min, bias sigma in {unit}; K in {unit}/sqrt(s)"
        for sensor, unit in UNITS.items()
    }
    note = "B: flicker floor / 0.664. min: of the measured deviation. ~: one sigma; <: two."
    return f"{_table(heads, _REST, axes)}\n{note}"


def flight_table(axes: Sequence[Axis]) -> str:
    """Return the axes in flight as a text table, the gyroscope's above the accelerometer's."""
    heads = {
        sensor: f"densities in {DENSITIES[sensor]}; rms, peak and lines in {unit}"
        for sensor, unit in UNITS.items()
    }
    return _table(heads, _FLIGHT, axes)


def _table(
    heads: Mapping[str, str], columns: Mapping[str, Callable[[Axis], str]], axes: Sequence[Axis]
) -> str:
    lines = []
    for sensor, head in heads.items():
        rows = [
            [cell(axis) for cell in columns.values()]
            for axis in axes
            if axis["axis"].startswith(sensor)
        ]
        widths = [max(map(len, column)) for column in zip(columns, *rows, strict=True)]
        lines.append(f"{sensor}: {head}")
        lines += [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in ([*columns], *rows)
        ]
    return "\n".join(lines)


def _shown(name: str) -> Callable[[Axis], str]:
    def cell(axis: Axis) -> str:
        if axis[name] is None:
            return f"<{axis[f'{name}_upper']:.3e}"
        return _with_sigma(axis[name], axis[f"{name}_sigma"])

    return cell


def _with_sigma(value: float, sigma: float) -> str:
    return f"{value:.3e} ~{100 * sigma / value:.1f}%"


def _minimum(axis: Axis) -> str:
    reached = "" if axis["minimum_reached"] else "<"
    return reached + _with_sigma(axis["minimum"], axis["minimum_sigma"])


def _bias_sigma(axis: Axis) -> str:
    if not axis["bias_seen"]:
        return f"<{axis['bias_sigma']:.3e}"
    return _with_sigma(axis["bias_sigma"], axis["bias_sigma_sigma"])


def _bias_time(axis: Axis) -> str:
    factor = axis["correlation_time_factor"]
    return f"{axis['correlation_time_s']:.0f}" + (f" (x/ {factor:.1f})" if factor else "")


def _number(name: str, form: str = ".2e") -> Callable[[Axis], str]:
    return lambda axis: "-" if axis[name] is None else f"{axis[name]:{form}}"


def _lines(axis: Axis) -> str:
    lines = axis["lines"][:_NAMED_LINES]
    return ", ".join(f"{x['frequency_hz']:.1f} ({x['amplitude']:.2g})" for x in lines) or "-"


#: Title -> the text of an axis.
_REST: dict[str, Callable[[Axis], str]] = {
    "axis": lambda axis: axis["axis"][-1],
    "N": _shown("random_walk"),
    "B": _shown("bias_instability"),
    "min": _minimum,
    "min/0.664": _number("minimum_over_0.664", ".3e"),
    "at [s]": _number("minimum_at_s", ".0f"),
    "K": _shown("rate_random_walk"),
    "bias sigma": _bias_sigma,
    "bias time [s]": _bias_time,
}
_FLIGHT: dict[str, Callable[[Axis], str]] = {
    "axis": lambda axis: axis["axis"][-1],
    "10 %": _number("density_low"),
    "median": _number("density"),
    "90 %": _number("density_high"),
    "2nd diff.": _number("second_difference"),
    "at rest": _number("density_at_rest"),
    "configured": _number("configured"),
    "written": _number("written"),
    "rms": _number("vibration_rms", ".3g"),
    "peak": _number("vibration_peak", ".3g"),
    "clipped": _number("clipped", "d"),
    "lines: Hz (amplitude)": _lines,
}

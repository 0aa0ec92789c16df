"""Format the noise of each axis of an IMU, at rest and in flight, for programs and for people.

The axes x, y, z are those of the messages (forward, left, up). The filter's axes (forward, right,
down) differ only in sign, which does not change noise parameters.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tirgeo_ros.core.calibration.allan import FLICKER_FLOOR, NoiseFit, Term
from tirgeo_ros.core.calibration.flight_noise import Pieces
from tirgeo_ros.core.config.filter import ImuConfig
from tirgeo_ros.core.navigation.timeline.imu_clipping import CHANNELS as CLIPPED
from tirgeo_ros.tools.calibrate.imu_record import CHANNELS, UNITS

Axis = Mapping[str, Any]
#: Percentiles of low and high.
LOW, HIGH = 10, 90
#: Sensor -> the unit of its noise density.
DENSITIES = {"gyro": "rad/sqrt(s)", "accel": "m/s/sqrt(s)"}
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
        # Otherwise the curve is white noise up to the record's end.
        "minimum_reached": fit.flicker.value is not None or fit.walk.value is not None,
        **_term("rate_random_walk", fit.walk),
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
    low, median, high = np.percentile(flying.floors, (LOW, 50, HIGH), axis=0).tolist()
    differences = np.median(flying.differences, axis=0).tolist()
    still = np.median(resting.floors, axis=0).tolist() if len(resting.floors) else [None] * 6
    configured = [*imu.angle_random_walk, *imu.velocity_random_walk]
    return [
        {
            "axis": name,
            "density_low": low[k],
            "density": median[k],
            "density_high": high[k],
            "second_difference": differences[k],
            "density_at_rest": still[k],
            "configured": configured[k],
            "written": written[k],
            "clipped": clipped.get(CLIPPED[(k + 3) % 6], 0),
            "lines": [line._asdict() for line in flying.lines(k)],
        }
        for k, name in enumerate(CHANNELS)
    ]


def rest_table(axes: Sequence[Axis]) -> str:
    """Return the axes at rest as a text table, the gyroscope's above the accelerometer's."""
    heads = {
        sensor: f"N in {DENSITIES[sensor]}; B, min, bias sigma in {unit}; K in {unit}/sqrt(s)"
        for sensor, unit in UNITS.items()
    }
    note = "B: flicker floor / 0.664. min: of the measured deviation. ~: one sigma; <: two."
    return f"{_table(heads, [_rest_row(axis) for axis in axes])}\n{note}"


def _rest_row(axis: Axis) -> dict[str, str]:
    factor = axis["correlation_time_factor"]
    reached = "" if axis["minimum_reached"] else "<"
    return {
        "axis": axis["axis"],
        "N": _with_sigma(axis, "random_walk"),
        "B": _with_sigma(axis, "bias_instability"),
        "min": reached + _with_sigma(axis, "minimum"),
        "min/0.664": f"{axis['minimum_over_0.664']:.3e}",
        "at [s]": f"{axis['minimum_at_s']:.0f}",
        "K": _with_sigma(axis, "rate_random_walk"),
        "bias sigma": _with_sigma(axis, "bias_sigma")
        if axis["bias_seen"]
        else f"<{axis['bias_sigma']:.3e}",
        "bias time [s]": f"{axis['correlation_time_s']:.0f}"
        + (f" (x/ {factor:.1f})" if factor else ""),
    }


def _with_sigma(axis: Axis, name: str) -> str:
    value = axis[name]
    if value is None:
        return f"<{axis[f'{name}_upper']:.3e}"
    return f"{value:.3e} ~{100 * axis[f'{name}_sigma'] / value:.1f}%"


def flight_table(axes: Sequence[Axis]) -> str:
    """Return the axes in flight as a text table, the gyroscope's above the accelerometer's."""
    heads = {
        sensor: f"densities in {DENSITIES[sensor]}; lines in {unit}"
        for sensor, unit in UNITS.items()
    }
    return _table(heads, [_flight_row(axis) for axis in axes])


def _flight_row(axis: Axis) -> dict[str, str]:
    densities = {
        "10 %": "density_low",
        "median": "density",
        "90 %": "density_high",
        "2nd diff.": "second_difference",
        "at rest": "density_at_rest",
        "configured": "configured",
        "written": "written",
    }
    lines = [f"{x['frequency_hz']:.1f} ({x['amplitude']:.2g})" for x in axis["lines"]]
    return {
        "axis": axis["axis"],
        **{
            title: "-" if axis[key] is None else f"{axis[key]:.2e}"
            for title, key in densities.items()
        },
        "clipped": str(axis["clipped"]),
        "lines: Hz (amplitude)": ", ".join(lines[:_NAMED_LINES]) or "-",
    }


def _table(heads: Mapping[str, str], rows: Sequence[Mapping[str, str]]) -> str:
    """Return rows, title -> text, in columns; a sensor's below its head."""
    lines = []
    for sensor, head in heads.items():
        own = [{**row, "axis": row["axis"][-1]} for row in rows if row["axis"].startswith(sensor)]
        shown = [[*own[0]], *([*row.values()] for row in own)]
        widths = [max(map(len, column)) for column in zip(*shown, strict=True)]
        lines.append(f"{sensor}: {head}")
        lines += [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in shown
        ]
    return "\n".join(lines)

"""Format the result of an Allan analysis of each axis, for programs and for people."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from tirgeo_ros.core.calibration.allan.noise_fit import FLICKER_FLOOR, NoiseFit, Term

#: Sensor -> the unit of its samples.
UNITS = {"gyro": "rad/s", "accel": "m/s2"}
_WALKS = {"gyro": "rad/sqrt(s)", "accel": "m/s/sqrt(s)"}
_COLUMNS = ("axis", "N", "B", "min", "min/0.664", "at [s]", "K", "bias sigma", "bias time [s]")


def axis_of(name: str, fit: NoiseFit) -> dict[str, Any]:
    """Return the result of one axis, in SI units.

    None for a term that the record does not show.
    """
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


def table(axes: Sequence[Mapping[str, Any]]) -> str:
    """Return the axes as a text table, the gyroscope's above the accelerometer's."""
    lines = []
    for sensor, unit in UNITS.items():
        rows = [_row(axis) for axis in axes if axis["axis"].startswith(sensor)]
        walk = _WALKS[sensor]
        lines.append(f"{sensor}: N in {walk}; B, min, bias sigma in {unit}; K in {unit}/sqrt(s)")
        widths = [max(map(len, column)) for column in zip(_COLUMNS, *rows, strict=True)]
        lines += [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in (_COLUMNS, *rows)
        ]
    lines.append("B: flicker floor / 0.664. min: of the measured deviation. ~: one sigma; <: two.")
    return "\n".join(lines)


def _term(name: str, term: Term) -> dict[str, Any]:
    sigma = None if term.value is None else term.sigma
    return {name: term.value, f"{name}_sigma": sigma, f"{name}_upper": term.upper}


def _row(axis: Mapping[str, Any]) -> tuple[str, ...]:
    seen = axis["bias_seen"]
    factor = axis["correlation_time_factor"]
    reached = "" if axis["minimum_reached"] else "<"
    return (
        axis["axis"][-1],
        _shown(axis, "random_walk"),
        _shown(axis, "bias_instability"),
        reached + _with_sigma(axis["minimum"], axis["minimum_sigma"]),
        f"{reached}{axis['minimum_over_0.664']:.3e}",
        f"{'' if axis['minimum_reached'] else '>'}{axis['minimum_at_s']:.0f}",
        _shown(axis, "rate_random_walk"),
        _with_sigma(axis["bias_sigma"], axis["bias_sigma_sigma"])
        if seen
        else f"<{axis['bias_sigma']:.3e}",
        f"{axis['correlation_time_s']:.0f}" + (f" (x/ {factor:.1f})" if factor else ""),
    )


def _shown(axis: Mapping[str, Any], name: str) -> str:
    value = axis[name]
    if value is None:
        return f"<{axis[f'{name}_upper']:.3e}"
    return _with_sigma(value, axis[f"{name}_sigma"])


def _with_sigma(value: float, sigma: float) -> str:
    return f"{value:.3e} ~{100 * sigma / value:.1f}%"

"""Table 5: the IMU's noise by Allan variance."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dev.paper_tables import TABLE_5
from dev.reproduction.markdown import ratio, table, words
from dev.reproduction.script import WORK, Results, Run
from dev.reproduction.sections import Amounts, Section

_AXES = "xyz"
#: Name, paper's key, sensor, our key, unit.
_ROWS = (
    ("angle random walk N", "angle_random_walk_rad_sqrt_s", "gyro", "random_walk", "rad/√s"),
    (
        "velocity random walk N",
        "velocity_random_walk_m_s_sqrt_s",
        "accel",
        "random_walk",
        "m/s/√s",
    ),
    ("gyro bias", "gyro_dynamic_bias_rad_s", "gyro", "bias_sigma", "rad/s"),
    ("accelerometer bias", "accel_dynamic_bias_m_s2", "accel", "bias_sigma", "m/s²"),
    ("gyro correlation time", "gyro_correlation_time_s", "gyro", "correlation_time_s", "s"),
    (
        "accelerometer correlation time",
        "accel_correlation_time_s",
        "accel",
        "correlation_time_s",
        "s",
    ),
)
_TERMS = (("bias_instability", "B"), ("rate_random_walk", "K"))


def table_5(amounts: Amounts) -> Section:
    """An IMU at rest."""
    static = f"{WORK}/static.mcap"
    steps = [
        Run(
            "static",
            "python -m tirgeo_ros.tools.simulate.static_imu "
            f"-o {static} --hours {amounts.hours:g}",
        ),
        Run("allan", f"tirgeo calibrate allan {static} -o {WORK}/imu.yaml"),
    ]
    return Section("Table 5: the IMU's noise", steps, _tell)


def _tell(found: Results) -> str:
    axes = {axis["axis"]: axis for axis in found["allan"]["axes"]}
    rows = [
        _row(name, unit, axis, TABLE_5[paper][k], axes[f"{sensor} {axis}"], key)
        for name, paper, sensor, key, unit in _ROWS
        for k, axis in enumerate(_AXES)
    ]
    head = ["parameter", "axis", "paper, and put in", "here", "here / paper"]
    return "\n\n".join([table(head, rows), words(_said(found["allan"], axes)), _terms(axes)])


def _row(
    name: str, unit: str, axis: str, paper: float, here: Mapping[str, Any], key: str
) -> list[str]:
    """A parameter of one axis, or that the record does not show it."""
    first = f"{name}, {unit}"
    if key == "random_walk":
        cells = [_with_sigma(here[key], here[f"{key}_sigma"]), ratio(here[key], paper)]
    elif not here["bias_seen"]:
        cells = ["not seen", ""] if key != "bias_sigma" else [f"< {here[key]:.3e}", ""]
    elif key == "bias_sigma":
        cells = [_with_sigma(here[key], here["bias_sigma_sigma"]), ratio(here[key], paper)]
    else:
        factor = here["correlation_time_factor"]
        about = f" (to a factor of {factor:.1f})" if factor else ""
        cells = [f"{here[key]:.0f}{about}", ratio(here[key], paper)]
    given = f"{paper:g}" if key == "correlation_time_s" else f"{paper:.4e}"
    return [first, axis, given, *cells]


def _with_sigma(value: float, sigma: float) -> str:
    return f"{value:.3e} ± {sigma:.1e}"


def _said(result: Mapping[str, Any], axes: Mapping[str, Mapping[str, Any]]) -> str:
    walks = [
        abs(axes[f"{sensor} {axis}"]["random_walk"] / TABLE_5[paper][k] - 1)
        for _, paper, sensor, key, _ in _ROWS
        for k, axis in enumerate(_AXES)
        if key == "random_walk"
    ]
    seen = [name for name, axis in axes.items() if axis["bias_seen"]]
    return f"""
    {result["span_s"] / 3600:.2g} h at {result["rate_hz"]:.0f} Hz of the simulator's own IMU: Table
    5's white noise, a constant bias, and a first-order Gauss-Markov bias whose standard deviation
    and correlation time are Table 5's "dynamic bias" and "correlation cycle" (taken as seconds).

    - Both random walks come back within {100 * max(walks):.1f} % on all axes.
    - The bias is seen on {len(seen)} of {len(axes)} axes ({", ".join(seen) or "none"}). Elsewhere
      the white noise covers it over every time that a record of this length has, and a bound of
      two sigmas is told instead of a number. Times of thousands of seconds come out to a factor of
      two at best. How the paper came by its own it does not say.
    - The paper may mean something else by the two: toolboxes for Allan variance often take the
      curve's floor for the dynamic bias, and where that floor lies for the correlation time. Those
      are no parameters of a Gauss-Markov process. The simulator takes the words as they stand; the
      table below has the floor too, and the bias instability B, which is the floor of the flicker
      noise alone over 0.664.
    - Table 5 has no rate random walk K and the simulator puts none in. A Gauss-Markov bias looks
      like one over times shorter than its correlation time, so that a K may be told nevertheless.
    """


def _terms(axes: Mapping[str, Mapping[str, Any]]) -> str:
    rows = []
    for name, axis in axes.items():
        floor = "" if axis["minimum_reached"] else "< "
        cells = [
            f"{floor}{axis['minimum']:.3e}",
            f"{'' if axis['minimum_reached'] else '> '}{axis['minimum_at_s']:.0f}",
            f"{floor}{axis['minimum_over_0.664']:.3e}",
        ]
        rows.append([name, *cells, *(_term(axis, key) for key, _ in _TERMS)])
    head = ["axis", "floor of the curve", "at, s", "floor / 0.664", *(_names())]
    return table(head, rows)


def _names() -> Sequence[str]:
    return [name for _, name in _TERMS]


def _term(axis: Mapping[str, Any], key: str) -> str:
    value = axis[key]
    if value is None or not math.isfinite(value):
        return f"< {axis[f'{key}_upper']:.3e}"
    return _with_sigma(value, axis[f"{key}_sigma"])

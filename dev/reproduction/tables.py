# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Lay out the results of the commands as the paper's tables, in Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, TypeAlias

import numpy as np

from dev.reproduction.paper import (
    TABLE_2_M,
    TABLE_5,
    TABLE_6_AVERAGE_M,
    TABLE_6_M,
    TABLE_7,
    TABLE_8_DEG,
    TABLE_9,
)
from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.tools.evaluate.result import paired_tests

_AXES = "xyz"
#: Results of the commands by name.
Results: TypeAlias = Mapping[str, Mapping[str, Any]]


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table whose source is in columns too; all but the first to the right."""
    widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
    rule = ["-" * widths[0], *("-" * (width - 1) + ":" for width in widths[1:])]
    lines = []
    for cells in (head, rule, *rows):
        first, *others = zip(cells, widths, strict=True)
        padded = [first[0].ljust(first[1]), *(cell.rjust(width) for cell, width in others)]
        lines.append(f"| {' | '.join(padded)} |")
    return "\n".join(lines)


def fixed(value: float | None, digits: int) -> str:
    """Return a number with this many decimals, - for None; no zero has a sign."""
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"


def ground_factors(results: Results) -> dict[str, object]:
    """Return Table 2."""
    names = ("Position", "Height", "Position3D", "Yaw")
    columns = [[TABLE_2_M[f"Cam{name}"] for name in names]]
    for run, form in (
        ("budget", "closed"),
        ("centred budget", "closed"),
        ("budget", "general"),
    ):
        means = {r["factor"]: r["mean_m"] for r in results[run]["rows"] if r["form"] == form}
        columns.append(
            [means[factor] for factor in ("position", "height", "position 3d", "heading")]
        )
    ratios = [columns[1][k] / columns[0][k] for k in range(4)]
    rows = [
        [f"E_Cam{name}", *(fixed(column[k], 4) for column in columns), f"{ratios[k]:.2f}"]
        for k, name in enumerate(names)
    ]
    forms = ("paper", "Eq. 15-21", "same, centred", "covariance")
    head = ["mean over the field of view, m", *forms, "Eq. 15-21 / paper"]
    return {
        "ground_factors": table(head, rows),
        "height_off": f"{100 * (ratios[1] - 1):.1f} %",
        "heading_off": f"{100 * (ratios[3] - 1):.1f} %",
    }


#: Name and unit, paper's key, sensor, our key.
_IMU_ROWS = (
    ("angle random walk N, rad/√s", "angle_random_walk_rad_sqrt_s", "gyro", "random_walk"),
    ("velocity random walk N, m/s/√s", "velocity_random_walk_m_s_sqrt_s", "accel", "random_walk"),
    ("gyro bias, rad/s", "gyro_dynamic_bias_rad_s", "gyro", "bias_sigma"),
    ("accelerometer bias, m/s²", "accel_dynamic_bias_m_s2", "accel", "bias_sigma"),
    ("gyro correlation time, s", "gyro_correlation_time_s", "gyro", "correlation_time_s"),
    (
        "accelerometer correlation time, s",
        "accel_correlation_time_s",
        "accel",
        "correlation_time_s",
    ),
)


def imu_noise(allan: Mapping[str, Any]) -> dict[str, object]:
    """Return Table 5."""
    axes = {axis["axis"]: axis for axis in allan["axes"]}
    rows, walks = [], []
    for name, key, sensor, ours in _IMU_ROWS:
        for axis, paper in zip(_AXES, TABLE_5[key], strict=True):
            here = axes[f"{sensor} {axis}"]
            printed = f"{paper:g}" if ours == "correlation_time_s" else f"{paper:.4e}"
            rows.append([name, axis, printed, *_imu_cells(here, ours, paper)])
            walks += [abs(here[ours] / paper - 1)] if ours == "random_walk" else []
    shown = [name for name, axis in axes.items() if axis["bias_observed"]]
    return {
        "imu_noise": table(
            ["parameter", "axis", "paper, and put in", "here", "here / paper"], rows
        ),
        "hours": f"{allan['span_s'] / 3600:.2g}",
        "imu_hz": f"{allan['rate_hz']:.0f}",
        "walk_off": f"{100 * max(walks):.1f}",
        "axes_seen": f"{len(shown)} of {len(axes)} axes ({', '.join(shown) or 'none'})",
    }


def _imu_cells(here: Mapping[str, Any], key: str, paper: float) -> list[str]:
    """Return a parameter of one axis and its ratio, or that the record does not show it."""
    if key != "random_walk" and not here["bias_observed"]:
        return ["not seen" if key != "bias_sigma" else f"< {here[key]:.3e}", ""]
    value = f"{here[key]:.0f}" if key == "correlation_time_s" else f"{here[key]:.3e}"
    if key == "random_walk":
        value += f" ± {here['random_walk_sigma']:.1e}"
    return [value, f"{here[key] / paper:.2f}"]


def boards(results: Results) -> dict[str, object]:
    """Return Tables 8 and 9."""
    wall, truth = results["gimbal"], results["boards"]["angles_std_deg"]
    rows = []
    for axis in ("pitch", "yaw", "roll"):
        here = wall["std_deg"][axis]
        numbers = (TABLE_8_DEG[axis], truth[axis], here, wall["noise_deg"][axis])
        rows.append([axis, *(fixed(number, 4) for number in numbers), f"{here / truth[axis]:.2f}"])
    head = ["axis, deg", "paper", "put in", "here", "of it noise of the picture", "here / put in"]
    lens = results["lens"]
    lengths = {"fx": XT2.fx, "fy": XT2.fy, "cx": XT2.cx, "cy": XT2.cy}
    true = lengths | dict(zip(("k1", "k2", "p1", "p2"), XT2.distortion, strict=True))
    fitted = []
    for name, value in lens["parameters"].items():
        unit, digits = (", px", 2) if name in lengths else ("", 5)
        sigma = lens["sigma"][name]
        cells = [fixed(TABLE_9[name], 4), fixed(value, digits), fixed(sigma, digits)]
        fitted.append([f"{name}{unit}", *cells, f"{(value - true[name]) / sigma:+.1f}"])
    return {
        "gimbal": table(head, rows),
        "wall_used": wall["used"],
        "wall_pictures": wall["pictures"],
        "lens": table(
            ["parameter", "paper, and put in", "here", "sigma", "off by, sigmas"], fitted
        ),
        "views_used": lens["views"],
        "views": lens["pictures"],
        "views_refused": len(lens["refused"]),
        "covered": f"{100 * lens['covered_share']:.0f}",
        "reprojection_px": fixed(lens["reprojection_rms_px"], 3),
        "worst_view_px": fixed(max(lens["view_rms_px"].values()), 3),
    }


METHODS = {
    "raw": "original GPS and attitude",
    "rtk": "RTK, original attitude",
    "ekf": "our previous method",
    "ekf_heading": "the proposed method",
    "calibrated": "-",
}
_WAYS = ("paper", "encoders")
_PLANTED = {"roll": 1.0, "pitch": -0.8, "yaw": 1.5, "latency": 70.0}  # as in page.md


def _mean(result: Mapping[str, Any], method: str) -> float:
    return float(result["methods"][method]["mean_point_rmse_m"])


def located(results: Results) -> dict[str, object]:
    """Return Table 6: its averages by way."""
    seeds = [
        name.split()[1] for name in results if name.startswith("flight ") and name[-1].isdigit()
    ]
    means = {  # way -> method -> means of the paper's flight and of the others
        way: {
            method: [
                _mean(results[way if seed is None else f"{way} {seed}"], method)
                for seed in (None, *seeds)
            ]
            for method in METHODS
        }
        for way in _WAYS
    }
    values: dict[str, object] = {}
    for way in _WAYS:
        rows = []
        for method, words in METHODS.items():
            paper, (here, *others) = TABLE_6_AVERAGE_M.get(method), means[way][method]
            spread = fixed(float(np.mean(others)), 2)
            if len(others) > 1:
                spread += f" ± {fixed(float(np.std(others, ddof=1)), 2)}"
            ratio = "-" if paper is None else f"{here / paper:.2f}"
            rows.append([f"`{method}`", words, fixed(paper, 2), fixed(here, 2), ratio, spread])
        head = ["method", "in the paper", "paper, m", "here, m", "here / paper"]
        values[f"located_{way}"] = table([*head, f"{len(seeds)} other flights, m"], rows)
        flights = zip(*(means[way][method] for method in list(METHODS)[:4]), strict=True)
        ordered = sum(all(a > b for a, b in pairwise(flight)) for flight in flights)
        values[f"in_order_{way}"] = f"{ordered} of {len(seeds) + 1}"
    values["calibrated"] = ", ".join(
        f"{name} {fit['found']:.2f} ± {fit['sigma']:.2f} {fit['unit']}"
        for name, fit in results["boresight encoders"]["parameters"].items()
    )
    return values


def askew(results: Results) -> dict[str, object]:
    """Return Table 6 with the camera askew."""
    rows = [
        [f"{name}, {fit['unit']}", fixed(_PLANTED.get(name, 0.0), 2)]
        + [fixed(fit[key], 2) for key in ("found", "sigma")]
        for name, fit in results["askew boresight"]["parameters"].items()
    ]
    errors = [
        [f"`{name}`", fixed(TABLE_6_AVERAGE_M.get(name), 2)]
        + [fixed(_mean(results[run], name), 2) for run in ("encoders", "askew")]
        for name in METHODS
    ]
    return {
        "askew_found": table(["found in the first flight", "planted", "found", "sigma"], rows),
        "askew_errors": table(
            ["method, encoders", "paper, m", "straight camera, m", "askew, second flight, m"],
            errors,
        ),
        "straight_m": fixed(_mean(results["encoders"], "ekf_heading"), 2),
        "askew_m": fixed(_mean(results["askew"], "ekf_heading"), 2),
        "calibrated_m": fixed(_mean(results["askew"], "calibrated"), 2),
    }


def p_values(results: Results) -> str:
    """Return Table 7."""
    columns = [{(test.first, test.second): test.p_value for test in paired_tests(TABLE_6_M)}]
    columns += [
        {(test["first"], test["second"]): test["p_value"] for test in results[way]["t_tests"]}
        for way in _WAYS
    ]
    rows = [
        [f"`{pair[0]}`, `{pair[1]}`", fixed(TABLE_7.get(pair), 4)]
        + [_p_value(column[pair]) for column in columns]
        for pair in columns[0]
    ]
    head = ["methods", "paper", "from the paper's Table 6", *(f"here, `{way}`" for way in _WAYS)]
    return table(head, rows)


def _p_value(value: float | None) -> str:
    """Return a p-value as the paper prints them."""
    return "< 0.0001" if value is not None and value < 0.0001 else fixed(value, 4)

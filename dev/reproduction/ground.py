"""Lay out Tables 6 and 7: control points located on the ground by every method."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np

from dev.paper_tables import TABLE_6_AVERAGE_M, TABLE_6_M, TABLE_7
from dev.reproduction.tables import Results, fixed, p_value, table
from tirgeo_ros.tools.evaluate.result import paired_tests

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


def located(found: Results) -> dict[str, object]:
    """Return Table 6: its averages by way, the gains, and every point."""
    seeds = [
        name.split()[1] for name in found if name.startswith("flight ") and name[-1].isdigit()
    ]
    means = {  # way -> method -> means of the paper's flight and of the others
        way: {
            method: [
                _mean(found[way if seed is None else f"{way} {seed}"], method)
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
    rows = []
    for method in list(METHODS)[1:]:
        pairs = [(sum(means[way][method]), sum(means[way]["raw"])) for way in _WAYS]
        paper = TABLE_6_AVERAGE_M.get(method)
        less = "-" if paper is None else _share(paper, TABLE_6_AVERAGE_M["raw"])
        rows.append([f"`{method}`", less, *(_share(*pair) for pair in pairs)])
    ways = [f"here, `composition: {way}`" for way in _WAYS]
    calibrated = ", ".join(
        f"{name} {one['found']:.2f} ± {one['sigma']:.2f} {one['unit']}"
        for name, one in found["boresight encoders"]["parameters"].items()
    )
    return values | {
        "gains": table(["less than `raw` by", "paper", *ways], rows),
        "points": _points(found["paper"]),
        "calibrated": calibrated,
    }


def _share(value: float, raw: float) -> str:
    return f"{100 * (1 - value / raw):.0f} %"


def _points(result: Mapping[str, Any]) -> str:
    methods = list(METHODS)[:4]
    rows = []
    for number, (name, point) in enumerate(result["points"].items(), 1):
        paper = [fixed(TABLE_6_M[method].get(str(number)), 2) for method in methods]
        here = [fixed(point["rmse_m"][method], 2) for method in methods]
        rows.append([str(number), *paper, name, *here])
    return table(["no.", *(f"paper: {name}" for name in methods), "point", *methods], rows)


def askew(found: Results) -> dict[str, object]:
    """Return Table 6 with the camera askew."""
    rows = [
        [f"{name}, {one['unit']}", fixed(_PLANTED.get(name, 0.0), 2)]
        + [fixed(one[key], 2) for key in ("found", "sigma")]
        for name, one in found["askew boresight"]["parameters"].items()
    ]
    errors = [
        [f"`{name}`", fixed(TABLE_6_AVERAGE_M.get(name), 2)]
        + [fixed(_mean(found[run], name), 2) for run in ("encoders", "askew")]
        for name in METHODS
    ]
    return {
        "askew_found": table(["found in the first flight", "planted", "found", "sigma"], rows),
        "askew_errors": table(
            ["method, encoders", "paper, m", "straight camera, m", "askew, second flight, m"],
            errors,
        ),
        "straight_m": fixed(_mean(found["encoders"], "ekf_heading"), 2),
        "askew_m": fixed(_mean(found["askew"], "ekf_heading"), 2),
        "calibrated_m": fixed(_mean(found["askew"], "calibrated"), 2),
    }


def p_values(found: Results) -> str:
    """Return Table 7."""
    columns = [{(one.first, one.second): one.p_value for one in paired_tests(TABLE_6_M)}]
    columns += [
        {(one["first"], one["second"]): one["p_value"] for one in found[way]["t_tests"]}
        for way in _WAYS
    ]
    rows = [
        [f"`{pair[0]}`, `{pair[1]}`", fixed(TABLE_7.get(pair), 4)]
        + [p_value(column[pair]) for column in columns]
        for pair in columns[0]
    ]
    head = ["methods", "paper", "from the paper's Table 6", *(f"here, `{way}`" for way in _WAYS)]
    return table(head, rows)

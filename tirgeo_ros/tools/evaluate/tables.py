"""Format the numbers of an evaluation as the paper's Tables 6 and 7, for a terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

_WIDTH = 13


def text_tables(numbers: Mapping[str, Any]) -> str:
    """Return the verdict and the tables of what ``summary`` returns."""
    parts = [
        [numbers["verdict"]],
        _errors(numbers),
        _p_values(numbers),
        _against_truth(numbers),
        _words(numbers),
    ]
    return "\n\n".join("\n".join(part) for part in parts if part)


def _errors(numbers: Mapping[str, Any]) -> list[str]:
    methods = numbers["methods"]
    lines = [
        "horizontal error of each control point (rmse over its observations, Eq. 24), m",
        _line("point", [*methods, "seen"]),
    ]
    for name, point in numbers["points"].items():
        errors = [_number(point["rmse_m"][method]) for method in methods]
        lines.append(_line(name, [*errors, str(point["observations"])]))
    for title, key in (("mean", "mean_point_rmse_m"), ("rmse", "rmse_m"), ("CE90", "ce90_m")):
        lines.append(_line(title, [_number(one[key]) for one in methods.values()]))
    seen = sum(point["observations"] for point in numbers["points"].values())
    located = [str(one["located"]) for one in methods.values()]
    lines.append(_line("located", [*located, f"of {seen}"]))
    lines.append(_line("in ellipse", [_share(one) for one in methods.values()]))
    return lines


def _p_values(numbers: Mapping[str, Any]) -> list[str]:
    methods = list(numbers["methods"])
    found = {frozenset((one["first"], one["second"])): one for one in numbers["t_tests"]}
    lines = [
        "paired t-test on these points, two-sided p-value",
        _line("", methods),
    ]
    for row in methods:
        tests = (found.get(frozenset((row, column))) for column in methods)
        lines.append(_line(row, [_p_value(test) for test in tests]))
    notes = [
        f"{one['first']}, {one['second']}: no p-value: {one['note']}"
        for one in numbers["t_tests"]
        if one["note"]
    ]
    return [*lines, *notes]


def _against_truth(numbers: Mapping[str, Any]) -> list[str]:
    """Return the lines of the body's own errors; [] without a truth."""
    found = {name: one["against_truth"] for name, one in numbers["methods"].items()}
    if None in found.values():
        return []
    rows = (("roll", "roll_deg"), ("pitch", "pitch_deg"), ("heading", "heading_deg"))
    lines = [
        numbers["definitions"]["against_truth"],
        _line("", list(found)),
    ]
    for title, key in (*rows, ("position", "position_m")):
        unit = key.rpartition("_")[2]
        cells = [_number(one[key]) for one in found.values()]
        lines.append(_line(f"{title}, {unit}", cells))
    return lines


def _words(numbers: Mapping[str, Any]) -> list[str]:
    lines = [
        f"plane: {numbers['projection']['name']}",
        "mean: of the points' errors; rmse, CE90 (90th percentile): of all observations;",
        "in ellipse: the surveyed place lies in the predicted ellipse of 95 %",
    ]
    for method, one in numbers["methods"].items():
        lines += [f"{method}: {number} x {why}" for why, number in one["refused"].items()]
    return [*lines, *numbers["notes"]]


def _line(name: str, cells: Sequence[str]) -> str:
    return f"{name:<{_WIDTH}}" + "".join(f"{cell:>{_WIDTH}}" for cell in cells)


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _share(method: Mapping[str, Any]) -> str:
    located = method["located"]
    return f"{100 * method['inside_95'] / located:.0f} %" if located else "-"


def _p_value(test: Mapping[str, Any] | None) -> str:
    if test is None or test["p_value"] is None:
        return "-"
    return "< 0.0001" if test["p_value"] < 0.0001 else f"{test['p_value']:.4f}"

"""Lay out the numbers of an evaluation as tables, for a terminal and for the report."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

_WIDTH = 13
_Number = Mapping[str, Any]


class Table(NamedTuple):
    """Hold a table of text; its first column is left-aligned."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()


def tables(numbers: _Number) -> list[Table]:
    """Return the tables of what ``summary`` returns: Tables 6 and 7, and the aircraft's errors."""
    found = [_errors(numbers), _p_values(numbers)]
    if all(one["against_truth"] is not None for one in numbers["methods"].values()):
        found.append(_against_truth(numbers))
    return found


def text_tables(numbers: _Number) -> str:
    """Return the verdict, the tables and the notes of what ``summary`` returns."""
    parts = [[numbers["verdict"]]]
    parts += [
        [one.title, *(_line(row) for row in (one.head, *one.rows)), *one.notes]
        for one in tables(numbers)
    ]
    words = [
        f"plane: {numbers['projection']['name']}",
        "mean: of the points' errors; rmse, CE90 (90th percentile): of all observations;",
        "in ellipse: the surveyed place lies in the predicted ellipse of 95 %",
    ]
    for method, one in numbers["methods"].items():
        words += [f"{method}: {number} x {why}" for why, number in one["refused"].items()]
    return "\n\n".join("\n".join(part) for part in [*parts, [*words, *numbers["notes"]]])


def _line(cells: Sequence[str]) -> str:
    return f"{cells[0]:<{_WIDTH}}" + "".join(f"{cell:>{_WIDTH}}" for cell in cells[1:])


def _metres(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def _share(method: _Number) -> str:
    located = method["located"]
    return f"{100 * method['inside_95'] / located:.0f} %" if located else "-"


#: Title of each row on a whole method, and its cell.
_OF_METHOD: dict[str, Callable[[_Number], str]] = {
    "mean": lambda one: _metres(one["mean_point_rmse_m"]),
    "rmse": lambda one: _metres(one["rmse_m"]),
    "CE90": lambda one: _metres(one["ce90_m"]),
    "mean east": lambda one: _metres(one["mean_error_east_m"]),
    "mean north": lambda one: _metres(one["mean_error_north_m"]),
    "located": lambda one: str(one["located"]),
    "in ellipse": _share,
    "gimbal": lambda one: str(one["composition"]),
}


def _errors(numbers: _Number) -> Table:
    methods, points = numbers["methods"], numbers["points"]
    rows = [
        [name, *(_metres(one["rmse_m"][m]) for m in methods), str(one["observations"])]
        for name, one in points.items()
    ]
    seen = {"located": f"of {sum(one['observations'] for one in points.values())}"}
    rows += [
        [title, *(cell(one) for one in methods.values()), seen.get(title, "")]
        for title, cell in _OF_METHOD.items()
    ]
    title = "horizontal error of each control point (rmse over its observations, Eq. 24), m"
    return Table(title, ["point", *methods, "seen"], rows)


def _p_values(numbers: _Number) -> Table:
    methods = list(numbers["methods"])
    cells = {}
    for test in numbers["t_tests"]:
        p_value, pair = test["p_value"], (test["first"], test["second"])
        text = "-" if p_value is None else "< 0.0001" if p_value < 1e-4 else f"{p_value:.4f}"
        cells[pair] = cells[pair[::-1]] = text
    return Table(
        "paired t-test on these points, two-sided p-value",
        ["", *methods],
        [[row, *(cells.get((row, column), "-") for column in methods)] for row in methods],
        [
            f"{one['first']}, {one['second']}: no p-value: {one['note']}"
            for one in numbers["t_tests"]
            if one["note"]
        ],
    )


def _against_truth(numbers: _Number) -> Table:
    found = {name: one["against_truth"] for name, one in numbers["methods"].items()}
    rows = []
    for key in next(iter(found.values()), {}):
        title, _, unit = key.rpartition("_")
        rows.append([f"{title}, {unit}", *(_metres(one[key]) for one in found.values())])
    return Table(numbers["definitions"]["against_truth"], ["", *found], rows)

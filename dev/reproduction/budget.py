"""Tables 1 and 2: errors of the sensors, and what they do on the ground."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from dev.paper_tables import TABLE_1, TABLE_2_M, TABLE_9
from dev.reproduction.markdown import fixed, ratio, table, words
from dev.reproduction.script import WORK, Put, Results, Run, Step
from dev.reproduction.sections import FLIGHT, SCENARIO, Amounts, Section
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.tools.simulate.scenario import Scenario

_CENTRED = f"""\
image_width: {XT2.width}
image_height: {XT2.height}
camera_matrix: {{data: [{TABLE_9["fx"]}, 0, {(XT2.width - 1) / 2}, 0, {TABLE_9["fy"]}, \
{(XT2.height - 1) / 2}, 0, 0, 1]}}
distortion_model: plumb_bob
distortion_coefficients: {{data: [0, 0, 0, 0, 0]}}
"""


def table_1(amounts: Amounts) -> Section:
    """GPS against RTK, the autopilot's heading against the filter's."""
    steps: list[Step] = [
        Run("flight", f"tirgeo simulate {SCENARIO} -o {FLIGHT} --no-images{amounts.window}"),
        Run("flight budget", f"tirgeo budget {FLIGHT}/flight.mcap --params {FLIGHT}/params.yaml"),
    ]
    return Section("Table 1: errors of GPS and autopilot", steps, _tell_1)


def _tell_1(found: Results) -> str:
    told = found["flight budget"]["flight"]
    scenario = Scenario()
    north, east, down = scenario.gps.position_rms_m
    rows = [
        _row_1("E_Xcam (east)", "m", TABLE_1["E_Xcam_m"], east, told["east_error_m"]),
        _row_1("E_Ycam (north)", "m", TABLE_1["E_Ycam_m"], north, told["north_error_m"]),
        _row_1("E_hcam (height)", "m", TABLE_1["E_hcam_m"], down, told["height_error_m"]),
        _row_1(
            "E_beta (heading)",
            "deg",
            TABLE_1["E_beta_deg"],
            scenario.autopilot.heading_rms_deg,
            told["heading_error_deg"],
        ),
    ]
    text = f"""
    Root mean squares by Eq. 22, of {told["positions"]} GPS positions against RTK and
    {told["headings"]} headings of the autopilot against the filter's. The simulator was given the
    paper's numbers as rms over the flight, so that the agreement shows that Eq. 22 is worked out
    rightly from a bag, and nothing of GPS. What differs: RTK is not the truth but off by a
    centimetre or two, and the filter's heading is compared only once it has settled, so that the
    autopilot's error over the rest of the flight is what counts.
    """
    head = ["error", "paper", "put in", "here", "here / paper"]
    return f"{table(head, rows)}\n\n{words(text)}"


def _row_1(name: str, unit: str, paper: float, given: float, here: float) -> list[str]:
    numbers = [fixed(value, 4, unit) for value in (paper, given, here)]
    return [name, *numbers, ratio(here, paper)]


def table_2(_amounts: Amounts) -> Section:
    """What those errors do on the ground."""
    steps: list[Step] = [
        Put(f"{WORK}/centred.yaml", _CENTRED),
        Run("budget", "tirgeo budget"),
        Run("centred budget", f"tirgeo budget --camera {WORK}/centred.yaml"),
    ]
    return Section("Table 2: registration errors by factor", steps, _tell_2)


def _tell_2(found: Results) -> str:
    columns = [
        [TABLE_2_M[f"Cam{name}"] for name in ("Position", "Height", "Position3D", "Yaw")],
        _means(found["budget"], "closed"),
        _means(found["centred budget"], "closed"),
        _means(found["budget"], "general"),
        _means(found["flight budget"], "closed"),
    ]
    names = ["E_CamPosition", "E_CamHeight", "E_CamPosition3D", "E_CamYaw"]
    rows = [
        [name, *(fixed(column[k], 4) for column in columns), ratio(columns[1][k], columns[0][k])]
        for k, name in enumerate(names)
    ]
    rows.append(["hypotenuse of the first two", *(fixed(_hypot(c), 4) for c in columns), ""])
    rows[-1][-1] = ratio(_hypot(columns[1]), columns[0][2])
    head = [
        "mean over the field of view, m",
        *("paper", "Eq. 15-21", "same, centred", "covariance", "flight's own errors"),
        "Eq. 15-21 / paper",
    ]
    text = f"""
    20 m above the ground, camera 30 degrees down, the errors of Table 1 as printed. *Eq. 15-21* is
    the paper's closed form with the lens of Table 9 without its distortion, *same, centred* with
    the principal point in the middle of the picture, *covariance* our own general form
    (rotation matrices, whole lens), *flight's own errors* the closed form with the errors, height
    and tilt that the simulated flight shows.

    - Neither principal point gives the paper's {fixed(TABLE_2_M["CamHeight"], 4)} m and
      {fixed(TABLE_2_M["CamYaw"], 4)} m to the last digit; Table 9's is the nearer one, off by
      {_off(columns, 1)} and {_off(columns, 3)}. The paper does not say over which pixels it took
      the mean; the rest we cannot explain.
    - The paper's third number, {fixed(TABLE_2_M["CamPosition3D"], 4)}, is to its rounding the
      hypotenuse of its first two means, {fixed(TABLE_2_M["CamPosition"], 4)} and
      {fixed(TABLE_2_M["CamHeight"], 4)}. Ours is the mean of every pixel's own hypotenuse, which
      is always the larger; the last row is made in the paper's way.
    """
    return f"{table(head, rows)}\n\n{words(text)}"


def _means(result: Mapping[str, Any], form: str) -> list[float]:
    """Of position, height, both and heading."""
    means = {row["factor"]: row["mean_m"] for row in result["rows"] if row["form"] == form}
    return [means[name] for name in ("position", "height", "position 3d", "heading")]


def _off(columns: Sequence[Sequence[float]], row: int) -> str:
    """Our closed form less the paper's."""
    return f"{100 * (columns[1][row] / columns[0][row] - 1):.1f} %"


def _hypot(column: Sequence[float]) -> float:
    return math.hypot(column[0], column[1])

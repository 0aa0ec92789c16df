"""Tables 8 and 9: the gimbal's stability and the lens, from pictures of a checkerboard."""

from __future__ import annotations

from dev.paper_tables import TABLE_8_DEG, TABLE_9
from dev.reproduction.markdown import fixed, ratio, table, words
from dev.reproduction.script import WORK, Results, Run
from dev.reproduction.sections import Amounts, Section
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.tools.simulate.boards import BOARD

_FOLDER = f"{WORK}/boards"
_BOARD = f"--board {BOARD.columns}x{BOARD.rows} --square {BOARD.square_m:g}"
_LENGTHS = ("fx", "fy", "cx", "cy")
#: The mean and the largest reprojection error that the paper tells of (section 5.3, Fig. 33).
_PAPER_MEAN_PX, _PAPER_LARGEST_PX = 0.51, 0.8


def table_8(amounts: Amounts) -> Section:
    """A board on a wall."""
    steps = [
        Run(
            "boards",
            f"python -m tirgeo_ros.tools.simulate.boards -o {_FOLDER} "
            f"--views {amounts.views} --seconds {amounts.seconds:g}",
        ),
        Run("gimbal", f"tirgeo calibrate gimbal {_FOLDER}/wall.mcap {_BOARD}"),
    ]
    return Section("Table 8: stability of the gimbal", steps, _tell_8)


def _tell_8(found: Results) -> str:
    here, truth = found["gimbal"], found["boards"]["angles_std_deg"]
    rows = [
        [
            axis,
            fixed(TABLE_8_DEG[axis], 4),
            fixed(truth[axis], 4),
            fixed(here["std_deg"][axis], 4),
            fixed(here["noise_deg"][axis], 4),
            ratio(here["std_deg"][axis], truth[axis]),
        ]
        for axis in ("pitch", "yaw", "roll")
    ]
    head = ["axis, deg", "paper", "put in", "here", "of it noise of the picture", "here / put in"]
    text = f"""
    Standard deviations of the camera's angles against a board on a wall, of {here["used"]} of
    {here["pictures"]} rendered thermal pictures at 10 a second. The true angles wander in pitch
    and roll as in the simulated flights, with Table 8's rms over the video (the standard deviation
    at the pictures' own instants, *put in*, differs a little), and swing in yaw with Table 8's
    standard deviation. A swing like that spans {here["span_deg"]["yaw"]:.0f} deg; the paper
    tells of a change of 30 deg, for which
    {fixed(TABLE_8_DEG["yaw"], 2)} deg is possible only if the camera was at either end nearly
    always. The comparison shows what the measurement adds, and nothing of a gimbal.
    """
    return f"{table(head, rows)}\n\n{words(text)}"


def table_9(_amounts: Amounts) -> Section:
    """The lens."""
    line = f"tirgeo calibrate lens {_FOLDER}/lens {_BOARD} -o {WORK}/camera.yaml"
    return Section("Table 9: the thermal lens", [Run("lens", line)], _tell_9)


def _tell_9(found: Results) -> str:
    here = found["lens"]
    truth = dict(zip(_LENGTHS, (XT2.fx, XT2.fy, XT2.cx, XT2.cy), strict=True))
    truth |= dict(zip(("k1", "k2", "p1", "p2"), XT2.distortion, strict=True))
    rows = []
    for name, value in here["parameters"].items():
        unit, digits = (", px", 2) if name in _LENGTHS else ("", 5)
        sigma = here["sigma"][name]
        cells = [fixed(TABLE_9[name], 4), fixed(value, digits), fixed(sigma, digits)]
        rows.append([f"{name}{unit}", *cells, f"{(value - truth[name]) / sigma:+.1f}"])
    head = ["parameter", "paper, and put in", "here", "sigma", "off by, sigmas"]
    text = f"""
    {here["views"]} of {here["pictures"]} rendered views were used
    ({len(here["refused"])} refused, each with its reason); they cover
    {100 * here["covered_share"]:.0f} % of the picture. Reprojection error:
    {fixed(here["reprojection_mean_px"], 3)} px in the mean and
    {fixed(here["reprojection_worst_view_px"], 3)} px in the worst view, where the paper has
    {_PAPER_MEAN_PX} px in the mean and {_PAPER_LARGEST_PX} px at most. The renderer blurs the foil
    board, lets squares differ and adds noise, but its board is flat, its squares are square, its
    foil has no ragged edges that bleed heat, and its lens follows the very model that is fitted.
    A real calibration has the paper's tenths of a pixel.
    """
    return f"{table(head, rows)}\n\n{words(text)}"

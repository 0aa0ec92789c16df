"""The whole page."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from dev.paper_tables import TABLE_2_M, TABLE_9
from dev.reproduction.boards import table_8, table_9
from dev.reproduction.budget import table_1, table_2
from dev.reproduction.ground import table_6, table_7
from dev.reproduction.imu import table_5
from dev.reproduction.markdown import fixed, words
from dev.reproduction.mounting import mounting
from dev.reproduction.script import WORK, Results, carry_out
from dev.reproduction.sections import SCENARIO, Amounts, Section
from tirgeo_ros.core.camera.camera_model import XT2
from tirgeo_ros.tools.simulate.scenario import Scenario

PARTS: Sequence[Callable[[Amounts], Section]] = (
    table_1,
    table_2,
    table_5,
    table_6,
    mounting,
    table_7,
    table_8,
    table_9,
)
_TILT_RAD = math.radians(-Scenario().gimbal.pitch_deg)
#: The first line of every page; a page that lacks it is another program's.
HEAD = "<!-- Written by: make reproduction (python -m dev.reproduction) -->"


def page(amounts: Amounts, work: Path) -> str:
    """Carry out every command in ``work`` and tell of it, in Markdown. Raises TirgeoError."""
    work.mkdir(parents=True, exist_ok=True)
    found: Results = {}
    texts = []
    for part in PARTS:
        section = part(amounts)
        found = {**found, **carry_out(section.steps, work)}
        texts.append(section.text(found))
    return "\n\n".join([HEAD, words(_introduction()), *texts, _ending()]) + "\n"


def _introduction() -> str:
    scenario = Scenario()
    route, rtk, heading, gps = scenario.route, scenario.rtk, scenario.heading, scenario.gps
    video = scenario.video
    east_m, north_m = rtk.position_sigma_m[1], rtk.position_sigma_m[0]
    return f"""
# The paper's tables, reproduced in simulation

Ren et al., *An AR Geo-Registration Algorithm for UAV TIR Video Streams Based on Dual-Antenna
RTK-GPS*, Remote Sensing 2022, 14, 2205, has nine tables. Tables 3 and 4 are data sheets. The
others stand below beside what this package's commands give. The authors' recordings are not
public: ours are simulated, and every number in a column *here* was computed from them by the
commands above its table.

The flight is `{SCENARIO}`: {scenario.duration_s:.0f} s at {route.speed_m_s:.0f} m/s,
{route.height_above_ground_m:.0f} m above level ground, camera
{-scenario.gimbal.pitch_deg:.0f} degrees down. Its errors:

- IMU at {scenario.imu.rate_hz:.0f} Hz with the noise of Table 5 and a turn-on bias of
  {scenario.imu.gyro_turn_on_bias_rad_s:g} rad/s and {scenario.imu.accel_turn_on_bias_m_s2:g} m/s²;
- RTK at {rtk.rate_hz:.0f} Hz, always fixed, white noise of {100 * max(north_m, east_m):.0f} cm
  level and {100 * rtk.position_sigma_m[2]:.0f} cm in height; its two antennas' heading with
  {heading.sigma_deg:g} deg of noise, in steps of {heading.step_deg:g} deg;
- ordinary GPS with Table 1's rms, changing over {gps.position_time_s:.0f} s; the autopilot's
  heading with Table 1's rms, its roll and pitch with {scenario.autopilot.tilt_rms_deg[0]:g} deg;
- a gimbal that wanders in roll and pitch by Table 8 without reporting it, and encoders with
  {scenario.gimbal.encoder_sigma_deg:g} deg of noise that see it;
- the lens of Table 9, a video {1e3 * video.latency_s:.0f} ms late, clicks off by
  {scenario.survey.click_sigma_px:g} px, points surveyed to {100 * scenario.survey.sigma_m[0]:.0f}
  cm.

What a simulation can show: that the method and the software do what they say; the order of the
methods and the size of their gains under stated errors of the sensors; what errors, of those
stated, are left. What it cannot show is at the end of this page.

From the project's folder after `make setup`; `tirgeo` and `python` are those of `.venv/bin`, and
`mkdir -p {WORK}` comes first. `make reproduction` does all of it and writes this page anew; seeds
are fixed, so that the numbers come out the same.
"""


def _ending() -> str:
    return "\n\n".join(
        [
            "## Errata of the paper that were heeded here",
            words(f"""
- Eq. 15 and Eq. 21 measure the angle alpha differently: from the nadir with the picture's y
  upward in the one, below the horizon with y downward in the other. Each is used with its own.
- The second row of Eq. 15 has the sign of x_im wrong: as printed, its two rows are a rotation
  only where the heading is a multiple of 90 degrees. It is mended in
  `tirgeo_ros/core/accuracy/error_budget.py` and held against rotation matrices by a test.
- Table 2 gives {fixed(TABLE_2_M["CamHeight"], 4)} m and {fixed(TABLE_2_M["CamYaw"], 4)} m as means
  over the field of view, without saying with which principal point. Table 9's
  ({TABLE_9["cx"]}, {TABLE_9["cy"]}) is not the middle of {XT2.width} x {XT2.height} pixels, which
  the derivation takes for the origin. Both are shown.
- Table 5 gives correlation "cycles" without a unit; they are taken as seconds.
- Table 7 prints p-values below 0.0001 as 0.0001.
"""),
            "## What a simulation cannot show",
            words(f"""
- Errors of real sensors beyond the model: vibration, temperature, scale factors and misaligned
  axes of the IMU, magnetic disturbance of the autopilot. The filter here knows the noise that it
  is up against; in the field it knows a calibration of it.
- A real gimbal: play and bending, encoders that are not zero where they say, a mount that gives
  way. Only a constant mounting error and Table 8's wander are simulated.
- Multipath and lost fixes of a real D-RTK beside trees and houses, antennas whose phase centres
  move, a baseline that was not measured to the degree. `test/scenario` fails sensors one by one,
  but by a model too.
- A video link whose delay varies from frame to frame. Here it is constant.
- Corners in real thermal pictures: low contrast, heat that spreads, rolling gain. The rendered
  board is kinder than any real one.
- An operator's clicks: half a pixel of noise without habit or blunder, on corners that are
  corners. Real ones may be wrong by a flower bed.
- The ground: level here, to the centimetre. An elevation model that is wrong by 1 m moves a
  point in the middle of the picture by {1 / math.tan(_TILT_RAD):.1f} m at this tilt.

So the tables say what the software does with errors of known size. How large the errors of an
aircraft are, its own recordings must tell: `tirgeo budget`, `calibrate` and `evaluate` take them
in the place of the simulated ones, by the same commands.
"""),
        ]
    )

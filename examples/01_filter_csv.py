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
"""Filter a flight that a logger of your own wrote as CSV; draw the heading and its sigma.

Run it in any folder: ``.venv/bin/python examples/01_filter_csv.py`` writes ``heading.png`` into
``examples_output`` there.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd

import tirgeo_ros

SAMPLE = Path(__file__).resolve().parents[1] / "bags" / "sample"
OUTPUT = Path("examples_output")  # in the folder where you run this
LOGGED = {
    "imu/data": "imu.csv",
    "rtk/fix": "fix.csv",
    "rtk/vel": "vel.csv",
    "rtk/heading": "heading.csv",
}


def log_csv() -> None:
    """Write CSV files as a logger might: seconds of Unix time, degrees. Yours exist already."""
    for topic, name in LOGGED.items():
        frame = pd.DataFrame(tirgeo_ros.read_bag(SAMPLE / "flight.mcap", [topic])[topic])
        stamps = frame.pop("stamp_ns")
        frame.insert(0, "time_s", [f"{ns // 10**9}.{ns % 10**9:09d}" for ns in stamps])
        for angle in ("latitude", "longitude", "heading"):
            if f"{angle}_rad" in frame:
                frame[f"{angle}_deg"] = np.degrees(frame.pop(f"{angle}_rad"))
        frame.drop(columns=["arrival_ns", "arrival_order"]).to_csv(OUTPUT / name, index=False)


def read_csv(name: str) -> pd.DataFrame:
    """Read a file; seconds become whole nanoseconds, from text, for a float has too few digits."""
    frame = pd.read_csv(OUTPUT / name, dtype={"time_s": str})
    seconds, nanoseconds = frame.pop("time_s").str.split(".", expand=True).to_numpy(np.int64).T
    return frame.assign(stamp_ns=seconds * 10**9 + nanoseconds)


def main() -> None:
    """Filter the files and draw."""
    OUTPUT.mkdir(exist_ok=True)
    log_csv()
    imu, fix, velocity, heading = (read_csv(name) for name in LOGGED.values())
    flight = tirgeo_ros.filter_flight(
        imu, rtk_fix=fix, rtk_velocity=velocity, heading=heading, config=SAMPLE / "params.yaml"
    )
    table = flight.table  # a data frame, as the IMU's was one
    seconds = (table["stamp_ns"] - table["stamp_ns"].iloc[0]) * 1e-9
    figure, (above, below) = plt.subplots(2, sharex=True, layout="constrained")
    above.plot(seconds, np.degrees(table["heading_rad"]) % 360)
    above.set_ylabel("heading, deg")
    below.plot(seconds, np.degrees(table["sigma_heading_rad"]))
    below.set(ylabel="its sigma, deg", xlabel="time, s")
    figure.savefig(OUTPUT / "heading.png", dpi=110)
    print(f"{len(flight)} solutions, state {flight.state}, {flight.verdicts['rtk_heading']}")


if __name__ == "__main__":
    main()

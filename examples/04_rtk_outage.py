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
"""Take RTK away from the sample flight for some seconds; compare the filter's error and sigma.

Run it in any folder: it writes ``outage.png`` into ``examples_output`` there. The truth of the
flight, which is simulated, is in ``truth.mcap``.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import tirgeo_ros

SAMPLE = Path(__file__).resolve().parents[1] / "bags" / "sample"
OUTPUT = Path("examples_output")  # in the folder where you run this
FROM_S, UNTIL_S = 12.0, 20.0


def filtered(bag: dict, first_ns: int, *, outage: bool) -> tirgeo_ros.FilteredFlight:
    """Filter the flight with all of RTK, or without what was measured during the outage."""
    given = {}
    for name, topic in (
        ("rtk_fix", "rtk/fix"),
        ("rtk_velocity", "rtk/vel"),
        ("heading", "rtk/heading"),
    ):
        seconds = (bag[topic]["stamp_ns"] - first_ns) * 1e-9
        kept = (seconds < FROM_S) | (seconds > UNTIL_S) | (not outage)
        given[name] = {column: values[kept] for column, values in bag[topic].items()}
    return tirgeo_ros.filter_flight(bag["imu/data"], **given, config=SAMPLE / "params.yaml")


def main() -> None:
    """Filter twice, compare with the truth and draw."""
    bag = tirgeo_ros.read_bag(SAMPLE / "flight.mcap")
    truth = tirgeo_ros.read_bag(SAMPLE / "truth.mcap", ["tirgeo/odometry"])["tirgeo/odometry"]
    first_ns = bag["imu/data"]["stamp_ns"][0]
    figure, axes = plt.subplots(layout="constrained")
    for outage, colour in ((False, "tab:blue"), (True, "tab:orange")):
        flight = filtered(bag, first_ns, outage=outage)
        true_n = [
            np.interp(flight.stamp_ns, truth["stamp_ns"], truth[name])
            for name in ("north_m", "east_m", "down_m")
        ]
        error_m = np.linalg.norm(flight.position_n - np.transpose(true_n), axis=1)
        sigma_m = np.linalg.norm(flight.sigma[:, :3], axis=1)
        seconds = (flight.stamp_ns - first_ns) * 1e-9
        label = f"without RTK from {FROM_S:g} to {UNTIL_S:g} s" if outage else "with RTK"
        axes.plot(seconds, error_m, colour, linewidth=1, label=f"error {label}")
        axes.plot(seconds, sigma_m, colour, linewidth=1, linestyle="--", label=f"sigma {label}")
        worst = error_m.argmax()
        print(f"{label}: largest error {error_m[worst]:.2f} m, sigma then {sigma_m[worst]:.2f} m")
    axes.set(xlabel="time, s", ylabel="position, m", yscale="log")
    axes.legend()
    OUTPUT.mkdir(exist_ok=True)
    figure.savefig(OUTPUT / "outage.png", dpi=110)


if __name__ == "__main__":
    main()

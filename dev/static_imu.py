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
"""Write a record of the simulated IMU at rest, for ``tirgeo calibrate allan``.

``python -m dev.static_imu -o static.mcap --hours 5``
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dev.judging import exit_code
from tirgeo_ros.core.frames.rotations import flu_from_frd
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.bags.bag import BagWriter, Cdr
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.sensors import imu_bias, imu_white

_TYPE = "sensor_msgs/msg/Imu"
_BLOCK = 1 << 14  # messages made together
# Byte offsets of the numbers from a message's end: force, covariance (9); before them rate,
# covariance (9).
_FORCE_AT, _RATE_AT = -(3 + 9) * 8, -2 * (3 + 9) * 8


def write_static(path: Path, hours: float, scenario: Scenario, seed: int) -> int:
    """Write ``hours`` of an IMU that lies level; return the number of messages.

    The errors are those of the scenario's flights: white noise, a turn-on bias and Gauss-Markov
    biases. The Earth's rate is left out: it is constant, as the turn-on bias is. Raise BagError.
    """
    imu, site = scenario.imu, scenario.site
    count = round(hours * 3600 * imu.rate_hz)
    bias, white = imu_bias(imu, seed, count), imu_white(imu, seed, count)
    gravity = gravity_down(np.radians(site.latitude_deg), site.ground_height_m)
    rate_b, force_b = bias.gyro_b + white[0], bias.accel_b + white[1] - [0.0, 0.0, gravity]
    with BagWriter(path) as bag:
        for first in range(0, count, _BLOCK):
            some = slice(first, min(first + _BLOCK, count))
            steps = np.arange(some.start, some.stop)
            stamps = scenario.start_ns + np.rint(steps * (1e9 / imu.rate_hz)).astype(np.int64)
            values = np.hstack([flu_from_frd(rate_b[some]), flu_from_frd(force_b[some])])
            write_imu(bag, stamps, values)
    return count


def write_imu(bag: BagWriter, stamps_ns: IntArray, values: Array) -> None:
    """Write messages of ``/imu/data``: stamps (n,), rates and specific forces (n, 6) FLU.

    They are made from one template by replacing stamps and numbers. The log times are the stamps,
    but never earlier than that of the message before.
    """
    cdr = Cdr()
    template = Messages().imu(ImuSample(0, np.zeros(3), np.zeros(3), None))
    rows = np.tile(np.frombuffer(cdr.serialize(template, _TYPE), np.uint8), (len(stamps_ns), 1))
    seconds = np.stack(np.divmod(stamps_ns, 1_000_000_000), -1)
    rows[:, 4:12] = seconds.astype("<u4").view(np.uint8)
    numbers = np.ascontiguousarray(values, "<f8").view(np.uint8)
    rows[:, _RATE_AT : _RATE_AT + 24] = numbers[:, :24]
    rows[:, _FORCE_AT : _FORCE_AT + 24] = numbers[:, 24:]
    logs_ns = np.maximum.accumulate(stamps_ns).tolist()
    for log_ns, row in zip(logs_ns, rows, strict=True):
        bag.write("/imu/data", _TYPE, row.tobytes(), log_ns)


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command's arguments."""
    made = argparse.ArgumentParser(prog="python -m dev.static_imu", description=__doc__)
    made.add_argument("-o", "--output", type=Path, metavar="OUT.mcap", required=True)
    made.add_argument("--hours", type=float, default=5.0, help="default: %(default)g")
    return made


def run(args: argparse.Namespace) -> dict[str, object]:
    """Write the record; return the number of messages. Raise BagError."""
    scenario = Scenario()
    return {"messages": write_static(args.output, args.hours, scenario, scenario.seed)}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command."""
    args = parser().parse_args(argv)
    return exit_code("static_imu", lambda: 0 if run(args) else 1)


if __name__ == "__main__":
    sys.exit(main())

"""Write a record of the simulated IMU at rest, for ``tirgeo calibrate allan``.

``python -m tirgeo_ros.tools.simulate.static_imu -o static.mcap --hours 5``
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from tirgeo_ros.core.frames.axes import flu_from_frd
from tirgeo_ros.core.frames.wgs84 import gravity_down
from tirgeo_ros.core.types.arrays import Array, IntArray
from tirgeo_ros.core.types.errors import ScenarioError, TirgeoError
from tirgeo_ros.core.types.measurements import ImuSample
from tirgeo_ros.io.bags.bag import BagWriter, Cdr
from tirgeo_ros.io.files.whole_files import made_folder
from tirgeo_ros.io.messages import Messages
from tirgeo_ros.tools.presentation.progress import Progress, Report, silent
from tirgeo_ros.tools.simulate.scenario import Scenario, load_scenario
from tirgeo_ros.tools.simulate.sensors import imu_bias, imu_white

_TOPIC, _TYPE = "/imu/data", "sensor_msgs/msg/Imu"
_BLOCK = 1 << 14  # messages made together
# Byte offsets of the numbers from a message's end: force, covariance (9); before them rate,
# covariance (9).
_FORCE_AT, _RATE_AT = -(3 + 9) * 8, -2 * (3 + 9) * 8


def write_static(
    path: Path, hours: float, scenario: Scenario, seed: int, progress: Report = silent
) -> int:
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
            progress(some.stop / imu.rate_hz, count / imu.rate_hz)
    return count


def write_imu(
    bag: BagWriter, stamps_ns: IntArray, values: Array, frame: str = "base_link"
) -> None:
    """Write messages of ``/imu/data``: stamps (n,), rates and specific forces (n, 6) FLU.

    The log times are the stamps, but never earlier than that of the message before.
    """
    logs_ns = np.maximum.accumulate(stamps_ns).tolist()
    for log_ns, message in zip(logs_ns, _messages(stamps_ns, values, frame), strict=True):
        bag.write(_TOPIC, _TYPE, message, log_ns)


def _messages(stamps_ns: IntArray, values: Array, frame: str) -> list[bytes]:
    """Return messages in CDR, made from one template by replacing stamps and numbers."""
    cdr = Cdr()
    template = Messages(cdr.types).imu(ImuSample(0, np.zeros(3), np.zeros(3), None))
    template.header.frame_id = frame
    rows = np.tile(np.frombuffer(cdr.serialize(template, _TYPE), np.uint8), (len(stamps_ns), 1))
    seconds = np.stack(np.divmod(stamps_ns, 1_000_000_000), -1)
    rows[:, 4:12] = seconds.astype("<u4").view(np.uint8)
    numbers = np.ascontiguousarray(values, "<f8").view(np.uint8)
    rows[:, _RATE_AT : _RATE_AT + 24] = numbers[:, :24]
    rows[:, _FORCE_AT : _FORCE_AT + 24] = numbers[:, 24:]
    return [row.tobytes() for row in rows]


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command's arguments."""
    made = argparse.ArgumentParser(
        prog="python -m tirgeo_ros.tools.simulate.static_imu", description=__doc__
    )
    made.add_argument("-o", "--output", type=Path, metavar="OUT.mcap", required=True)
    made.add_argument("--hours", type=float, default=5.0, help="default: %(default)g")
    made.add_argument("--scenario", type=Path, metavar="YAML", help="default: the paper's flight")
    made.add_argument("--seed", type=int, metavar="N", help="instead of the scenario's")
    return made


def run(args: argparse.Namespace) -> dict[str, object]:
    """Write the record. Raise ScenarioError, BagError."""
    scenario = Scenario() if args.scenario is None else load_scenario(args.scenario)
    seed = scenario.seed if args.seed is None else args.seed
    if not 0 < args.hours <= 1000 or seed < 0:
        raise ScenarioError("--hours must be above 0 and at most 1000, --seed 0 or more")
    made_folder(args.output.parent, ScenarioError)
    with Progress("writing", unit="s") as bar:
        count = write_static(args.output, args.hours, scenario, seed, bar)
    return {"output": str(args.output), "messages": count, "hours": args.hours, "seed": seed}


def main(argv: Sequence[str] | None = None) -> None:
    """Run the command."""
    try:
        result = run(parser().parse_args(argv))
    except TirgeoError as error:
        sys.exit(f"static_imu: {error}")
    sys.stdout.write(f"{result['messages']} messages: {result['output']}\n")


if __name__ == "__main__":
    main()

"""The cost of ``tirgeo calibrate allan`` over five hours at 100 Hz, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tirgeo_ros.core.sample_grid import Stamps
from tirgeo_ros.core.samples import Array
from tirgeo_ros.io.bag import BagReader, BagWriter, Cdr

_HOURS, _RATE_HZ = 5.0, 100.0
_BLOCK = 1 << 14
_TYPE = "sensor_msgs/msg/Imu"
_WHITE = (1.7e-4, 1.3e-2)  # rad/sqrt(s), m/s/sqrt(s)
_GRAVITY = 9.8
_SCRIPT = """\
import json, resource, sys
from tirgeo_ros.tools.calibrate_allan import calibrate_allan
found = calibrate_allan(sys.argv[1], sys.argv[2])
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps({"samples": found["samples"], "peak": peak}))
"""


class AllanCost(NamedTuple):
    """Of one run."""

    samples: int
    duration_s: float  # start of the process to its end
    reading_s: float  # bytes of the file alone, unpacked message by message
    peak_mib: float


def allan_cost(work: Path, hours: float = _HOURS) -> AllanCost:
    """Write a bag of so many hours into ``work`` and calibrate from it."""
    bag = work / "still.mcap"
    write_still(bag, round(hours * 3600 * _RATE_HZ))
    begun = time.perf_counter()
    run = subprocess.run(  # noqa: S603 this very Python
        [sys.executable, "-c", _SCRIPT, bag, work / "imu.yaml"],
        capture_output=True,
        text=True,
        check=True,
    )
    duration_s = time.perf_counter() - begun
    found = json.loads(run.stdout)
    return AllanCost(found["samples"], duration_s, _reading(bag), found["peak"] / 1024)


def write_still(path: Path, samples: int, seed: int = 1) -> None:
    """A bag of an IMU at rest: white noise alone, as its amount of work is that of any."""
    rng = np.random.default_rng(seed)
    step_ns = round(1e9 / _RATE_HZ)
    with BagWriter(path) as bag:
        for first in range(0, samples, _BLOCK):
            number = min(_BLOCK, samples - first)
            values = rng.standard_normal((number, 6)) * np.repeat(_WHITE, 3) * _RATE_HZ**0.5
            values[:, 5] += _GRAVITY
            write_imu(bag, np.arange(first + 1, first + number + 1) * step_ns, values)


def write_imu(bag: BagWriter, stamps_ns: Stamps, values: Array, frame: str = "base_link") -> None:
    """Messages of ``/imu/data``: stamps (n,), rates and specific forces (n, 6) FLU.

    Logged as they come: at their stamps, but never before the one before.
    """
    template = _template(Cdr(), frame)
    logs_ns = np.maximum.accumulate(stamps_ns).tolist()
    for log_ns, stamp_ns, row in zip(logs_ns, stamps_ns.tolist(), values, strict=True):
        bag.write("/imu/data", _TYPE, _message(template, stamp_ns, row), log_ns)


def _template(cdr: Cdr, frame: str) -> bytes:
    kinds = {
        name: cdr.types(f"{package}/msg/{name}")
        for package, name in (
            ("std_msgs", "Header"),
            ("builtin_interfaces", "Time"),
            ("geometry_msgs", "Quaternion"),
            ("geometry_msgs", "Vector3"),
        )
    }
    header = kinds["Header"](kinds["Time"](0, 0), frame)
    zero, covariance = kinds["Vector3"](0.0, 0.0, 0.0), np.zeros(9)
    turn = kinds["Quaternion"](0.0, 0.0, 0.0, 1.0)
    parts = (header, turn, covariance, zero, covariance, zero, covariance)
    return cdr.serialize(cdr.types(_TYPE)(*parts), _TYPE)


def _message(template: bytes, stamp_ns: int, row: Array) -> bytes:
    """The template with another stamp and other numbers, which stand before two covariances."""
    made = bytearray(template)
    made[4:12] = np.array(divmod(stamp_ns, 1_000_000_000), "<u4").tobytes()
    values = row.astype("<f8").tobytes()
    made[-192:-168], made[-96:-72] = values[:24], values[24:]
    return bytes(made)


def _reading(path: Path) -> float:
    begun = time.perf_counter()
    for _ in BagReader(path).messages():
        pass
    return time.perf_counter() - begun


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        sys.stdout.write(f"{allan_cost(Path(folder))}\n")

"""The cost of ``tirgeo calibrate allan`` over five hours at 100 Hz, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.child_python import python_command
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.static_imu import write_static

_HOURS = 5.0
_SCRIPT = """\
import json, resource
from tirgeo_ros.tools.calibrate.allan import calibrate_allan
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
    write_static(bag, hours, Scenario(), seed=1)
    begun = time.perf_counter()
    run = subprocess.run(  # noqa: S603 this very Python
        python_command(_SCRIPT, str(bag), str(work / "imu.yaml")),
        capture_output=True,
        text=True,
        check=True,
    )
    duration_s = time.perf_counter() - begun
    found = json.loads(run.stdout)
    return AllanCost(found["samples"], duration_s, _reading(bag), found["peak"] / 1024)


def _reading(path: Path) -> float:
    begun = time.perf_counter()
    for _ in BagReader(path).messages():
        pass
    return time.perf_counter() - begun


if __name__ == "__main__":
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        sys.stdout.write(f"{allan_cost(Path(folder))}\n")

"""The cost of ``tirgeo calibrate allan`` over five hours at 100 Hz, in a process of its own."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

from dev.judging import Figure
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.files.child_python import python_command
from tirgeo_ros.tools.simulate.scenario import Scenario
from tirgeo_ros.tools.simulate.static_imu import write_static

_HOURS = 5.0
_SCRIPT = """\
import json, resource
from tirgeo_ros.tools.calibrate.allan import calibrate_allan
calibrate_allan(sys.argv[1], sys.argv[2])
peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps({"peak": peak}))
"""


def allan_cost(work: Path) -> list[Figure]:
    """Write a bag into ``work`` and calibrate from it, beside reading that bag and no more."""
    bag = work / "still.mcap"
    write_static(bag, _HOURS, Scenario(), seed=1)
    begun = time.perf_counter()
    run = subprocess.run(  # noqa: S603 this very Python
        python_command(_SCRIPT, str(bag), str(work / "imu.yaml")),
        capture_output=True,
        text=True,
        check=True,
    )
    duration_s = time.perf_counter() - begun
    peak_mib = json.loads(run.stdout)["peak"] / 1024
    begun = time.perf_counter()
    for _ in BagReader(bag).messages():
        pass
    reading_s = time.perf_counter() - begun
    return [
        Figure("calibrate allan, 5 h at 100 Hz", duration_s, "s", "<= 90"),
        Figure("calibrate allan: reading alone", reading_s, "s"),
        Figure("calibrate allan: whole over reading", duration_s / reading_s, "ratio"),
        Figure("calibrate allan: memory", peak_mib, "MiB", "<= 1000"),
    ]

"""The flight of the soak: a figure eight whose end meets its start, with truth."""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from tirgeo_ros.core.types.errors import ScenarioError
from tirgeo_ros.core.types.poses import CameraPose
from tirgeo_ros.io.bags.bag import BagReader
from tirgeo_ros.io.bags.bag_writer import BagWriter
from tirgeo_ros.io.bags.cdr import header_stamp_ns
from tirgeo_ros.tools.graph import find_resource
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.replay.graph_outputs import read_outputs
from tirgeo_ros.tools.simulate import simulate

SCENARIO = "config/scenarios/soak_flight.yaml"
#: From rest to rest: the trajectory's spline has forgotten its begin, and the eight is flown.
START_S, PERIOD_S = 6.0, 50.0


@dataclass(frozen=True)
class SoakFlight:
    """A folder as ``tirgeo simulate`` leaves it, and its true camera poses."""

    folder: Path
    start_ns: int
    cameras: dict[int, CameraPose]  # by time (ns) since the start of the round

    @property
    def bag(self) -> Path:
        """What the aircraft says in one round."""
        return self.folder / "flight.mcap"

    @property
    def period_ns(self) -> int:
        """The time of one round."""
        return round(PERIOD_S * 1e9)

    def write_rounds(self, path: Path, duration_s: float) -> Path:
        """Write a bag of rounds, one after the other, for so long at least; return its path."""
        end_ns = self.start_ns + self.period_ns
        flown = [one for one in BagReader(self.bag).messages() if one.log_time_ns < end_ns]
        with BagWriter(path) as bag:
            for shift_ns in range(0, round(duration_s * 1e9), self.period_ns):
                for one in flown:
                    data = stamped(one.data, header_stamp_ns(one.data) + shift_ns)
                    bag.write(one.topic, one.typename, data, one.log_time_ns + shift_ns)
        return path


def make_flight(
    folder: Path, progress: Report = silent, scenario: Path | None = None
) -> SoakFlight:
    """Simulate the flight into a folder, or another scenario that ends where it begins.

    Raises ScenarioError where it is not installed.
    """
    scenario = scenario or find_resource(SCENARIO)
    if scenario is None:
        raise ScenarioError(f"{SCENARIO} is not installed")
    simulate(scenario, folder, start_s=START_S, duration_s=PERIOD_S, progress=progress)
    truth = read_outputs(folder / "truth.mcap")
    start_ns = BagReader(folder / "flight.mcap").span_ns[0]
    assert truth.plane is not None
    cameras = {pose.stamp_ns - start_ns: pose for pose in truth.cameras}
    return SoakFlight(folder, start_ns, cameras)


def stamped(data: bytes | bytearray, stamp_ns: int) -> bytes:
    """Return CDR bytes of a message that begins with a header, under another stamp."""
    given = bytearray(data)
    struct.pack_into("<iI" if data[1] else ">iI", given, 4, *divmod(stamp_ns, 1_000_000_000))
    return bytes(given)

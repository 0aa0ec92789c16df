"""Simulate the flights of a fleet: one route for all, each with its own place and heading."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.types.arrays import Array
from tirgeo_ros.io.bags.bag import BagWriter, Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages, sensed
from tirgeo_ros.tools.presentation.progress import Report, silent
from tirgeo_ros.tools.simulate.files import parameters_text
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario, scenario_from

#: From one aircraft to the next (deg of latitude), 200 m: far more than any error of position.
APART_DEG = 0.0018
#: The golden angle: no two of a fleet head the same way.
_TURNED_DEG = 137.5


@dataclass(frozen=True)
class FleetFlight:
    """Hold one aircraft's flight and truth, N IMU samples long."""

    number: int  # from 1
    bag: Path
    params: Path
    stamp_ns: list[int]  # (N,)
    place_e: Array  # (N, 3) true position of base_link, earth-fixed, m

    @property
    def name(self) -> str:
        """Return the aircraft's namespace, without the slash."""
        return f"uav{self.number}"


def make_fleet(
    folder: Path, aircraft: int, seconds: float, progress: Report = silent
) -> list[FleetFlight]:
    """Simulate the flights; write each as ``uavN.mcap`` with its parameters ``uavN.yaml``."""
    folder.mkdir(parents=True, exist_ok=True)
    found = []
    for number in range(1, aircraft + 1):
        flight = fly(_scenario(number, seconds))
        bag, params = folder / f"uav{number}.mcap", folder / f"uav{number}.yaml"
        _write(flight, bag)
        params.write_text(parameters_text(flight.scenario))
        truth = flight.truth
        place_e = ecef_from_geodetic(truth.latitude_rad, truth.longitude_rad, truth.height_m)
        found.append(FleetFlight(number, bag, params, truth.stamp_ns, np.asarray(place_e)))
        progress(number, aircraft)
    return found


def _scenario(number: int, seconds: float) -> Scenario:
    given = Scenario()
    return scenario_from(
        {
            "seed": given.seed + number,
            "duration_s": seconds,
            "site.latitude_deg": given.site.latitude_deg + APART_DEG * number,
            "route.heading_deg": (_TURNED_DEG * number) % 360.0,
        }
    )


def _write(flight: SimulatedFlight, path: Path) -> None:
    messages = Messages(Cdr().types)
    with BagWriter(path) as writer:
        for arrival_ns, sample in flight.samples:
            topic, message = sensed(messages, sample)
            writer.write(f"/{topic}", TOPIC_TYPES[topic], message, arrival_ns)

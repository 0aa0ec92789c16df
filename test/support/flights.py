"""Flights for tests of the filter; what is done with them is in ``dev/flight_errors.py``."""

from __future__ import annotations

import functools
from dataclasses import replace

from dev.flight_errors import NAVIGATION_SAMPLES, Errors, errors, navigation_samples, solutions
from dev.flight_errors import fitting_config as config_for
from tirgeo_ros.core.accuracy.ground_errors import rms
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, fly
from tirgeo_ros.tools.simulate.scenario import Scenario

__all__ = (
    "NAVIGATION_SAMPLES",
    "Errors",
    "config_for",
    "errors",
    "flight",
    "navigation_samples",
    "rms",
    "solutions",
)


@functools.lru_cache(maxsize=8)
def flight(
    seed: int | None = None, duration_s: float = 107.0, shape: str = "lawnmower"
) -> SimulatedFlight:
    """A flight of the paper's scenario, cut short."""
    base = Scenario()
    return fly(replace(base, duration_s=duration_s, route=replace(base.route, shape=shape)), seed)

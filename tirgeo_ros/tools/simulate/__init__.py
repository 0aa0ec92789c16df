"""Simulate a flight with truth: trajectory, sensors, pictures, map, survey.

``fly`` returns a flight in memory, ``simulate`` writes one to files.
"""

from tirgeo_ros.tools.simulate.files import simulate
from tirgeo_ros.tools.simulate.flight import SimulatedFlight, Truth, fly
from tirgeo_ros.tools.simulate.scenario import Scenario, load_scenario, scenario_from

__all__ = [
    "Scenario",
    "SimulatedFlight",
    "Truth",
    "fly",
    "load_scenario",
    "scenario_from",
    "simulate",
]

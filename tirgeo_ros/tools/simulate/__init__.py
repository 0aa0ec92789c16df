"""Simulate a flight with truth: trajectory, sensors, pictures, map, survey."""

from tirgeo_ros.tools.simulate.files import simulate
from tirgeo_ros.tools.simulate.flight import fly
from tirgeo_ros.tools.simulate.scenario import scenario_from

__all__ = ["fly", "scenario_from", "simulate"]

"""Interpret the aircraft's readings: readings in, the core's samples out.

Only this package knows the meaning of its flags, heights, units, repeats and reference directions.
"""

from tirgeo_ros.dji.interpret.interpreter import Interpreter

__all__ = ["Interpreter"]

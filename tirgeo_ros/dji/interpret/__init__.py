"""Convert the aircraft's readings to the core's samples.

Only this package knows the meaning of its flags, heights, units, repeats and reference directions.
"""

from tirgeo_ros.dji.interpret.interpreter import Interpreter

__all__ = ["Interpreter"]

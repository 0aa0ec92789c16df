"""What the aircraft's readings mean: readings in, the core's samples out.

Here alone is known what its flags, heights, units, repeats and reference directions stand for.
"""

from tirgeo_ros.dji.interpret.interpreter import Interpreter

__all__ = ["Interpreter"]

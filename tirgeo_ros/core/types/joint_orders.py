"""Name the orders in which a gimbal's three joints may follow each other, aircraft to camera.

Apart from the measurements: the command line offers the orders, and loads no NumPy for its help.
"""

from __future__ import annotations

import itertools

JOINTS = ("yaw", "roll", "pitch")
#: Of the parameters ``joint_order``; the usual one first.
JOINT_ORDERS = tuple("-".join(order) for order in itertools.permutations(JOINTS))
USUAL_ORDER = JOINT_ORDERS[0]

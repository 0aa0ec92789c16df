"""Messages through CDR and back."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from tirgeo_ros.core.frames.rotations import canonical
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import Messages

# The only arithmetic between a sample and its twin is a rotation by 180 deg: a few roundings.
EXACT = 1e-14


cdr = Cdr()


made = Messages(cdr.types)


def through_cdr(message):
    typename = message.__msgtype__
    return cdr.deserialize(cdr.serialize(message, typename), typename)


def assert_same_rotation(p, q, tolerance=EXACT):
    p, q = canonical(p), canonical(q)
    # Of a half turn both signs are canonical.
    assert_allclose(p * np.sign(p @ q), q, rtol=0, atol=tolerance)

"""Located points to messages and back."""

from __future__ import annotations

import math

import message_samples as given
import numpy as np

from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.types.measurements import Source
from tirgeo_ros.io import messages
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import TOPIC_TYPES, Messages
from tirgeo_ros.io.messages.encode import UNKNOWN_VARIANCE

CDR = Cdr()
MADE = Messages(CDR.types)
COVARIANCE = given.covariance(3)
LOCATED = Located(
    given.STAMP_NS, (3.0, 4.0), np.array([1.0, 2.0, 3.0]), COVARIANCE, 0.55, -2.1, 123.4
)


def through_cdr(message, topic):
    typename = TOPIC_TYPES[topic]
    return CDR.deserialize(CDR.serialize(message, typename), typename)


def test_the_fix_is_the_place_with_its_covariance_in_enu():
    fix = through_cdr(MADE.located_fix(LOCATED), "tirgeo/locate/fix")
    assert messages.stamp_ns(fix) == given.STAMP_NS
    assert fix.header.frame_id == "map"
    np.testing.assert_allclose(
        [fix.latitude, fix.longitude, fix.altitude],
        [math.degrees(0.55), math.degrees(-2.1), 123.4],
    )
    covariance = fix.position_covariance.reshape(3, 3)
    assert fix.position_covariance_type == 3
    assert (covariance[0, 0], covariance[1, 1]) == (COVARIANCE[1, 1], COVARIANCE[0, 0])
    assert covariance[0, 2] == -COVARIANCE[1, 2]
    back = messages.position_sample(fix, Source.RTK_POSITION)
    np.testing.assert_array_equal(back.covariance_n, COVARIANCE)


def test_the_point_is_in_the_map_and_has_no_attitude():
    point = through_cdr(MADE.located_point(LOCATED), "tirgeo/locate/point")
    assert point.header.frame_id == "map"
    position = point.pose.pose.position
    assert (position.x, position.y, position.z) == (2.0, 1.0, -3.0)
    q = point.pose.pose.orientation
    assert (q.w, q.x, q.y, q.z) == (1.0, 0.0, 0.0, 0.0)
    covariance = point.pose.covariance.reshape(6, 6)
    assert covariance.diagonal()[3:].tolist() == [UNKNOWN_VARIANCE] * 3
    stamp_ns, point_n, covariance_n = messages.ground_point(point)
    assert stamp_ns == given.STAMP_NS
    np.testing.assert_array_equal(point_n, LOCATED.point_n)
    np.testing.assert_array_equal(covariance_n, COVARIANCE)

"""Answers to clicks, and targets, come back from their messages as they were."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from message_samples import LOCATED, PLANE, STAMP_NS, TARGET, covariance

from tirgeo_ros.core.camera.projection_covariance import ellipse_95
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import Reason
from tirgeo_ros.core.ground.ground_point import Refusal
from tirgeo_ros.core.types.errors import MessageError
from tirgeo_ros.io.bags.cdr import Cdr
from tirgeo_ros.io.messages import Messages, answer_item, click_answer, marked_places
from tirgeo_ros.io.messages.target_messages import MOST_TARGETS

MESSAGES = Messages(Cdr().types)


def answered(answer):
    return MESSAGES.diagnostics(STAMP_NS, [answer_item("/overlay_node", answer)])


def test_a_located_click_comes_back_to_the_last_digit():
    found = click_answer(answered(LOCATED))
    assert (found.stamp_ns, found.u, found.v, found.refused) == (STAMP_NS, 12.25, 200.5, "")
    place = found.latitude_deg, found.longitude_deg
    np.testing.assert_allclose(np.radians(place), [0.55, -2.1], rtol=1e-15)
    assert found.height_m == 99.5
    turn = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]])  # north, east, down to east, north, up
    enu = turn @ LOCATED.covariance_n @ turn
    np.testing.assert_array_equal(np.reshape(found.covariance_enu, (3, 3)), enu)


def test_a_refused_click_comes_back_with_its_reason():
    found = click_answer(answered(Refusal(STAMP_NS, (-5.0, 3.0), Reason.OUTSIDE_PICTURE)))
    assert found[:4] == (STAMP_NS, -5.0, 3.0, "the pixel is outside the picture")


@pytest.mark.parametrize(
    ("key", "value", "reason"),
    [
        ("latitude_deg", "nan", "position is not finite"),
        ("latitude_deg", "91.0", "out of range"),
        ("covariance_enu", "1.0 2.0", "covariance is not 9 numbers"),
        ("covariance_enu", " ".join(["inf"] * 9), "covariance is not 9 numbers"),
        ("u", "left", "no answer to a click"),
        (None, None, "no answer to a click"),
    ],
)
def test_an_answer_that_cannot_be_is_refused(key, value, reason):
    item = answer_item("/overlay_node", LOCATED)
    if key:
        item.values[key] = value
    else:
        item.values.clear()
    with pytest.raises(MessageError, match=reason):
        click_answer(MESSAGES.diagnostics(STAMP_NS, [item]))


def test_targets_come_back_with_place_covariance_and_label():
    flat = dataclasses.replace(TARGET, label="2 vehicle", covariance_n=np.diag([4.0, 1.0, 0.0]))
    message = MESSAGES.targets(PLANE, [TARGET, flat])
    for sent, found in zip([TARGET, flat], marked_places(message), strict=True):
        assert found.label == sent.label
        place = found.latitude_rad, found.longitude_rad, found.height_m
        sent_place = sent.latitude_rad, sent.longitude_rad, sent.height_m
        np.testing.assert_allclose(place, sent_place, rtol=1e-13)
        # One part of a thousand of a metre is the least semi-axis.
        np.testing.assert_allclose(found.covariance_n, sent.covariance_n, atol=1e-6)


def test_the_marker_is_the_95_percent_ellipsoid():
    """A viewer in ``map`` sees its greatest breadth where the covariance has its own."""
    level = dataclasses.replace(TARGET, covariance_n=np.diag([4.0, 1.0, 0.01]))
    shape = MESSAGES.targets(PLANE, [level]).markers[1]
    semi_axes, _ = ellipse_95(np.diag([4.0, 1.0]))
    breadths = sorted([shape.scale.x, shape.scale.y, shape.scale.z])
    np.testing.assert_allclose(breadths[:0:-1], 2 * semi_axes[0], rtol=1e-12)


def test_no_targets_delete_all():
    message = MESSAGES.targets(PLANE, [])
    assert [marker.action for marker in message.markers] == [3]
    assert marked_places(message) == []


def test_the_place_holds_whatever_plane_the_reader_has():
    """The message names its own plane's origin: no order of messages can displace a target."""
    other = TangentPlane(PLANE.latitude_rad + 1e-4, PLANE.longitude_rad - 1e-4, 20.0)
    (here,) = marked_places(MESSAGES.targets(PLANE, [TARGET]))
    (there,) = marked_places(MESSAGES.targets(other, [TARGET]))
    np.testing.assert_allclose(here.latitude_rad, there.latitude_rad, rtol=1e-13)
    np.testing.assert_allclose(here.height_m, there.height_m, atol=1e-6)


def spoilt(**fields):
    message = MESSAGES.targets(PLANE, [TARGET])
    for name, value in fields.items():
        part, _, inner = name.partition("__")
        setattr(getattr(message.markers[1], part), inner, value)
    return message


@pytest.mark.parametrize(
    "fields", [{"scale__x": np.nan}, {"scale__y": np.inf}], ids=["nan", "infinite"]
)
def test_targets_that_cannot_be_are_refused(fields):
    with pytest.raises(MessageError, match="target 1: scale or turn"):
        marked_places(spoilt(**fields))


def test_targets_without_their_plane_or_end_are_refused():
    message = MESSAGES.targets(PLANE, [TARGET])
    shape = message.markers[1]
    for markers in ([], [shape]):
        message.markers = markers
        with pytest.raises(MessageError, match="does not name the plane's origin"):
            marked_places(message)
    message = MESSAGES.targets(PLANE, [])
    message.markers[0].text = "30.5 here"
    with pytest.raises(MessageError, match="no origin of the plane"):
        marked_places(message)
    message = MESSAGES.targets(PLANE, [])
    message.markers += [shape] * (MOST_TARGETS + 1)
    with pytest.raises(MessageError, match=f"{MOST_TARGETS} can be drawn"):
        marked_places(message)


def test_long_names_are_cut():
    long = dataclasses.replace(TARGET, label="x" * 1000, covariance_n=covariance(3))
    (found,) = marked_places(MESSAGES.targets(PLANE, [long]))
    assert len(found.label) == 60

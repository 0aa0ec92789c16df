# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""A picture's packet by MISB ST 0601: its bytes, and the position that a receiver computes."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from klv_reader import SIGNED, UNSIGNED, by_klvdata, items_in, number_of, step_of, values_in
from klvdata.common import ber_encode
from pyproj import Transformer
from scenes import camera_pose

from tirgeo_ros.core.camera.known_cameras import XT2
from tirgeo_ros.core.camera.projection_covariance import CameraRates
from tirgeo_ros.core.config.overlay_parameters import ConfidenceConfig
from tirgeo_ros.core.frames.rotations import quat_from_euler
from tirgeo_ros.core.frames.tangent_plane import TangentPlane
from tirgeo_ros.core.ground.backprojection import locate
from tirgeo_ros.core.ground.frame_geometry import Sight
from tirgeo_ros.core.types.poses import BodyPose
from tirgeo_ros.io.video.frame_metadata import ITEMS, FrameMetadata, ber, packet

TIME_NS = 1_634_731_264_888_888_888
CONFIG = ConfidenceConfig()
METADATA = FrameMetadata(CONFIG)
GROUND_M = 150.0
CORNERS_UV = np.array([[-0.5, -0.5], [639.5, -0.5], [639.5, 511.5], [-0.5, 511.5]])
#: What the receiver of the check by projection may look at.
SEEN = (5, 6, 7, 13, 14, 75, 18, 19, 20)
TO_EARTH = Transformer.from_crs(4979, 4978, always_xy=True).transform
FROM_EARTH = Transformer.from_crs(4978, 4979, always_xy=True).transform
attitudes = st.tuples(
    st.floats(-180, 180),  # the camera's azimuth
    st.floats(-90, -30),
    st.floats(-15, 15),
    st.floats(-180, 180),  # the aircraft's heading
    st.floats(-19, 19),
    st.floats(-49, 49),
)
places = st.tuples(st.floats(-89.9, 89.9), st.floats(-180, 180), st.floats(20, 400))


def sight_at(lat_deg, lon_deg, above_m, attitude, ground_m=GROUND_M):
    yaw, elevation, roll, heading, pitch, tilt = attitude
    plane = TangentPlane(math.radians(lat_deg), math.radians(lon_deg), GROUND_M)
    pose = camera_pose([10.0, 20.0, -above_m], roll, elevation, yaw, 1e-6)
    q_nb = quat_from_euler(*np.radians([tilt, pitch, heading]))
    body = BodyPose(0, pose.position_n, q_nb, pose.covariance)
    return Sight(XT2, pose, plane, ground_m, body)


SIGHT = sight_at(48.2, 16.4, 80.0, (30.0, -50.0, 4.0, 10.0, -8.0, 12.0))


def turn(axis, angle_deg):
    """A rotation about x, y or z, written out."""
    s, c = math.sin(math.radians(angle_deg)), math.cos(math.radians(angle_deg))
    about = {"x": [[1, 0, 0], [0, c, -s], [0, s, c]], "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]]}
    return np.array(about.get(axis, [[c, -s, 0], [s, c, 0], [0, 0, 1]]))


def projected(values):
    """The ground at GROUND_M in the line of sight, latitude and longitude (deg), by PROJ."""
    lat, lon = math.radians(values[13]), math.radians(values[14])
    looking = turn("z", values[5]) @ turn("y", values[6]) @ turn("x", values[7])
    north, east, down = (looking @ turn("z", values[18]) @ turn("y", values[19]))[:, 0]
    axes = np.array(
        [
            [-math.sin(lat) * math.cos(lon), -math.sin(lon), -math.cos(lat) * math.cos(lon)],
            [-math.sin(lat) * math.sin(lon), math.cos(lon), -math.cos(lat) * math.sin(lon)],
            [math.cos(lat), 0.0, -math.sin(lat)],
        ]
    )
    ray = axes @ [north, east, down]
    camera = np.array(TO_EARTH(values[14], values[13], values[75]))
    way = (values[75] - GROUND_M) / down
    for _ in range(8):  # the ellipsoid bends away by millimetres
        longitude, latitude, height = FROM_EARTH(*(camera + way * ray))
        way += (height - GROUND_M) / down
    return np.array([latitude, longitude])


def apart(first, second):
    """Latitude and longitude of one place less those of another, deg."""
    result = np.asarray(first) - second
    result[..., 1] = (result[..., 1] + 180.0) % 360.0 - 180.0
    return result


@settings(max_examples=60)
@given(places, attitudes)
def test_a_receiver_s_own_projection_lands_on_the_frame_s_centre(place, attitude):
    values = values_in(METADATA.packet(TIME_NS, sight_at(*place, attitude)))
    result = projected(values)
    # Each item is right to half a step; what that moves the point by adds up at the worst.
    allowed = np.array([step_of(23) / 2, step_of(24) / 2]) + 1e-9
    for tag in SEEN:
        moved = projected(values | {tag: values[tag] + step_of(tag) / 2})
        allowed += 1.05 * np.abs(apart(moved, result))  # not quite linear
    assert (np.abs(apart(result, [values[23], values[24]])) <= allowed).all()
    assert values[78] == pytest.approx(GROUND_M, abs=step_of(78) / 2 + 1e-6)


@settings(max_examples=60)
@given(places, attitudes)
def test_corners_are_where_the_cameras_rays_meet_the_ground(place, attitude):
    sight = sight_at(*place, attitude)
    packet = METADATA.packet(TIME_NS, sight)
    values = values_in(packet)
    points_n, reasons = locate(XT2, sight.pose, CORNERS_UV, sight.plane, GROUND_M)
    if any(reasons):
        assert not values.keys() & {*range(82, 90), *range(26, 34)}
        return
    expected = np.degrees(np.stack(sight.plane.geodetic_from_ned(points_n)[:2], axis=1))
    corners = np.array([values[tag] for tag in range(82, 90)]).reshape(4, 2)
    off = np.abs(apart(corners, expected))
    assert (off <= np.array([step_of(82), step_of(83)]) / 2 + 1e-9).all()
    assert off.max() < 1e-6
    if 26 in values:
        offsets = np.array([values[tag] for tag in range(26, 34)]).reshape(4, 2)
        summed = np.array([values[23], values[24]]) + offsets
        # Half a step of the offset, and of each of the places that it is between.
        assert np.abs(apart(summed, corners)).max() <= step_of(26) / 2 + step_of(24)
    by_klvdata(packet)


def test_offsets_across_the_date_line_are_short_and_those_that_do_not_fit_left_out():
    sight = sight_at(10.0, 179.9995, 100.0, (90.0, -60.0, 0.0, 0.0, 0.0, 0.0))
    values = values_in(METADATA.packet(TIME_NS, sight))
    assert {math.copysign(1, values[tag]) for tag in range(83, 90, 2)} == {-1.0, 1.0}
    assert max(abs(values[tag]) for tag in range(26, 34)) < 0.01
    near_a_pole = sight_at(85.0, 16.0, 3000.0, (0.0, -89.0, 0.0, 0.0, 0.0, 0.0))
    values = values_in(METADATA.packet(TIME_NS, near_a_pole))
    assert abs(values[83] - values[24]) > 0.075  # a degree is short there
    assert not values.keys() & set(range(26, 34))


def test_without_a_trusted_pose_there_is_the_time_alone_and_without_ground_no_centre():
    metadata = FrameMetadata(CONFIG, 45.0, "M600")
    metadata.packet(TIME_NS, SIGHT)
    packet = metadata.packet(TIME_NS, None)
    assert [tag for tag, _ in items_in(packet)] == [2, 65, 1]
    assert by_klvdata(packet)[2] == "2021-10-20 12:01:04.888888+00:00"
    values = values_in(METADATA.packet(TIME_NS, SIGHT._replace(ground=math.nan)))
    assert set(values) == {2, *SEEN, 16, 17}  # without a ground there is no centre
    assert values[13] == pytest.approx(48.2, abs=1e-3)


def test_texts_and_heights_above_the_sea_only_where_they_are_set():
    packet = FrameMetadata(CONFIG, 45.0, "Höhe 1").packet(TIME_NS, SIGHT)
    items, without = dict(items_in(packet)), METADATA.packet(TIME_NS, SIGHT)
    assert (items[10].decode(), items[12]) == ("Höhe 1", b"Geodetic WGS84")
    # ST 0102 requires the countries in it, which nobody gives: strict readers refuse a part of it.
    assert 48 not in items
    values = values_in(packet)
    for hae, msl in ((75, 15), (78, 25)):
        assert values[hae] - values[msl] == pytest.approx(45.0, abs=step_of(hae))
    assert values[75] == pytest.approx(GROUND_M + 80.0, abs=step_of(75))
    assert not dict(items_in(without)).keys() & {10, 15, 25}


@given(
    st.tuples(*[st.floats(-1e6, 1e6)] * 3),
    st.tuples(*[st.floats(-200, 200)] * 6),
    st.sampled_from([0.0, 1e-6, 1.0, 1e9, math.nan]),
    st.sampled_from([math.nan, -450.0, 0.0, 9000.0]),
)
def test_any_pose_makes_a_good_packet(position_n, attitude, variance, ground_m):
    sight = sight_at(47.0, 179.0, 1.0, attitude, ground_m)
    pose = camera_pose(position_n, *attitude[:3], variance)
    rates = CameraRates(np.array(position_n) / 10, np.radians(attitude[:3]))
    for some in (None, rates):
        values = values_in(METADATA.packet(0, sight._replace(pose=pose, rates=some)))
        assert values.keys() >= {2, 5, 13, 14, 16, 17, 18, 19, 20}
        assert (23 in values) == (21 in values)
        assert 23 in values or not values.keys() & {45, 46, *range(82, 90)}


@pytest.mark.parametrize(
    ("pitch", "tilt", "there", "absent"),
    [(19, -49, {6, 7}, {90, 91}), (-25, 55, {90, 91}, {6, 7}), (25, 95, {90}, {6, 7, 91})],
)
def test_steep_attitudes_have_items_of_their_own(pitch, tilt, there, absent):
    sight = sight_at(48.2, 16.4, 80.0, (30.0, -50.0, 4.0, 10.0, pitch, tilt))
    values = values_in(METADATA.packet(TIME_NS, sight))
    assert there <= values.keys()
    assert not absent & values.keys()
    if 90 in values:
        assert values[90] == pytest.approx(pitch, abs=1e-3)  # the plane's origin is 22 m away


MISB_NS = 1_231_798_102_000_000_000
#: 2009-01-12 22:08:22 in Vienna, worked out by hand.
WORKED = bytes.fromhex(
    "060e2b34020b01010e01030101000000 1d 0208 000460 5058 4e0180 4101 13 0d04 44900f84"
    "0e04 0ba4c344 0102 ce65"
)
MAPPED = sorted(UNSIGNED | SIGNED)
assert {tag for tag, item in ITEMS.items() if not math.isnan(item.low)} == set(MAPPED)


def range_of(tag):
    if tag in UNSIGNED:
        return UNSIGNED[tag][:2]
    return -SIGNED[tag][0], SIGNED[tag][0]


def test_the_worked_example():
    assert packet(MISB_NS + 999, {13: 48.2081743, 14: 16.3738189}) == WORKED
    result = by_klvdata(WORKED)
    assert result[2] == "2009-01-12 22:08:22+00:00"
    assert float(result[13]) == 48.208174299545675
    assert float(result[14]) == 16.373818859632053
    assert items_in(packet(-1, {}))[0] == (2, bytes(8))  # a time before 1970 is 1970
    assert number_of(5, b"\xff\xff") == 360.0


@pytest.mark.parametrize(
    ("length", "content"),
    [(0, "00"), (127, "7f"), (128, "8180"), (233, "81e9"), (256, "820100"), (65535, "82ffff")],
)
def test_lengths(length, content):
    assert ber(length) == bytes.fromhex(content) == ber_encode(length)


@pytest.mark.parametrize("tag", MAPPED)
@settings(max_examples=40)
@given(data=st.data())
def test_a_value_is_read_back_to_half_a_step(tag, data):
    low, high = range_of(tag)
    value = data.draw(st.floats(low, high))
    content = packet(MISB_NS, {tag: value})
    # Half a step, and the rounding of numbers of this size.
    assert abs(values_in(content)[tag] - value) <= 0.5 * step_of(tag) + 1e-15 * max(-low, high)
    # klvdata refuses values that its own rounding carries past the end of the range.
    if low + step_of(tag) < value < high - step_of(tag):
        assert float(by_klvdata(content)[tag]) == pytest.approx(values_in(content)[tag], abs=1e-9)


@pytest.mark.parametrize("tag", MAPPED)
def test_ends_of_a_range_and_values_beyond(tag):
    low, high = range_of(tag)
    for value in (low, high):
        assert values_in(packet(MISB_NS, {tag: value}))[tag] == pytest.approx(value, abs=1e-9)
    beyond = [math.nextafter(low, -math.inf), math.nextafter(high, math.inf)]
    for value in (*beyond, math.nan, math.inf, -math.inf):
        assert packet(MISB_NS, {tag: value}) == packet(MISB_NS, {})


@given(st.dictionaries(st.sampled_from(MAPPED), st.floats(allow_nan=True)), st.integers(0, 2**63))
def test_any_values_make_a_good_packet(values, time_ns):
    """Never an error code, for any value; the time is cut to microseconds."""
    result = values_in(packet(time_ns, values))
    assert result.pop(2) == time_ns // 1000
    low_high = {tag: range_of(tag) for tag in values}
    kept = {t: v for t, v in values.items() if low_high[t][0] <= v <= low_high[t][1]}
    assert result.keys() == kept.keys()


@given(st.text(max_size=200))
def test_texts_of_any_length_and_both_parities(text):
    content = packet(MISB_NS, {10: text, 13: 1.0})
    items = dict(items_in(content))
    kept = items.get(10, b"").decode()  # a character is never cut in two
    assert text.startswith(kept)
    assert len(kept.encode()) > 123 or kept == text
    by_klvdata(content)

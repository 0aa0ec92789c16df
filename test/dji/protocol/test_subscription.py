"""Packages of topics and their pushes."""

from __future__ import annotations

import struct

import numpy as np
from dji_layouts import number
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.dji.protocol.broadcast_parts import GimbalAngles, GpsFused, Velocity
from tirgeo_ros.dji.protocol.printed_fields import push_fields
from tirgeo_ros.dji.protocol.subscription import (
    USUAL_PACKAGES,
    Package,
    PackageTable,
    decode_push,
    encode_push,
)
from tirgeo_ros.dji.protocol.subscription_topics import TOPICS


def test_the_usual_packages_have_the_lengths_of_their_pushes():
    # Frames of 144, 101, 67, 82 and 55 bytes; 18 are header, check sum, set and id.
    assert [package.length for package in USUAL_PACKAGES] == [126, 83, 49, 64, 37]
    assert [package.rate_hz for package in PackageTable().values()] == [5, 50, 100, 400, 200]


def push_of(*names, with_timestamp=True):
    return PackageTable([Package.of(3, 50, with_timestamp, names)])


def test_a_push_is_read_in_the_order_of_its_package():
    table = push_of("GPS_FUSED", "RTK_YAW", "VELOCITY", "GIMBAL_ANGLES")
    numbers = (0.1, 0.9, 28.5, 14, -90, 1.5, -2.5, 3.5, 1, -30.0, 2.0, 90.0)
    value = struct.pack("<BIIddfHhfffBfff", 3, 123856, 378900, *numbers)
    push = decode_push(value, table)
    assert (push.package.id, push.time_ms, push.time_ns) == (3, 123856, 378900)
    assert push.values == {
        "GPS_FUSED": GpsFused(lon_rad=0.1, lat_rad=0.9, altitude_m=28.5, satellites=14),
        "RTK_YAW": -90,
        "VELOCITY": Velocity((1.5, -2.5, 3.5), 1),
        "GIMBAL_ANGLES": GimbalAngles(pitch_deg=-30.0, roll_deg=2.0, yaw_deg=90.0),
    }
    assert list(push.values) == ["GPS_FUSED", "RTK_YAW", "VELOCITY", "GIMBAL_ANGLES"]


def test_a_push_that_does_not_fit_is_refused():
    table = push_of("RTK_YAW", with_timestamp=False)
    for wrong in (b"", b"\x03", b"\x03\xa6", b"\x03\xa6\xff\x00", b"\x02\xa6\xff"):
        assert decode_push(wrong, table) is None


@st.composite
def pushes(draw):
    topics = tuple(draw(st.lists(st.sampled_from(TOPICS), unique=True, max_size=12)))
    package = Package(draw(st.integers(0, 4)), 50, draw(st.booleans()), topics)
    form = "<B" + "II" * package.with_timestamp + "".join(topic.form for topic in topics)
    codes = "".join(int(n or 1) * code for n, code in _pairs(form[2:]))
    return package, struct.pack(form, package.id, *[draw(number(code)) for code in codes])


def _pairs(form):
    count = ""
    for code in form:
        if code.isdigit():
            count += code
        else:
            yield count, code
            count = ""


@given(pushes())
def test_what_is_decoded_encodes_to_the_same_bytes(case):
    package, value = case
    push = decode_push(value, PackageTable([package]))
    assert list(push.values) == [topic.name for topic in package.topics]
    assert encode_push(push) == value


def test_a_32_bit_number_is_printed_as_told_apart_from_its_neighbours():
    numbers = np.array([0.1, 1 / 3, 7.3499999, -1e-30, 3.4028235e38, 1.0000001], dtype=np.float32)
    for value in numbers:
        table = PackageTable([Package.of(0, 50, with_timestamp=False, names=("HEIGHT_FUSION",))])
        push = decode_push(b"\x00" + value.tobytes(), table)
        printed = push_fields(push)["HEIGHT_FUSION"]
        assert np.float32(printed) == value
        assert len(f"{printed!r}".lstrip("-0.").partition("e")[0].replace(".", "")) <= 9

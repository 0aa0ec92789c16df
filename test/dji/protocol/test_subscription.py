"""Packages of topics and their pushes."""

from __future__ import annotations

import struct

import pytest
from dji_layouts import number
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.protocol.broadcast_parts import GimbalAngles, GpsFused, Velocity
from tirgeo_ros.dji.protocol.commands import (
    GetVersion,
    RemovePackage,
    ResetPackages,
)
from tirgeo_ros.dji.protocol.subscription import (
    USUAL_PACKAGES,
    Package,
    PackageTable,
    Push,
    decode_push,
    encode_push,
)
from tirgeo_ros.dji.protocol.subscription_topics import BY_NAME, TOPICS

#: Number and length of the topics, as documented.
DOCUMENTED = {
    "QUATERNION": (0xA493281F, 16),
    "ACCELERATION_GROUND": (0x8696C85B, 12),
    "ACCELERATION_BODY": (0xBB17D5FE, 12),
    "ACCELERATION_RAW": (0xC3503A6E, 12),
    "VELOCITY": (0x18FB271D, 13),
    "ANGULAR_RATE_FUSIONED": (0x3599C4BE, 12),
    "ANGULAR_RATE_RAW": (0x700389EE, 12),
    "ALTITUDE_FUSIONED": (0x11E9C81A, 4),
    "ALTITUDE_BAROMETER": (0x27396A39, 4),
    "HEIGHT_FUSION": (0x87CF419D, 4),
    "GPS_FUSED": (0x4B19A8C7, 22),
    "GPS_DATE": (0x598F79BC, 4),
    "GPS_TIME": (0xD48912C9, 4),
    "GPS_POSITION": (0x0C949E94, 12),
    "GPS_VELOCITY": (0x7AC7EB80, 12),
    "GPS_DETAILS": (0x81FED54E, 36),
    "RTK_POSITION": (0x1DF9A6B6, 20),
    "RTK_VELOCITY": (0x763D13C3, 12),
    "RTK_YAW": (0xF45D73FD, 2),
    "RTK_POSITION_INFO": (0xDA4A57B5, 1),
    "RTK_YAW_INFO": (0xCB72B9E3, 1),
    "COMPASS": (0xDF3D72B7, 6),
    "RC": (0x739F7FE4, 12),
    "GIMBAL_ANGLES": (0x01F71678, 12),
    "GIMBAL_STATUS": (0x8B6CD45C, 4),
    "GIMBAL_CONTROL_MODE": (0x326A446D, 1),
    "STATUS_FLIGHT": (0x20CFB02A, 1),
    "STATUS_DISPLAYMODE": (0x1A67D6A1, 1),
    "BATTERY_INFO": (0x69779DD9, 13),
    "HARD_SYNC": (0xECBEF06D, 55),
    "GPS_CONTROL_LEVEL": (0xE30B17B0, 1),
    "GPS_SIGNAL_LEVEL": (0xA6A0395F, 1),
    "RTK_CONNECT_STATUS": (0x6F349326, 2),
    "ESC_DATA": (0xAAA0F589, 80),
    "RC_FULL_RAW_DATA": (0x16EC4D0E, 44),
    "POSITION_VO": (0xD3462697, 13),
    "AVOID_DATA": (0xF6405DAA, 25),
    "HOME_POINT_INFO": (0xBFE4B520, 16),
}


@pytest.mark.parametrize("name", DOCUMENTED)
def test_a_topic_has_its_documented_number_and_length(name):
    package = Package.of(0, 1, with_timestamp=False, names=(name,))
    assert (BY_NAME[name].uid, package.length - 1) == DOCUMENTED[name]


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


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"VELOCITY": Velocity((1.0, 2.0, 3.0))}, "package 3: RTK_YAW needs 1 numbers"),
        ({"VELOCITY": (1.0, 2.0, 3.0), "RTK_YAW": 1}, "VELOCITY needs 4 numbers"),
        ({"VELOCITY": Velocity((1.0, 2.0, 3.0)), "RTK_YAW": 40000}, "package 3 cannot be sent"),
        ({"VELOCITY": Velocity((1e39, 2.0, 3.0)), "RTK_YAW": 1}, "package 3 cannot be sent"),
    ],
)
def test_what_a_package_cannot_hold_is_refused(values, message):
    package = Package.of(3, 50, with_timestamp=False, names=("VELOCITY", "RTK_YAW"))
    with pytest.raises(DjiError, match=message):
        encode_push(Push(package, None, None, values))


def test_no_package_of_a_topic_that_is_none():
    with pytest.raises(DjiError, match="package 1: no topic is called RTK_JAW"):
        Package.of(1, 5, with_timestamp=True, names=["RTK_YAW", "RTK_JAW"])


def test_a_table_learns_what_was_asked_for():
    table = PackageTable()
    package = Package.of(1, 5, with_timestamp=False, names=("RTK_YAW",))
    assert table.learn(package.request)
    assert table.get(1) == package
    assert table.learn(RemovePackage(0))
    assert sorted(table) == [1, 2, 3, 4]
    assert table.learn(ResetPackages())
    assert len(table) == 0
    assert not table.learn(GetVersion())

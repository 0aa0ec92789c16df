"""What the host asks and the aircraft answers, byte by byte and there and back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.dji.protocol.commands import (
    NOT_ACTIVATED,
    Activate,
    AddPackage,
    GetVersion,
    MatchVersion,
    RemovePackage,
    ResetPackages,
    SetRates,
    decode_request,
    decode_version_ack,
    encode_request,
    encode_version_ack,
)

M600 = (3, 2, 41, 13)
U8 = st.integers(0, 0xFF)
U32 = st.integers(0, 0xFFFFFFFF)
REQUESTS = st.one_of(
    st.builds(GetVersion, U8),
    st.builds(Activate, U32, st.tuples(U8, U8, U8, U8)),
    st.builds(SetRates, st.tuples(*[U8] * 16)),
    st.builds(MatchVersion, U32),
    st.builds(
        AddPackage,
        U8,
        st.integers(0, 0xFFFF),
        st.booleans(),
        st.lists(U32, max_size=40).map(tuple),
    ),
    st.builds(ResetPackages),
    st.builds(RemovePackage, U8),
)


RATES = (4, 3, 4, 3, 4, 3, 0, 3, 2, 3, 3, 3, 2, 2, 5, 5)
HARD_SYNC, ACCELERATION_RAW, RATE_RAW = 0xECBEF06D, 0xC3503A6E, 0x700389EE


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (GetVersion(), "00 00 00"),
        (SetRates(RATES), "00 10 04030403040300030203030302020505"),
        (MatchVersion(), "0b 00 00010000"),
        (AddPackage(3, 400, True, (HARD_SYNC,)), "0b 01 03 9001 01 01 6df0beec"),
        (
            AddPackage(4, 200, False, (ACCELERATION_RAW, RATE_RAW)),
            "0b 01 04 c800 00 02 6e3a50c3 ee890370",
        ),
        (RemovePackage(2), "0b 03 02"),
    ],
)
def test_bytes_of_requests(request_, expected):
    assert encode_request(request_) == bytes.fromhex(expected)


@given(REQUESTS)
def test_requests_come_back_as_they_went(request_):
    assert decode_request(encode_request(request_)) == request_


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x00",
        b"\x02\x00\x00\x00",
        b"\x00\x01" + bytes(43),
        b"\x00\x10" + bytes(15),
        b"\x0b\x01\x00\x32\x00\x01\x02" + bytes(7),
        b"\x0b\x03",
        b"\x0b\x00\x00\x01",
    ],
)
def test_other_commands_and_cut_values_are_none(data):
    assert decode_request(data) is None


def test_version_of_an_m600():
    name = b"SDK-v1.0 BETA PM820V3PRO-3.2.41.13"
    ack = decode_version_ack(b"\x01\xff" + b"03Z0CA3008\0" + name + bytes(3))
    assert ack.code == NOT_ACTIVATED
    assert (ack.serial, ack.hardware, ack.firmware) == ("03Z0CA3008", "PM820V3PRO", M600)


@given(st.binary(max_size=120))
def test_any_bytes_are_a_version_without_fuss(value):
    ack = decode_version_ack(value)
    assert (ack is None) == (len(value) < 2)
    assert ack is None or ack.serial.isascii()


@given(
    st.sampled_from([0, NOT_ACTIVATED]),
    st.text("0123456789ABCXYZ", max_size=16),
    st.sampled_from(["PM820V3PRO", "M100", "N3", "PM410"]),
    st.tuples(st.just(3), st.integers(0, 3), U8, U8),
    U32,
)
def test_versions_come_back_in_both_forms(code, serial, hardware, firmware, crc):
    name = f"SDK-v1.0 BETA {hardware}-{'.'.join(map(str, firmware))}"
    value = encode_version_ack(code, serial, name)
    if firmware < (3, 2, 0, 0):
        value = value[:2] + crc.to_bytes(4, "little") + value[2:]
    assert decode_version_ack(value) == (code, serial, hardware, firmware)

"""What the host asks and the aircraft answers, byte by byte and there and back."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tirgeo_ros.dji.protocol.commands import (
    GET_VERSION,
    MATCH_VERSION,
    NOT_ACTIVATED,
    activate,
    add_package,
    decode_request,
    decode_version_ack,
    encode_version_ack,
    remove_package,
    set_rates,
)

M600 = (3, 2, 41, 13)
U8 = st.integers(0, 0xFF)
RATES = (4, 3, 4, 3, 4, 3, 0, 3, 2, 3, 3, 3, 2, 2, 5, 5)
HARD_SYNC, ACCELERATION_RAW, RATE_RAW = 0xECBEF06D, 0xC3503A6E, 0x700389EE


@pytest.mark.parametrize(
    ("request_", "expected"),
    [
        (GET_VERSION, "00 00 00"),
        (activate(258, M600), f"00 01 02010000 02000000 0d290203 {'30' * 32}"),
        (set_rates(RATES), "00 10 04030403040300030203030302020505"),
        (MATCH_VERSION, "0b 00 00010000"),
        (add_package(3, 400, [HARD_SYNC], stamped=True), "0b 01 03 9001 01 01 6df0beec"),
        (
            add_package(4, 200, [ACCELERATION_RAW, RATE_RAW], stamped=False),
            "0b 01 04 c800 00 02 6e3a50c3 ee890370",
        ),
        (remove_package(2), "0b 03 02"),
    ],
)
def test_bytes_of_requests(request_, expected):
    assert request_.data == bytes.fromhex(expected)
    assert decode_request(request_.data) == request_


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
    st.integers(0, 0xFFFFFFFF),
)
def test_versions_come_back_in_both_forms(code, serial, hardware, firmware, crc):
    name = f"SDK-v1.0 BETA {hardware}-{'.'.join(map(str, firmware))}"
    value = encode_version_ack(code, serial, name)
    if firmware < (3, 2, 0, 0):
        value = value[:2] + crc.to_bytes(4, "little") + value[2:]
    assert decode_version_ack(value) == (code, serial, hardware, firmware)

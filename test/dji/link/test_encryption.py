"""AES-256 of frames: a published vector, padding, keys, and the library's absence."""

from __future__ import annotations

import sys

import pytest

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.link.framing import FrameReader, crc16, crc32, encode_frame, parse_key

KEY = bytes(range(32))

#: NIST SP 800-38A, F.1.5 and F.1.6: ECB-AES256, four blocks.
NIST_KEY = "603deb1015ca71be2b73aef0857d77811f352c073b6108d72d9810a30914dff4"
NIST_CLEAR = bytes.fromhex(
    "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
    "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710"
)
NIST_CIPHER = bytes.fromhex(
    "f3eed1bdb5d2a03c064b5a7e3db181f8591ccb10d410ed26dc5ba74a31362870"
    "b6ed21b99ca6f4f9f153e7b1beafed1d23304b7a39f9f3ff067d8d8f9e24ecc7"
)


def read(data, key=KEY):
    reader = FrameReader(key)
    (frame,) = reader.feed(data)
    return frame, reader.counts


def frame_of(cipher, padding, encryption=1):
    """A frame around data that is encrypted already."""
    plain = encode_frame(cipher)
    head = plain[:4] + bytes([padding | encryption << 5]) + plain[5:10]
    return with_sums(head, cipher)


def with_sums(head, data):
    whole = head + crc16(head).to_bytes(2, "little") + data
    return whole + crc32(whole).to_bytes(4, "little")


def test_the_published_vector_in_a_frame():
    """The vector's last block stands as padding whole: its first three come out."""
    frame, counts = read(frame_of(NIST_CIPHER, 16), parse_key(NIST_KEY))
    assert frame.data == NIST_CLEAR[:48]
    assert (frame.encryption, frame.padding, frame.is_encrypted) == (1, 16, False)
    assert (frame.cmd_set, frame.cmd_id) == (0x6B, 0xC1)
    assert counts["encrypted"] == 1


def test_without_a_key_it_is_counted_and_not_read():
    whole = encode_frame(b"\x02\x00\x00\x00", key=KEY)
    frame, counts = read(whole, key=None)
    assert frame.is_encrypted
    assert frame.data == whole[12:-4]
    assert (frame.cmd_set, frame.cmd_id, frame.value) == (None, None, b"")
    assert counts["encrypted"] == 1


@pytest.mark.parametrize(
    ("size", "padding"), [(0, 16), (4, 4), (17, 1), (31, 8), (16, 0), (32, 17), (32, 31)]
)
def test_what_cannot_be_encrypted_data_is_counted(size, padding):
    frame, counts = read(frame_of(bytes(size), padding) if size else empty(padding))
    assert frame.is_encrypted
    assert frame.data == bytes(size)
    assert frame.value == b""
    assert (counts["frames"], counts["encrypted"]) == (1, 1)


def empty(padding):
    return with_sums(bytes([0xAA, 16, 0, 0, padding | 1 << 5, 0, 0, 0, 0, 0]), b"")


@pytest.mark.parametrize("key", [None, KEY])
@pytest.mark.parametrize("encryption", range(2, 8))
def test_other_codes_are_counted_and_not_read(encryption, key):
    frame, counts = read(frame_of(bytes(16), 4, encryption), key)
    assert (frame.is_encrypted, frame.encryption) == (True, encryption)
    assert (frame.cmd_set, frame.value) == (None, b"")
    assert counts["encrypted"] == 1


@pytest.mark.parametrize(
    "text", ["ab" * 31, "ab" * 33, "xy" * 32, "ab " * 21 + "a", "0x" + "ab" * 31, "\u0663" * 64]
)
def test_what_is_no_key(text):
    with pytest.raises(DjiError, match=r"^key: 64 hexadecimal digits .* \d+ characters") as caught:
        parse_key(text)
    assert text not in str(caught.value)  # it may be a secret but for one digit
    assert "\n" not in str(caught.value)


def test_without_the_library(monkeypatch):
    monkeypatch.setitem(sys.modules, "cryptography.hazmat.primitives.ciphers", None)
    with pytest.raises(DjiError, match=r"^key: encrypted frames need the library cryptography"):
        FrameReader(KEY)
    with pytest.raises(DjiError, match=r"leave the key empty$"):
        encode_frame(b"\x00\x00", key=KEY)
    assert FrameReader().feed(encode_frame(b"\x00\x00")) != []

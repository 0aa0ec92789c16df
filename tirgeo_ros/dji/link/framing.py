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
"""Encode frames of the OPEN protocol, and find them in a stream of arbitrary bytes.

The fields of a frame, little-endian: SOF 0xAA; 10 bits of length (of the whole frame), 6 of
version (0); 5 of session, 1 for an ack, 2 reserved; 5 of padding, 3 of encryption; 3 bytes
reserved; u16 sequence; CRC-16 of these ten bytes. A frame with data has two more: the data, and a
CRC-32 of all bytes before it.

A header is valid if SOF, version, reserved fields, length and CRC-16 are right. If one of these or
the CRC-32 is wrong, one byte is dropped and the search starts again at the next. So a frame is
found whatever precedes it, even inside a damaged or cut frame.

Both check sums are reflected, start from a shift register of 0x3AA3 and end without an XOR. The
check sum of data followed by its own check sum (little-endian) is 0.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable
from struct import Struct
from typing import NamedTuple

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.core.types.missing_package import needed

# Encryption.

BLOCK = 16
KEY_BYTES = 32
_KEY = re.compile(rf"[0-9A-Fa-f]{{{2 * KEY_BYTES}}}")
PLAIN, _AES_256 = 0, 1

# Fields of a frame.

HEADER_BYTES = 12
_CRC32_BYTES = 4
#: Length of a frame with data; the length field has 10 bits.
MIN_BYTES, MAX_BYTES = HEADER_BYTES + _CRC32_BYTES, 1023
MAX_DATA_BYTES = MAX_BYTES - MIN_BYTES
#: All bytes of a header with fixed values; the regular expression engine skips other bytes fast.
_HEADER = re.compile(rb"\xaa.[\x00-\x03][\x00-\x3f].\x00{3}.{4}", re.DOTALL)
_FIELDS = Struct("<xHBB3xH")  # length and version, session, encryption, sequence
_CRC16, _CRC32 = Struct("<H"), Struct("<I")
_SOF = 0xAA
_SESSIONS, _ACK, _PADDINGS, _ENCRYPTION_SHIFT = 0x1F, 0x20, 0x1F, 5
_COUNTED = ("frames", "bad_headers", "bad_crc32", "truncated", "encrypted")

# Check sums.

START = 0x3AA3  # initial value of both shift registers
_POLYNOMIAL_16 = 0xA001  # 0x8005 reflected
_ALL_ONES = 0xFFFFFFFF


def parse_key(text: str) -> bytes | None:
    """Return the 32 bytes of the parameter ``key``, None if empty. Raises DjiError if invalid."""
    digits = text.strip()
    if not digits:
        return None
    if not _KEY.fullmatch(digits):  # the message must not show it: it may be almost the key
        raise DjiError(
            f"key: {len(digits)} characters that are not {2 * KEY_BYTES} hexadecimal digits: give "
            "the app key of DJI's developer site"
        )
    return bytes.fromhex(digits)


class Aes256:
    """Encrypt and decrypt the data of frames by AES-256: independent blocks of 16 bytes (ECB).

    Command set, command, value and padding are encrypted. The frame's header gives the number of
    padding bytes (1 to 16) in clear. The content of the padding is not specified, so only commands
    that do not exist show a wrong key. Only this class needs the library ``cryptography``.

    Raises DjiError, naming the parameter ``key``, if the library is absent.
    """

    def __init__(self, key: bytes) -> None:
        ciphers = needed("cryptography.hazmat.primitives.ciphers", "key", DjiError)
        cipher = ciphers.Cipher(ciphers.algorithms.AES(key), ciphers.modes.ECB())
        # Blocks do not depend on each other: one context serves all frames.
        self._encrypt: Callable[[bytes], bytes] = cipher.encryptor().update
        self._decrypt: Callable[[bytes], bytes] = cipher.decryptor().update

    def encrypt(self, data: bytes) -> tuple[bytes, int]:
        """Return the encrypted data and its number of padding bytes (1 to 16)."""
        padding = BLOCK - len(data) % BLOCK
        return self._encrypt(data + bytes(padding)), padding

    def decrypt(self, data: bytes, padding: int) -> bytes | None:
        """Return the clear data; None if its length or padding are not those of encrypted data."""
        if not data or len(data) % BLOCK or not 1 <= padding <= BLOCK:
            return None
        return self._decrypt(data)[:-padding]


class ProtocolFrame(NamedTuple):
    """Hold a frame whose check sums are right."""

    offset: int  # of its first byte in the stream
    length: int  # of the whole frame, bytes
    session: int  # 0: no ack is requested
    is_ack: bool
    encryption: int  # as received: 0 plain, 1 AES-256, others unknown
    padding: int  # bytes of padding in the encrypted data
    sequence: int  # an ack has that of its command
    data: bytes  # between header and CRC-32; without encryption and padding if the key is known
    is_encrypted: bool  # whether the data is still encrypted

    @property
    def cmd_set(self) -> int | None:
        """Return the command set; None for acks, encrypted frames and less than two bytes."""
        return self.data[0] if self._names_command else None

    @property
    def cmd_id(self) -> int | None:
        """Return the command within its set; None if the set is None."""
        return self.data[1] if self._names_command else None

    @property
    def value(self) -> bytes:
        """Return what follows set and command; all the data of an ack; nothing if encrypted."""
        if self.is_encrypted:
            return b""
        return self.data if self.is_ack else self.data[2:]

    @property
    def _names_command(self) -> bool:
        return not self.is_ack and not self.is_encrypted and len(self.data) >= 2


class FrameReader:
    """Decode bytes to frames; the result does not depend on how the stream is cut into pieces.

    Between calls it buffers at most 1022 bytes. The time is linear in the number of bytes: each is
    searched once for headers, and a header with a right CRC-16 costs one CRC-32 of at most 1023
    bytes. ``key``: 32 bytes for decryption. Raises DjiError as ``Aes256`` does.
    """

    def __init__(self, key: bytes | None = None) -> None:
        self._aes = None if key is None else Aes256(key)
        self._buffer = b""
        self._needed = HEADER_BYTES  # number of buffered bytes that the next search needs
        self._offset = 0  # of the buffer's first byte in the stream
        self._framed_bytes = 0
        self._counts = dict.fromkeys(_COUNTED, 0)

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of bytes and frames since the start.

        ``bytes``, ``frames``; ``skipped_bytes``: in no frame; ``bad_headers``: with a wrong CRC-16
        or length; ``bad_crc32``: with a valid header but damaged data; ``truncated``: the rest did
        not come; ``encrypted``: all encrypted frames, with a key or without.
        """
        return {
            "bytes": self._offset + len(self._buffer),
            "skipped_bytes": self._offset - self._framed_bytes,
            **self._counts,
        }

    @property
    def buffered(self) -> int:
        """Return the number of bytes that wait for the rest of a frame, at most 1022."""
        return len(self._buffer)

    def feed(self, data: bytes | bytearray | memoryview) -> list[ProtocolFrame]:
        """Return the frames that are complete with these bytes, in the order of the stream."""
        self._buffer += data
        if len(self._buffer) < self._needed:
            return []
        return self._search(at_end=False)

    def rescan(self) -> list[ProtocolFrame]:
        """Stop waiting for the rest of a cut frame; return the frames after its first byte.

        This empties the buffer. Use it at the end of a file, after a link was opened again, and
        after a silence longer than a frame can pause (50 ms). Otherwise a cut frame would delay
        the frames after it until as many bytes have come as its header states. If the rest of the
        cut frame comes later, it is skipped.
        """
        return self._search(at_end=True)

    def _search(self, *, at_end: bool) -> list[ProtocolFrame]:
        buffer, at = self._buffer, 0
        frames: list[ProtocolFrame] = []
        while header := _HEADER.search(buffer, at):
            at = header.start()
            length = self._length(header.group())
            if at + length > len(buffer) and not at_end:
                self._needed = length
                break
            frame = self._frame(at, length) if length else None
            at += length if frame else 1
            if frame:
                frames.append(frame)
        else:
            # an incomplete header may begin here
            begin = buffer.find(_SOF, max(at, len(buffer) - HEADER_BYTES + 1))
            at = len(buffer) if at_end or begin < 0 else begin
            self._needed = HEADER_BYTES
        self._buffer = buffer[at:]
        self._offset += at
        return frames

    def _length(self, header: bytes) -> int:
        """Return the header's length field; 0 if the header is invalid."""
        length = header[1] | header[2] << 8
        if (length != HEADER_BYTES and length < MIN_BYTES) or crc16(header):
            self._counts["bad_headers"] += 1
            return 0
        return length

    def _frame(self, at: int, length: int) -> ProtocolFrame | None:
        """Return the frame of a valid header if it is complete and its CRC-32 is right."""
        whole = self._buffer[at : at + length]
        if len(whole) < length:
            self._counts["truncated"] += 1
            return None
        if length > HEADER_BYTES and crc32(whole):
            self._counts["bad_crc32"] += 1
            return None
        self._counts["frames"] += 1
        self._framed_bytes += length
        _, session, encryption, sequence = _FIELDS.unpack_from(whole)
        frame = ProtocolFrame(
            self._offset + at,
            length,
            session & _SESSIONS,
            bool(session & _ACK),
            encryption >> _ENCRYPTION_SHIFT,
            encryption & _PADDINGS,
            sequence,
            whole[HEADER_BYTES:-_CRC32_BYTES],
            is_encrypted=False,
        )
        return self._decrypted(frame) if frame.encryption != PLAIN else frame

    def _decrypted(self, frame: ProtocolFrame) -> ProtocolFrame:
        """Count an encrypted frame; return it decrypted if possible."""
        self._counts["encrypted"] += 1
        if frame.length == HEADER_BYTES:
            return frame
        is_aes = frame.encryption == _AES_256
        data = self._aes.decrypt(frame.data, frame.padding) if is_aes and self._aes else None
        return frame._replace(is_encrypted=True) if data is None else frame._replace(data=data)


def encode_frame(
    data: bytes,
    *,
    session: int = 0,
    sequence: int = 0,
    is_ack: bool = False,
    key: bytes | None = None,
) -> bytes:
    """Return the bytes of a frame: without data only a header; encrypted if ``key`` is given.

    ``data``: command set, command and value, or the value of an ack: at most 1007 bytes, with a
    key at most 991. ``session``: 0 to 31, ``sequence``: a u16.
    """
    padding = 0
    if data and key is not None:
        data, padding = Aes256(key).encrypt(data)
    length = len(data) + MIN_BYTES if data else HEADER_BYTES
    encryption = padding | (_AES_256 << _ENCRYPTION_SHIFT if padding else 0)
    fields = _FIELDS.pack(length, session | is_ack * _ACK, encryption, sequence)
    header = bytes([_SOF]) + fields[1:]
    header += _CRC16.pack(crc16(header))
    return header + data + _CRC32.pack(crc32(header + data)) if data else header


def _table() -> tuple[int, ...]:
    """Return the effect of eight shifts on each value of the low byte."""
    entries = []
    for value in range(256):
        register = value
        for _ in range(8):
            register = (register >> 1) ^ (_POLYNOMIAL_16 if register & 1 else 0)
        entries.append(register)
    return tuple(entries)


_TABLE_16 = _table()


def crc16(data: bytes) -> int:
    """Return the CRC-16 of a header's first ten bytes; 0 for all twelve of an intact header."""
    register = START
    for byte in data:
        register = (register >> 8) ^ _TABLE_16[(register ^ byte) & 0xFF]
    return register


def crc32(data: bytes) -> int:
    """Return the CRC-32 of a frame without its last four bytes; 0 for a whole intact frame.

    zlib's CRC-32 has the same polynomial, but inverts the register before the first byte and after
    the last.
    """
    return zlib.crc32(data, START ^ _ALL_ONES) ^ _ALL_ONES

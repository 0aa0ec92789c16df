"""Find and encode frames of the OPEN protocol in a stream of bytes that may hold anything.

A frame, little-endian: SOF 0xAA; 10 bits of length (of the whole) and 6 of version (0); 5 of
session, 1 for an ack, 2 reserved; 5 of padding, 3 of encryption; 3 bytes reserved; u16 sequence;
CRC-16 of these ten bytes; then, unless it ends there, the data and a CRC-32 of all before it.

A header is valid if SOF, version, reserved fields, length and CRC-16 are right. If one of these or
the CRC-32 is wrong, one byte is dropped and the search starts again behind it. So a frame is found
whatever precedes it, even within the bytes that a damaged or cut frame claims.

Both check sums are reflected, start from a shift register of 0x3AA3 and end without an XOR.
Computed over data that is followed by its own check sum (little-endian), each is 0.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Callable
from struct import Struct
from typing import NamedTuple

from tirgeo_ros.core.types.errors import DjiError

BLOCK = 16
KEY_BYTES = 32
_KEY = re.compile(rf"[0-9A-Fa-f]{{{2 * KEY_BYTES}}}")


def parse_key(text: str) -> bytes | None:
    """Return the 32 bytes of the parameter ``key``; None if it is empty.

    Raises DjiError if invalid.
    """
    digits = text.strip()
    if not digits:
        return None
    if not _KEY.fullmatch(digits):  # the message must not repeat what may be nearly a secret
        raise DjiError(
            f"key: {2 * KEY_BYTES} hexadecimal digits are needed, the app key of DJI's developer "
            f"site; {len(digits)} characters are given, which are not that"
        )
    return bytes.fromhex(digits)


class Aes256:
    """Encrypt and decrypt the data of frames by AES-256: independent blocks of 16 bytes (ECB).

    Command set, command, value and padding are encrypted. The frame's header gives the number of
    padding bytes (1 to 16) in clear. The content of the padding is not specified, so a wrong key
    shows only in commands that do not exist. ``cryptography`` is needed for this alone.

    Raises DjiError, naming the parameter ``key``, if the library is absent.
    """

    def __init__(self, key: bytes) -> None:
        try:
            from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes  # noqa: PLC0415 optional
        except ImportError:
            raise DjiError(
                "key: encrypted frames need the library cryptography: install it "
                "(pip install cryptography) or leave the key empty"
            ) from None
        cipher = Cipher(algorithms.AES(key), modes.ECB())  # noqa: S305 what the aircraft speaks
        # Blocks do not depend on each other: one context serves all frames.
        self._encrypt: Callable[[bytes], bytes] = cipher.encryptor().update
        self._decrypt: Callable[[bytes], bytes] = cipher.decryptor().update

    def encrypt(self, data: bytes) -> tuple[bytes, int]:
        """Return the encrypted data and its number of padding bytes (1 to 16)."""
        padding = BLOCK - len(data) % BLOCK
        return self._encrypt(data + bytes(padding)), padding

    def decrypt(self, data: bytes, padding: int) -> bytes | None:
        """Return the clear data; None if it cannot be decrypted.

        That is if its length or the padding cannot be that of encrypted data.
        """
        if not data or len(data) % BLOCK or not 1 <= padding <= BLOCK:
            return None
        return self._decrypt(data)[:-padding]


HEADER_BYTES = 12
_CRC32_BYTES = 4
#: Of a frame with data; the length field has 10 bits.
MIN_BYTES, MAX_BYTES = HEADER_BYTES + _CRC32_BYTES, 1023
MAX_DATA_BYTES = MAX_BYTES - MIN_BYTES

#: Everything that is fixed in a header. The regular expression engine skips garbage fast.
_HEADER = re.compile(rb"\xaa.[\x00-\x03][\x00-\x3f].\x00{3}.{4}", re.DOTALL)
_FIELDS = Struct("<xHBB3xH")  # length and version, session, encryption, sequence
_CRC16, _CRC32 = Struct("<H"), Struct("<I")
_SOF = 0xAA
_COUNTED = ("frames", "bad_headers", "bad_crc32", "truncated", "encrypted")
_SESSIONS, _ACK, _PADDINGS, _ENCRYPTION_SHIFT = 0x1F, 0x20, 0x1F, 5
PLAIN, _AES_256 = 0, 1
#: Initial value of both shift registers.
START = 0x3AA3
_POLYNOMIAL_16 = 0xA001  # 0x8005 reflected
_ALL_ONES = 0xFFFFFFFF


class ProtocolFrame(NamedTuple):
    """Hold a frame whose check sums are right."""

    offset: int  # of its first byte in the stream
    length: int  # of the whole, bytes
    session: int  # 0: no ack is wanted
    is_ack: bool
    encryption: int  # as received: 0 plain, 1 AES-256, others unknown
    padding: int  # bytes of padding in the encrypted data
    sequence: int  # an ack repeats its command's
    data: bytes  # between header and CRC-32; without encryption and padding if the key is known
    is_encrypted: bool  # whether the data is still encrypted

    @property
    def cmd_set(self) -> int | None:
        """Return the command set; None if the frame does not name it.

        Acks do not name it, nor do encrypted frames and shorter data.
        """
        return self.data[0] if self._names_command else None

    @property
    def cmd_id(self) -> int | None:
        """Return the command within its set; None where the set is None."""
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

    Between calls it holds at most 1022 bytes. The time is linear in the bytes: each is searched
    once for headers, and a header with a right CRC-16 costs one CRC-32 of at most 1023 bytes.

    ``key``: 32 bytes, to decrypt with. Raises DjiError as ``Aes256`` does.
    """

    def __init__(self, key: bytes | None = None) -> None:
        self._aes = None if key is None else Aes256(key)
        self._held = b""
        self._needed = HEADER_BYTES  # with fewer bytes held there is nothing to do
        self._offset = 0  # of the first held byte in the stream
        self._framed_bytes = 0
        self._counts = dict.fromkeys(_COUNTED, 0)

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of bytes and frames since the start.

        ``bytes``, ``frames``; ``skipped_bytes`` that are in no frame; ``bad_headers``: all but
        CRC-16 or length right; ``bad_crc32``: header right, rest damaged; ``truncated``: the rest
        did not come; ``encrypted``: frames that are not plain, with a key or without.
        """
        return {
            "bytes": self._offset + len(self._held),
            "skipped_bytes": self._offset - self._framed_bytes,
            **self._counts,
        }

    @property
    def held(self) -> int:
        """Return the number of bytes that wait for those that follow; 1022 at the most."""
        return len(self._held)

    def feed(self, data: bytes | bytearray | memoryview) -> list[ProtocolFrame]:
        """Return the frames that are complete with these bytes, in the order of the stream."""
        self._held += data
        if len(self._held) < self._needed:
            return []
        return self._search(at_end=False)

    def rescan(self) -> list[ProtocolFrame]:
        """Stop waiting for the rest of a frame; return the frames within it. Nothing stays held.

        Use this at the end of a file, for a link that was opened again, and for one that has been
        silent for longer than a frame can pause (50 ms). Otherwise a cut frame would hold back
        what came after it until as many bytes have come as its header promised. If the rest of a
        frame comes after this, it is skipped.
        """
        return self._search(at_end=True)

    def _search(self, *, at_end: bool) -> list[ProtocolFrame]:
        held, at = self._held, 0
        frames: list[ProtocolFrame] = []
        while header := _HEADER.search(held, at):
            at = header.start()
            length = self._length(header.group())
            if at + length > len(held) and not at_end:
                self._needed = length
                break
            frame = self._frame(at, length) if length else None
            at += length if frame else 1
            if frame:
                frames.append(frame)
        else:
            # where an incomplete header may begin
            begin = held.find(_SOF, max(at, len(held) - HEADER_BYTES + 1))
            at = len(held) if at_end or begin < 0 else begin
            self._needed = HEADER_BYTES
        self._held = held[at:]
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
        """Return the frame of a valid header if it is whole and its CRC-32 is right."""
        whole = self._held[at : at + length]
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
        """Return the frame decrypted, if it can be; count it."""
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
    """Return the bytes of a frame; only a header without data; encrypted with a key.

    ``data``: command set, command and value, or the value of an ack: 1007 bytes at most, 991 with
    a key. ``session``: 0 to 31, ``sequence``: a u16.
    """
    padding = 0
    if data and key is not None:
        data, padding = Aes256(key).encrypt(data)
    length = len(data) + MIN_BYTES if data else HEADER_BYTES
    encryption = padding | (_AES_256 << _ENCRYPTION_SHIFT if padding else 0)
    whole = bytes([_SOF]) + _FIELDS.pack(length, session | is_ack * _ACK, encryption, sequence)[1:]
    whole += _CRC16.pack(crc16(whole))
    return whole + data + _CRC32.pack(crc32(whole + data)) if data else whole


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
    """Return the CRC-16 of a header's first ten bytes; 0 over all twelve of an intact header."""
    register = START
    for byte in data:
        register = (register >> 8) ^ _TABLE_16[(register ^ byte) & 0xFF]
    return register


def crc32(data: bytes) -> int:
    """Return the CRC-32 of a frame without its last four bytes; 0 over the whole intact frame.

    zlib's CRC-32 has the same polynomial, but inverts the register before the first byte and after
    the last.
    """
    return zlib.crc32(data, START ^ _ALL_ONES) ^ _ALL_ONES

"""Encrypt and decrypt the OPEN protocol's AES-256: independent blocks of 16 bytes (ECB).

Command set, command, value and padding are encrypted. The frame's header gives the number of
padding bytes (1 to 16) in clear. The content of the padding is not specified, so a wrong key shows
only in commands that do not exist. ``cryptography`` is needed for this alone, and is imported only
when there is a key.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING

from tirgeo_ros.core.types.errors import DjiError

if TYPE_CHECKING:
    from cryptography.hazmat.primitives.ciphers import Cipher, modes

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
    """Encrypt and decrypt the data of frames with a key of 32 bytes.

    Raises DjiError, naming the parameter ``key``, if the library is absent.
    """

    def __init__(self, key: bytes) -> None:
        cipher = _cipher(key)
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


def _cipher(key: bytes) -> Cipher[modes.ECB]:
    try:
        from cryptography.hazmat.primitives.ciphers import Cipher, algorithms, modes  # noqa: PLC0415 optional
    except ImportError:
        raise DjiError(
            "key: encrypted frames need the library cryptography: install it "
            "(pip install cryptography) or leave the key empty"
        ) from None
    return Cipher(algorithms.AES(key), modes.ECB())  # noqa: S305 what the aircraft speaks

"""Encode a host's requests and the aircraft's answers, as the data of frames.

A request is sent as command set, command id and value. An answer (ack) holds the value alone and
is matched by the session and sequence of its frame. All numbers are little-endian. The host
(``dji.host.session``) encodes requests and decodes acks; a simulated aircraft does the reverse.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Sequence
from enum import Enum
from typing import NamedTuple

Firmware = tuple[int, int, int, int]

PACKAGE_IDS = range(5)
NOT_ACTIVATED = 0xFF01

_SUBSCRIPTION_VERSION = 0x00000100
_ACTIVATE_MARK = 2  # the word after the app id
_ACTIVATE_FILLER = b"0" * 32
_NAME_SIZE = 32
_FIRST_WITHOUT_CRC = (3, 2, 0, 0)

# "... PM820V3PRO-3.2.41.13"; a long name may be cut within its last number.
_HARDWARE_FIRMWARE = re.compile(
    rb"([0-9A-Za-z_]+)-(\d{1,3})\.(\d{1,3})\.(\d{1,3})(?:\.(\d{0,3}))?"
)


class Opcode(Enum):
    """List command set and id of each request."""

    GET_VERSION = (0x00, 0x00)
    ACTIVATE = (0x00, 0x01)
    SET_RATES = (0x00, 0x10)
    MATCH_VERSION = (0x0B, 0x00)
    ADD_PACKAGE = (0x0B, 0x01)
    RESET_PACKAGES = (0x0B, 0x02)
    REMOVE_PACKAGE = (0x0B, 0x03)


class Request(NamedTuple):
    """Hold a request of the host; its numbers must fit their fields."""

    opcode: Opcode
    value: bytes = b"\0"

    @property
    def data(self) -> bytes:
        """Return the data of its frame."""
        return bytes(self.opcode.value) + self.value


#: Ask for the version; the byte is arbitrary.
GET_VERSION = Request(Opcode.GET_VERSION)
#: Match the version of the subscription's topics.
MATCH_VERSION = Request(Opcode.MATCH_VERSION, struct.pack("<I", _SUBSCRIPTION_VERSION))
#: Remove all packages; the aircraft keeps those of a host that went away. Nobody reads the byte.
RESET_PACKAGES = Request(Opcode.RESET_PACKAGES)


def activate(app_id: int, firmware: Firmware) -> Request:
    """Activate the application, which unlocks for example the subscription."""
    version = int.from_bytes(bytes(firmware), "big")
    value = struct.pack("<III32s", app_id, _ACTIVATE_MARK, version, _ACTIVATE_FILLER)
    return Request(Opcode.ACTIVATE, value)


def set_rates(codes: Sequence[int]) -> Request:
    """Set a rate code for each of the broadcast's 16 mask bits."""
    return Request(Opcode.SET_RATES, bytes(codes))


def add_package(number: int, rate_hz: int, uids: Sequence[int], *, stamped: bool) -> Request:
    """Add a package: push these topics one after the other, at this rate."""
    head = struct.pack("<BHBB", number, rate_hz, stamped, len(uids))
    return Request(Opcode.ADD_PACKAGE, head + struct.pack(f"<{len(uids)}I", *uids))


def remove_package(number: int) -> Request:
    """Remove one package."""
    return Request(Opcode.REMOVE_PACKAGE, bytes((number,)))


def decode_request(data: bytes) -> Request | None:
    """Return the request in a host's frame; None for another command."""
    try:
        return Request(Opcode((data[0], data[1])), data[2:])
    except (ValueError, IndexError):
        return None


class VersionAck(NamedTuple):
    """Hold the aircraft's identity, from the ack to 00/00."""

    code: int  # 0 activated, ``NOT_ACTIVATED``
    serial: str
    hardware: str  # "" if the name does not contain it
    firmware: Firmware | None


def encode_version_ack(code: int, serial: str, name: str) -> bytes:
    """Return the value of the ack to 00/00; ``name`` ends in hardware and firmware."""
    padded = name.encode("ascii").ljust(_NAME_SIZE, b"\0")
    return struct.pack("<H", code) + serial.encode("ascii") + b"\0" + padded + b"\0"


def decode_version_ack(value: bytes) -> VersionAck | None:
    """Decode an ack to 00/00; None if it is too short to hold a code.

    In firmware before 3.2, which the name contains, a CRC precedes the serial number.
    """
    if len(value) < 2:
        return None
    matches = list(_HARDWARE_FIRMWARE.finditer(value, 2))
    hardware, firmware = "", None
    if matches:
        name, *numbers = matches[-1].groups()
        hardware = name.decode("ascii")
        a, b, c, d = (int(number or 0) for number in numbers)
        firmware = (a, b, c, d) if max(a, b, c, d) < 256 else None
    has_crc = firmware is not None and firmware < _FIRST_WITHOUT_CRC
    serial = value[6 if has_crc else 2 :].partition(b"\0")[0].decode("ascii", "replace")
    printable = "".join(c if c.isprintable() and c.isascii() else "?" for c in serial)
    return VersionAck(int.from_bytes(value[:2], "little"), printable, hardware, firmware)


def encode_code(request: Request, code: int) -> bytes:
    """Return the ack's value to a request other than 00/00: u16 of set 00, u8 of set 0B."""
    return code.to_bytes(_code_size(request), "little")


def decode_code(request: Request, value: bytes) -> int | None:
    """Return the code of an ack's value; None if it is too short."""
    size = _code_size(request)
    return int.from_bytes(value[:size], "little") if len(value) >= size else None


def _code_size(request: Request) -> int:
    return 2 if request.opcode.value[0] == 0x00 else 1


def explain(request: Request, code: int) -> str:
    """Return an ack's code in words that tell a person what to do."""
    table = _WORDS.get(request.opcode, _SUBSCRIPTION_WORDS)
    return table.get(code, f"code 0x{code:02X}, which is not known")


_VERSION_WORDS = {
    0x0000: "activated",
    NOT_ACTIVATED: "not activated: set host.app_id, unless listening is enough",
}
_ACTIVATION_WORDS = {
    0: "activated",
    1: "bad parameter: check host.app_id",
    2: "cannot decrypt: check that host.app_id and key belong to the same application",
    3: "new device: connect a phone or tablet with DJI GO and internet to the "
    "remote controller; it takes two tries",
    4: "DJI GO does not answer: connect it to the remote controller",
    5: "DJI GO has no internet: let the phone or tablet go online",
    6: "DJI's server refused: check that host.app_id is valid for this account",
    7: "the application's level is too low: raise it at DJI's developer site",
    8: "firmware and SDK version do not fit: update the aircraft in DJI Assistant 2",
}
_RATES_WORDS = {0: "set", 1: "bad parameter: check host.broadcast_rates"}
_SUBSCRIPTION_WORDS = {
    0x00: "done",
    0x01: "wrong length of the request",
    0x02: "the aircraft has another version of the subscription: update its firmware",
    0x03: "package ids are 0 to 4",
    0x04: "a package of this id exists already",
    0x05: "no package of this id",
    0x06: "the rate is not possible: lower it in the file of packages",
    0x07: "the package is too large: remove topics from it",
    0x08: "the aircraft's pipeline failed: switch it off and on",
    0x20: "the package is empty",
    0x21: "the number of topics is wrong",
    0x22: "it has a topic that this aircraft does not know: remove it from the package",
    0x23: "denied: activate first, with host.app_id",
    0x24: "it has a topic that another package holds already: remove it from one of them",
    0x25: "the source of a topic is offline: no RTK hardware, or not switched on",
    0x50: "not authorised: check host.app_id and its level at DJI's developer site",
}
_WORDS: dict[Opcode, dict[int, str]] = {
    Opcode.GET_VERSION: _VERSION_WORDS,
    Opcode.ACTIVATE: _ACTIVATION_WORDS,
    Opcode.SET_RATES: _RATES_WORDS,
}

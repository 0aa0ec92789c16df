"""Encode and decode a host's requests and the aircraft's answers, as the data of frames.

A request is sent as command set, command id and value. An answer (ack) holds the value alone and
is matched by the session and sequence of its frame. All numbers are little-endian. The host
(``dji.host.session``) encodes requests and decodes acks; a simulated aircraft does the reverse.
"""

from __future__ import annotations

import re
import struct
from typing import NamedTuple

Firmware = tuple[int, int, int, int]

RATE_COUNT = 16  # one rate code for each bit of the broadcast's mask
PACKAGE_IDS = range(5)
SUBSCRIPTION_VERSION = 0x00000100
NOT_ACTIVATED = 0xFF01

_ACTIVATE = struct.Struct("<III32s")
_ACTIVATE_MARK = 2  # the word after the app id
_ACTIVATE_FILLER = b"0" * 32
_ADD_PACKAGE = struct.Struct("<BHBB")
_NAME_SIZE = 32
_FIRST_WITHOUT_CRC = (3, 2, 0, 0)

# "... PM820V3PRO-3.2.41.13"; a long name may be cut within its last number.
_HARDWARE_FIRMWARE = re.compile(
    rb"([0-9A-Za-z_]+)-(\d{1,3})\.(\d{1,3})\.(\d{1,3})(?:\.(\d{0,3}))?"
)


class GetVersion(NamedTuple):
    """Ask for the version (00/00); the byte is arbitrary."""

    filler: int = 0


class Activate(NamedTuple):
    """Activate the application (00/01), which unlocks for example the subscription."""

    app_id: int
    firmware: Firmware


class SetRates(NamedTuple):
    """Set a rate code for each of the broadcast's 16 mask bits (00/10)."""

    codes: tuple[int, ...]


class MatchVersion(NamedTuple):
    """Match the version of the subscription's topics (0B/00)."""

    version: int = SUBSCRIPTION_VERSION


class AddPackage(NamedTuple):
    """Add a package (0B/01): push these topics one after the other, at this rate."""

    id: int  # 0 to 4
    rate_hz: int
    with_timestamp: bool
    uids: tuple[int, ...]


class ResetPackages(NamedTuple):
    """Remove all packages (0B/02); the aircraft keeps those of a host that went away."""


class RemovePackage(NamedTuple):
    """Remove one package (0B/03)."""

    id: int


Request = (
    GetVersion | Activate | SetRates | MatchVersion | AddPackage | ResetPackages | RemovePackage
)

#: Command set and id of each request.
OPCODES: dict[type[Request], tuple[int, int]] = {
    GetVersion: (0x00, 0x00),
    Activate: (0x00, 0x01),
    SetRates: (0x00, 0x10),
    MatchVersion: (0x0B, 0x00),
    AddPackage: (0x0B, 0x01),
    ResetPackages: (0x0B, 0x02),
    RemovePackage: (0x0B, 0x03),
}
_KINDS = {opcode: kind for kind, opcode in OPCODES.items()}


def encode_request(request: Request) -> bytes:
    """Encode command set, command id and value, whose numbers must fit their fields."""
    return bytes(OPCODES[type(request)]) + _encode_value(request)


def _encode_value(request: Request) -> bytes:
    match request:
        case GetVersion(number) | RemovePackage(number):
            return bytes((number,))
        case Activate(app_id, firmware):
            version = int.from_bytes(bytes(firmware), "big")
            return _ACTIVATE.pack(app_id, _ACTIVATE_MARK, version, _ACTIVATE_FILLER)
        case SetRates(codes):
            return bytes(codes)
        case MatchVersion(version):
            return struct.pack("<I", version)
        case AddPackage(number, rate_hz, with_timestamp, uids):
            head = _ADD_PACKAGE.pack(number, rate_hz, int(with_timestamp), len(uids))
            return head + struct.pack(f"<{len(uids)}I", *uids)
        case ResetPackages():
            return b"\0"  # a byte that nobody reads


def decode_request(data: bytes) -> Request | None:
    """Return the request in a host's frame.

    Returns None for another command or a value of wrong length.
    """
    kind = _KINDS.get((data[0], data[1])) if len(data) >= 2 else None
    try:
        return None if kind is None else _decode_value(kind, data[2:])
    except (struct.error, IndexError):
        return None


def _decode_value(kind: type[Request], value: bytes) -> Request | None:
    if kind is GetVersion:
        return GetVersion(value[0] if value else 0)
    if kind is Activate:
        app_id, _, version, _ = _ACTIVATE.unpack(value)
        a, b, c, d = version.to_bytes(4, "big")
        return Activate(app_id, (a, b, c, d))
    if kind is SetRates:
        return SetRates(tuple(value)) if len(value) == RATE_COUNT else None
    if kind is MatchVersion:
        return MatchVersion(*struct.unpack("<I", value))
    if kind is AddPackage:
        number, rate_hz, config, count = _ADD_PACKAGE.unpack_from(value)
        uids = struct.unpack(f"<{count}I", value[_ADD_PACKAGE.size :])
        return AddPackage(number, rate_hz, bool(config & 1), uids)
    return ResetPackages() if kind is ResetPackages else RemovePackage(value[0])


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
    return 2 if OPCODES[type(request)][0] == 0x00 else 1


def explain(request: Request, code: int) -> str:
    """Return an ack's code in words that tell a person what to do."""
    table = _WORDS.get(type(request), _SUBSCRIPTION_WORDS)
    return table.get(code, f"code 0x{code:02X}, which is not known")


_VERSION_WORDS = {
    0x0000: "activated",
    NOT_ACTIVATED: "not activated: give host.app_id if more than listening is wanted",
}
_ACTIVATION_WORDS = {
    0: "activated",
    1: "bad parameter: check host.app_id",
    2: "cannot decrypt: check that host.app_id and key are of the same application",
    3: "new device: connect a phone or tablet with DJI GO that is online to the remote "
    "controller; it takes two tries",
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
    0x07: "the package is too large: take topics out of it",
    0x08: "the aircraft's pipeline failed: switch it off and on",
    0x20: "the package is empty",
    0x21: "the number of topics is wrong",
    0x22: "it has a topic that this aircraft does not know: take it out of the package",
    0x23: "denied: activate first, with host.app_id",
    0x24: "it has a topic that another package holds already: take it out of one of them",
    0x25: "the source of a topic is offline: no RTK hardware, or not switched on",
    0x50: "not authorised: check host.app_id and its level at DJI's developer site",
}
_WORDS: dict[type[Request], dict[int, str]] = {
    GetVersion: _VERSION_WORDS,
    Activate: _ACTIVATION_WORDS,
    SetRates: _RATES_WORDS,
}

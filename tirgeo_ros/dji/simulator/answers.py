"""Answer the host's requests as the aircraft does: version, activation, rates, packages."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame, encode_frame
from tirgeo_ros.dji.protocol.broadcast import Layout
from tirgeo_ros.dji.protocol.commands import (
    NOT_ACTIVATED,
    Opcode,
    Request,
    decode_request,
    encode_code,
    encode_version_ack,
)
from tirgeo_ros.dji.protocol.subscription import Package, PackageTable
from tirgeo_ros.dji.protocol.subscription_topics import BY_UID
from tirgeo_ros.dji.simulator.pushed_parts import TOLD_TOPICS

A3_NAME = "SDK-v1.0 BETA PM820V3PRO-3.2.41.13"
_LEGACY_NAME = "SDK-v1.0 BETA PM820V3PRO-3.2.15.62"
_SERIAL = "0670XXXXXXXXXX"
_KEEP_RATE, _HIGHEST_RATE = 5, 7
#: Usual rate codes of such an aircraft: attitude, force and rate as often as they are measured, 50
#: Hz for what is used to fly, 10 Hz for the rest; neither device nor compass.
USUAL_RATES = (7, 7, 7, 3, 7, 3, 3, 3, 2, 3, 3, 3, 2, 2, 0, 0)
#: Rates beside packages, which hold the same data at up to 400 Hz: both would not fit 921600 baud.
RATES_BESIDE_PACKAGES = (4, 4, 4, 3, 4, *USUAL_RATES[5:])
#: Codes of the subscription's answers.
_EXISTS, _UNKNOWN_PACKAGE, _UNKNOWN_TOPIC, _DENIED = 0x04, 0x05, 0x22, 0x23


class CommandDesk:
    """Read the host's frames, answer them, and keep the settings."""

    def __init__(self, layout: Layout = Layout.MODERN, packages: Sequence[Package] = ()) -> None:
        self.rates: tuple[int, ...] = RATES_BESIDE_PACKAGES if packages else USUAL_RATES
        self.packages = PackageTable(packages)
        self.activated = False
        self._name = _LEGACY_NAME if layout is Layout.LEGACY else A3_NAME
        self._reader = FrameReader()
        self._answered: tuple[tuple[int, int, bytes], bytes] | None = None

    def answer(self, data: bytes) -> bytes:
        """Return the acks to the host's bytes, cut in any way."""
        return b"".join(map(self._answer, self._reader.feed(data)))

    def _answer(self, frame: ProtocolFrame) -> bytes:
        asked = (frame.session, frame.sequence, frame.data)
        if self._answered is None or self._answered[0] != asked:
            request = None if frame.is_ack else decode_request(frame.data)
            value, ack = b"" if request is None else self._done(request), b""
            if value and frame.session:
                session, sequence = frame.session, frame.sequence
                ack = encode_frame(value, session=session, sequence=sequence, is_ack=True)
            self._answered = (asked, ack)
        return self._answered[1]  # a repeated request, whose ack was lost, gets the same ack

    def _done(self, request: Request) -> bytes:
        if request.opcode is Opcode.GET_VERSION:
            return encode_version_ack(0 if self.activated else NOT_ACTIVATED, _SERIAL, self._name)
        return encode_code(request, self.do(request))

    def do(self, request: Request) -> int:
        """Do what a request asks for; return the code of its ack."""
        code, value = 0, request.value
        match request.opcode:
            case Opcode.ACTIVATE:
                self.activated = True
            case Opcode.SET_RATES if max(value) > _HIGHEST_RATE:
                code = 1
            case Opcode.SET_RATES:
                kept = zip(value, self.rates, strict=True)
                self.rates = tuple(old if new == _KEEP_RATE else new for new, old in kept)
            case _ if not self.activated:
                code = _DENIED
            case Opcode.ADD_PACKAGE:
                code = self._add(value)
            case Opcode.REMOVE_PACKAGE:
                code = 0 if self.packages.pop(value[0], None) else _UNKNOWN_PACKAGE
            case Opcode.RESET_PACKAGES:
                self.packages.clear()
        return code

    def _add(self, value: bytes) -> int:
        number, rate_hz, with_timestamp, count = struct.unpack_from("<BHBB", value)
        if number in self.packages:
            return _EXISTS
        uids = struct.unpack_from(f"<{count}I", value, 5)
        topics = tuple(BY_UID[uid] for uid in uids if uid in BY_UID)
        if sum(topic.name in TOLD_TOPICS for topic in topics) < count:
            return _UNKNOWN_TOPIC
        self.packages[number] = Package(number, rate_hz, bool(with_timestamp), topics)
        return 0

"""Answer the host's requests as the aircraft does: version, activation, rates, packages."""

from __future__ import annotations

from collections.abc import Sequence

from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame, encode_frame
from tirgeo_ros.dji.protocol.broadcast import Layout
from tirgeo_ros.dji.protocol.commands import (
    NOT_ACTIVATED,
    OPCODES,
    PACKAGE_IDS,
    SUBSCRIPTION_VERSION,
    Activate,
    AddPackage,
    GetVersion,
    MatchVersion,
    RemovePackage,
    Request,
    ResetPackages,
    SetRates,
    decode_request,
    encode_code,
    encode_version_ack,
)
from tirgeo_ros.dji.protocol.subscription import MAX_DATA_BYTES, Package, PackageTable
from tirgeo_ros.dji.protocol.subscription_topics import BY_UID, TOPICS
from tirgeo_ros.dji.simulator.pushed_parts import TOLD_TOPICS

A3_NAME = "SDK-v1.0 BETA PM820V3PRO-3.2.41.13"
_LEGACY_NAME = "SDK-v1.0 BETA PM820V3PRO-3.2.15.62"
_SERIAL = "0670XXXXXXXXXX"
_KEEP_RATE, _HIGHEST_RATE = 5, 7
_ANY_HZ = 400  # of a topic whose highest rate is not documented
#: Usual rate codes of such an aircraft: attitude, force and rate as often as they are measured, 50
#: Hz for what is used to fly, 10 Hz for the rest; neither device nor compass.
USUAL_RATES = (7, 7, 7, 3, 7, 3, 3, 3, 2, 3, 3, 3, 2, 2, 0, 0)
#: Rates beside packages, which hold the same data at up to 400 Hz: both would not fit 921600 baud.
RATES_BESIDE_PACKAGES = (4, 4, 4, 3, 4, *USUAL_RATES[5:])
#: Codes of the subscription's answers.
_LENGTH, _VERSION, _ID, _EXISTS, _UNKNOWN, _RATE, _TOO_LARGE = range(1, 8)
_EMPTY, _UID, _DENIED, _TOPIC_TAKEN = 0x20, 0x22, 0x23, 0x24


class CommandDesk:
    """Read the host's frames, answer them, and keep the settings.

    ``activation``: the codes that answer successive activations, the last one repeatedly; 0 is
    success.
    """

    def __init__(
        self,
        layout: Layout = Layout.MODERN,
        packages: Sequence[Package] = (),
        activation: Sequence[int] = (0,),
    ) -> None:
        self.rates: tuple[int, ...] = RATES_BESIDE_PACKAGES if packages else USUAL_RATES
        self.packages = PackageTable(packages)
        self.activated = False
        self._name = _LEGACY_NAME if layout is Layout.LEGACY else A3_NAME
        self._activation = list(activation)
        self._reader = FrameReader()
        self._answered: tuple[tuple[int, int, bytes], bytes] | None = None

    def answer(self, data: bytes) -> bytes:
        """Return the acks to the host's bytes, cut in any way."""
        return b"".join(map(self._answer, self._reader.feed(data)))

    def _answer(self, frame: ProtocolFrame) -> bytes:
        if frame.is_ack or frame.is_encrypted or len(frame.data) < 2:
            return b""
        asked = (frame.session, frame.sequence, frame.data)
        if self._answered is None or self._answered[0] != asked:
            value, ack = self._done(frame.data), b""
            if value and frame.session:
                session, sequence = frame.session, frame.sequence
                ack = encode_frame(value, session=session, sequence=sequence, is_ack=True)
            self._answered = (asked, ack)
        return self._answered[1]  # a repeated request, whose ack was lost, gets the same ack

    def _done(self, data: bytes) -> bytes:
        request = decode_request(data)
        if isinstance(request, GetVersion):
            return encode_version_ack(0 if self.activated else NOT_ACTIVATED, _SERIAL, self._name)
        if request is not None:
            return encode_code(request, self._do(request))
        known = (data[0], data[1]) in OPCODES.values()
        return (_LENGTH).to_bytes(1 if data[0] else 2, "little") if known else b""

    def _do(self, request: Request) -> int:
        """Do what a request asks for; return the code of its ack."""
        code = 0
        match request:
            case Activate():
                left = self._activation
                code = left.pop(0) if len(left) > 1 else left[0]
                self.activated = code == 0
            case SetRates(codes) if max(codes) > _HIGHEST_RATE:
                code = 1
            case SetRates(codes):
                kept = zip(codes, self.rates, strict=True)
                self.rates = tuple(old if new == _KEEP_RATE else new for new, old in kept)
            case MatchVersion(version):
                code = 0 if version == SUBSCRIPTION_VERSION else _VERSION
            case _ if not self.activated:
                code = _DENIED
            case AddPackage(number, rate_hz, with_timestamp, uids):
                code = self._fault(request)
                if not code:
                    topics = tuple(BY_UID[uid] for uid in uids)
                    self.packages[number] = Package(number, rate_hz, with_timestamp, topics)
            case RemovePackage(number):
                code = 0 if self.packages.pop(number, None) else _UNKNOWN
            case ResetPackages():
                self.packages.clear()
        return code

    def _fault(self, request: AddPackage) -> int:
        """Return the code of why a package is refused, 0 if it is accepted."""
        known = {topic.uid for topic in TOPICS if topic.name in TOLD_TOPICS}
        topics = tuple(BY_UID[uid] for uid in request.uids if uid in known)
        taken = {topic.uid for package in self.packages.values() for topic in package.topics}
        made = Package(request.id, request.rate_hz, request.with_timestamp, topics)
        slowest_hz = min((topic.max_hz or _ANY_HZ for topic in topics), default=0)
        faults = {
            _ID: request.id not in PACKAGE_IDS,
            _EXISTS: request.id in self.packages,
            _EMPTY: not request.uids,
            _UID: len(topics) < len(request.uids),
            _TOPIC_TAKEN: taken.intersection(request.uids)
            or len(set(request.uids)) < len(request.uids),
            _RATE: not 0 < request.rate_hz <= slowest_hz,
            _TOO_LARGE: made.length > MAX_DATA_BYTES,
        }
        return next((code for code, applies in faults.items() if applies), 0)

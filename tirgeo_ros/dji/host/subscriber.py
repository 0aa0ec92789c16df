"""Subscribe to packages; report which are refused and why, and continue with the others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from tirgeo_ros.dji.host.requests import Dialogue, Exchange, ask_code
from tirgeo_ros.dji.protocol.commands import (
    PACKAGE_IDS,
    MatchVersion,
    RemovePackage,
    Request,
    ResetPackages,
    encode_request,
    explain,
)
from tirgeo_ros.dji.protocol.subscription import Package, PackageTable
from tirgeo_ros.dji.protocol.subscription_topics import BY_NAME

_DONE, _EXISTS, _UNKNOWN_PACKAGE = 0x00, 0x04, 0x05
_UNKNOWN_TOPIC, _DENIED, _OFFLINE, _NOT_AUTHORISED = 0x22, 0x23, 0x25, 0x50
#: Refusals that another try does not change: length, version, id, rate, size, none, count, topic.
_FINAL = frozenset({0x01, 0x02, 0x03, 0x06, 0x07, 0x20, 0x21, _UNKNOWN_TOPIC})
_NEEDS_ACTIVATION = frozenset({_DENIED, _NOT_AUTHORISED})

#: Topics that are left out when a package is refused with this code: those that an M600 does not
#: know (they were announced, or belong to other aircraft), and those of RTK hardware that is
#: absent or off.
_DISPENSABLE = {
    _UNKNOWN_TOPIC: frozenset({"RTK_CONNECT_STATUS", "GIMBAL_CONTROL_MODE", "HEIGHT_FUSION"}),
    _OFFLINE: frozenset(name for name in BY_NAME if name.startswith("RTK_")),
}

#: Pushes of an added package may be absent for this long, doubled each time that it is added
#: again.
_PATIENCE_S, _LONGEST_PATIENCE_S = 3.0, 60.0
_PATIENCE_PUSHES = 5  # of a slow package, in pushes


class _Status(Enum):
    WANTED = "not asked for yet"
    ADDED = "added"
    PARTIAL = "added in part"
    REFUSED = "refused"
    SILENT = "added but nothing comes"


@dataclass
class _Slot:
    package: Package
    status: _Status = _Status.WANTED
    refusal: int = _DONE
    reason: str = ""
    heard_s: float = 0.0  # time of the last push, or when it was added
    pushes: int = 0
    patience_s: float = _PATIENCE_S

    @property
    def is_on(self) -> bool:
        return self.status in {_Status.ADDED, _Status.PARTIAL}

    @property
    def is_open(self) -> bool:
        """Return whether another try may help."""
        return self.status is not _Status.ADDED and self.refusal not in _FINAL

    def set(self, status: _Status, refusal: int = _DONE, reason: str = "") -> None:
        self.status, self.refusal, self.reason = status, refusal, reason

    def is_silent(self, now_s: float) -> bool:
        rate_hz = self.package.rate_hz
        if not self.is_on or rate_hz <= 0:
            return False
        return now_s - self.heard_s > max(self.patience_s, _PATIENCE_PUSHES / rate_hz)


class Subscriber:
    """Manage the subscription of the packages ``wanted``, which may be none.

    While it runs, ``table`` is kept to what the aircraft pushes: the packages that it accepted.
    Raises DjiError for a package that cannot be requested.
    """

    def __init__(self, wanted: Sequence[Package], table: PackageTable, exchange: Exchange) -> None:
        self._table, self._exchange = table, exchange
        self._slots = {package.id: _Slot(package) for package in wanted}
        for package in wanted:
            encode_request(package.request)  # raises here, at the start, and not in flight
        self._is_clean = False  # versions match and no package of another host is left

    def hear(self, value: bytes, now_s: float) -> None:
        """Record a push, by its value."""
        slot = self._slots.get(value[0]) if value else None
        if slot is not None:
            slot.heard_s, slot.patience_s = now_s, _PATIENCE_S
            slot.pushes += 1

    def forget(self) -> None:
        """Mark everything as not asked for; the table stays until the aircraft is asked."""
        self._is_clean = False
        for slot in self._slots.values():
            slot.set(_Status.WANTED)

    def note_silence(self, now_s: float) -> bool:
        """Mark the added packages that do not come; return whether that is all of them."""
        added = [slot for slot in self._slots.values() if slot.is_on]
        silent = [slot for slot in added if slot.is_silent(now_s)]
        for slot in silent:
            slot.set(_Status.SILENT)
            slot.patience_s = min(2 * slot.patience_s, _LONGEST_PATIENCE_S)
        return bool(silent) and len(silent) == len(added)

    @property
    def is_open(self) -> bool:
        """Return whether another try may bring a package."""
        unclean = bool(self._slots) and not self._is_clean
        return unclean or any(slot.is_open for slot in self._slots.values())

    @property
    def problems(self) -> list[str]:
        """Return a line for each package that is not fully subscribed."""
        bad = [s for s in self._slots.values() if s.status not in {_Status.ADDED, _Status.WANTED}]
        return [_joined(f"package {s.package.id} {s.status.value}", s.reason) for s in bad]

    @property
    def diagnostics(self) -> dict[str, str]:
        """Return state and number of pushes of each package."""
        slots = self._slots.items()
        texts = (
            (n, f"{slot.status.value}, {slot.pushes} pushes", slot.reason) for n, slot in slots
        )
        return {f"package {n}": _joined(text, reason) for n, text, reason in texts}

    def run(self) -> Dialogue[str]:
        """Ask for everything that is open; return "" or why nothing can be subscribed to.

        Raises NoAnswerError if the aircraft does not answer.
        """
        if not self._is_clean:
            refusal = yield from self._clean()
            if refusal:
                return refusal
        for slot in self._slots.values():
            if slot.is_open:
                yield from self._add(slot)
                slot.heard_s = self._exchange.now_s
                if slot.refusal in _NEEDS_ACTIVATION:
                    return slot.reason
        return ""

    def _clean(self) -> Dialogue[str]:
        """Match versions; remove the packages that this or another host left behind."""
        match = MatchVersion()
        code = yield from self._code(match)
        if code != _DONE:
            return explain(match, code)
        code = yield from self._code(ResetPackages())
        if code != _DONE:
            for number in PACKAGE_IDS:
                yield from self._code(RemovePackage(number))
        self._is_clean = True
        return ""

    def _add(self, slot: _Slot) -> Dialogue[None]:
        if slot.status in {_Status.PARTIAL, _Status.SILENT}:
            yield from self._code(RemovePackage(slot.package.id))
        package, refusals = slot.package, []
        while (code := (yield from self._put(package))) != _DONE:
            refusals.append(code)
            left_out = _DISPENSABLE.get(code, frozenset())
            topics = tuple(topic for topic in package.topics if topic.name not in left_out)
            if not topics or len(topics) == len(package.topics):
                slot.set(_Status.REFUSED, code, explain(package.request, code))
                return
            package = package._replace(topics=topics)
        if not refusals:
            slot.set(_Status.ADDED)
            return
        refusal = _OFFLINE if _OFFLINE in refusals else refusals[-1]
        missing = [topic.name for topic in slot.package.topics if topic not in package.topics]
        words = explain(package.request, refusal)
        slot.set(_Status.PARTIAL, refusal, f"without {', '.join(missing)}: {words}")

    def _put(self, package: Package) -> Dialogue[int]:
        """Add a package; if its id exists already (its ack was lost), remove that one first."""
        request = package.request
        code = yield from self._code(request)
        if code == _EXISTS:
            yield from self._code(RemovePackage(package.id))
            code = yield from self._code(request)
        return code

    def _code(self, request: Request) -> Dialogue[int]:
        """Return the ack's code, and update the table by what was done."""
        code = yield from ask_code(request)
        if code in {_DONE, _UNKNOWN_PACKAGE}:
            self._table.learn(request)
        return code


def _joined(state: str, reason: str) -> str:
    return f"{state}: {reason}" if reason else state

"""Follow the conversation between a host and the aircraft in a capture of both directions.

Such a capture holds the requests that made the packages, which cannot be known from the pushes
alone. It also holds the answers (acks), which contain neither the request that they answer nor
their own meaning.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import NamedTuple

from tirgeo_ros.dji.link.framing import ProtocolFrame
from tirgeo_ros.dji.protocol.commands import (
    AddPackage,
    RemovePackage,
    Request,
    ResetPackages,
    decode_code,
    decode_request,
)
from tirgeo_ros.dji.protocol.subscription import Package, PackageTable

# A host waits for an answer before it asks again, so few are open; the oldest is dropped.
_MAX_OPEN = 32

_DONE = 0


class _Open(NamedTuple):
    request: Request
    before: dict[int, Package]  # the packages that were known when it was sent


class HostTraffic:
    """Match frames of both directions to requests, and keep the package table up to date."""

    def __init__(self, packages: PackageTable) -> None:
        self._packages = packages
        self._open: OrderedDict[tuple[int, int], _Open] = OrderedDict()  # by session and sequence

    def take(self, frame: ProtocolFrame) -> Request | None:
        """Return the request that a frame is or answers; None for pushes and unknown frames.

        A request for packages changes the table as it is sent, since the answer may be missing in
        the capture. An answer that refuses it changes the table back.
        """
        if frame.is_encrypted:
            return None
        number = frame.session, frame.sequence
        if frame.is_ack:
            asked = self._open.pop(number, None)
            if asked is None:
                return None
            if decode_code(asked.request, frame.value) not in {_DONE, None}:
                self._undo(asked)
            return asked.request
        request = decode_request(frame.data)
        if request is None:
            return None
        if frame.session:
            self._await(request, number)
        self._packages.learn(request)
        return request

    def _await(self, request: Request, number: tuple[int, int]) -> None:
        same = self._open.pop(number, None)
        if same is None or same.request != request:  # a repetition keeps the first one's table
            same = _Open(request, self._packages.copy())
        self._open[number] = same
        if len(self._open) > _MAX_OPEN:
            self._open.popitem(last=False)

    def _undo(self, asked: _Open) -> None:
        match asked.request:
            case ResetPackages():
                self._packages.update(asked.before)
            case AddPackage(number) | RemovePackage(number):
                self._packages.pop(number, None)
                if number in asked.before:
                    self._packages[number] = asked.before[number]

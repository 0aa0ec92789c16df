"""Decode a capture of the serial link frame by frame into plain values for JSON."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.host.overheard_traffic import HostTraffic
from tirgeo_ros.dji.link.encryption import parse_key
from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame
from tirgeo_ros.dji.protocol.broadcast import decode_broadcast
from tirgeo_ros.dji.protocol.commands import (
    AddPackage,
    GetVersion,
    Request,
    decode_code,
    decode_version_ack,
    explain,
)
from tirgeo_ros.dji.protocol.package_table import package_table
from tirgeo_ros.dji.protocol.plausibility import doubtful
from tirgeo_ros.dji.protocol.printed_fields import broadcast_fields, push_fields
from tirgeo_ros.dji.protocol.subscription import PackageTable, decode_push
from tirgeo_ros.dji.protocol.subscription_topics import BY_UID
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_file import load_yaml

Record = dict[str, Any]

_CHUNK_BYTES = 1 << 16
_CONTROL_LOST = (0x02, 0x01)


class CaptureDump:
    """Read a capture of any size; ``records`` yields its frames in order.

    ``packages`` is a YAML file as ``dji.protocol.package_table`` reads it, which replaces the
    usual packages; ``key`` is 64 hexadecimal digits, for encrypted frames.

    Raises
    ------
    DjiError
        The key is invalid, or the file of packages is no table of packages.
    ConfigError
        The file of packages cannot be read or is not YAML.
    """

    def __init__(self, path: Path, packages: PathLike | None = None, key: str = "") -> None:
        self._path = path
        table = package_table(load_yaml(packages), str(packages)) if packages else PackageTable()
        self._packages = table
        self._traffic = HostTraffic(table)
        self._reader = FrameReader(parse_key(key))
        self._kinds: Counter[str] = Counter()
        self._verdicts = {"unreadable": 0, "implausible": 0}

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of ``FrameReader`` and those of the contents.

        ``unreadable``: broadcasts that fit no layout, pushes that fit no package; ``implausible``:
        pushes with a value outside its physical range.
        """
        return self._reader.counts | self._verdicts

    @property
    def kinds(self) -> dict[str, int]:
        """Return the number of frames of each kind."""
        return dict(self._kinds)

    def records(self) -> Iterator[Record]:
        """Yield a record for each frame. Raise DjiError without any, OSError if unreadable."""
        with self._path.open("rb") as file:
            while chunk := file.read(_CHUNK_BYTES):
                yield from map(self._record, self._reader.feed(chunk))
        yield from map(self._record, self._reader.rescan())
        self._refuse_nothing()

    def _refuse_nothing(self) -> None:
        counts = self._reader.counts
        if not counts["bytes"]:
            raise DjiError(f"{self._path}: empty")
        if not counts["frames"]:
            raise DjiError(
                f"{self._path}: no frame in {counts['bytes']} bytes: it must be what an "
                "aircraft's serial port sent, recorded at the right baud rate"
            )

    def _record(self, frame: ProtocolFrame) -> Record:
        contents = self._contents(frame)
        index = self._kinds.total()
        self._kinds[contents["kind"]] += 1
        return {
            "i": index,
            "offset": frame.offset,
            "length": frame.length,
            "cmd_set": frame.cmd_set,
            "cmd_id": frame.cmd_id,
            "seq": frame.sequence,
            "session": frame.session,
            "ack": int(frame.is_ack),
            "enc": frame.encryption,
            **contents,
        }

    def _contents(self, frame: ProtocolFrame) -> Record:
        """Return a frame's kind and its decoded contents."""
        if frame.is_encrypted:
            return _kind("encrypted", {})
        match frame.cmd_set, frame.cmd_id:
            case 0x02, 0x00:
                return self._broadcast(frame.value)
            case 0x02, 0x05:
                return self._push(frame.value)
        request = self._traffic.take(frame)
        if frame.is_ack:
            return _kind("ack", _answer(request, frame.value))
        if request is not None:
            return _kind(_name(request), _request_fields(request))
        lost = (frame.cmd_set, frame.cmd_id) == _CONTROL_LOST
        return _kind("control_lost" if lost else "unknown", _bytes(frame.value))

    def _broadcast(self, value: bytes) -> Record:
        broadcast = decode_broadcast(value)
        if broadcast is None:
            self._verdicts["unreadable"] += 1
            mask = int.from_bytes(value[:2], "little") if len(value) >= 2 else None
            return {"kind": "broadcast", "layout": None, "mask": mask, "fields": {}}
        return {
            "kind": "broadcast",
            "layout": broadcast.layout.value,
            "mask": broadcast.mask,
            "fields": broadcast_fields(broadcast),
        }

    def _push(self, value: bytes) -> Record:
        push = decode_push(value, self._packages)
        if push is None:
            self._verdicts["unreadable"] += 1
            unknown: Record = {"freq_hz": None, "with_timestamp": None, "topics": [], "fields": {}}
            return {"kind": "subscription", "pkg_id": value[0] if value else None, **unknown}
        record: Record = {
            "kind": "subscription",
            "pkg_id": push.package.id,
            "freq_hz": push.package.rate_hz,
            "with_timestamp": push.package.with_timestamp,
            "topics": [_topic(topic.uid) for topic in push.package.topics],
            "fields": push_fields(push),
        }
        if implausible := doubtful(push):
            self._verdicts["implausible"] += 1
            record["implausible"] = implausible
        return record


def _kind(kind: str, fields: Record) -> Record:
    return {"kind": kind, "fields": fields}


def _bytes(value: bytes) -> Record:
    return {"hex": value.hex()} if value else {}


def _topic(uid: int) -> Record:
    known = BY_UID.get(uid)
    return {"name": known and known.name, "uid": f"0x{uid:08x}"}


def _name(request: Request) -> str:
    """Return a request's kind in snake case: AddPackage is add_package."""
    return re.sub(r"(?<!^)(?=[A-Z])", "_", type(request).__name__).lower()


def _request_fields(request: Request) -> Record:
    fields: Record = dict(request._asdict())
    if isinstance(request, AddPackage):
        fields["topics"] = [_topic(uid) for uid in fields.pop("uids")]
    return fields


def _answer(request: Request | None, value: bytes) -> Record:
    """Return the fields of an ack; its bytes if its request is not in the capture."""
    if request is None:
        return _bytes(value)
    version = decode_version_ack(value) if isinstance(request, GetVersion) else None
    if version is not None:
        return {"of": _name(request), **version._asdict()}
    code = decode_code(request, value)
    if code is None:
        return {"of": _name(request), **_bytes(value)}
    return {"of": _name(request), "code": code, "meaning": explain(request, code)}

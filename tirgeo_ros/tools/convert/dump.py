"""Decode a capture of the serial link frame by frame into plain values for JSON."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tirgeo_ros.core.types.errors import DjiError
from tirgeo_ros.dji.link.encryption import parse_key
from tirgeo_ros.dji.link.framing import FrameReader, ProtocolFrame
from tirgeo_ros.dji.protocol.broadcast import decode_broadcast
from tirgeo_ros.dji.protocol.package_table import package_table
from tirgeo_ros.dji.protocol.printed_fields import broadcast_fields, push_fields
from tirgeo_ros.dji.protocol.subscription import PackageTable, decode_push
from tirgeo_ros.io.files.whole_files import PathLike
from tirgeo_ros.io.parameters.parameter_file import load_yaml

Record = dict[str, Any]

_CHUNK_BYTES = 1 << 16


class CaptureDump:
    """Read a capture of any size; ``records`` yields its frames in order.

    ``packages`` is a YAML file as ``dji.protocol.package_table`` reads it, which replaces the
    usual packages; ``key`` is 64 hexadecimal digits, for encrypted frames. ``unreadable`` counts
    broadcasts that fit no layout and pushes that fit no package. Raises DjiError for an invalid
    key or table of packages, ConfigError for a file of packages that cannot be read.
    """

    def __init__(self, path: Path, packages: PathLike | None = None, key: str = "") -> None:
        self._path = path
        table = package_table(load_yaml(packages), str(packages)) if packages else PackageTable()
        self._packages = table
        self._reader = FrameReader(parse_key(key))
        self.kinds: Counter[str] = Counter()
        self.unreadable = 0

    @property
    def counts(self) -> dict[str, int]:
        """Return the counts of ``FrameReader`` and ``unreadable``."""
        return self._reader.counts | {"unreadable": self.unreadable}

    def records(self) -> Iterator[Record]:
        """Yield a record for each frame. Raise DjiError without any, OSError if unreadable."""
        with self._path.open("rb") as file:
            while chunk := file.read(_CHUNK_BYTES):
                yield from map(self._record, self._reader.feed(chunk))
        yield from map(self._record, self._reader.rescan())
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
        index = self.kinds.total()
        self.kinds[contents["kind"]] += 1
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
            return {"kind": "encrypted", "fields": {}}
        match frame.cmd_set, frame.cmd_id:
            case 0x02, 0x00:
                return self._broadcast(frame.value)
            case 0x02, 0x05:
                return self._push(frame.value)
        fields = {"hex": frame.value.hex()} if frame.value else {}
        return {"kind": "ack" if frame.is_ack else "unknown", "fields": fields}

    def _broadcast(self, value: bytes) -> Record:
        broadcast = decode_broadcast(value)
        if broadcast is None:
            self.unreadable += 1
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
            self.unreadable += 1
            unknown: Record = {"freq_hz": None, "with_timestamp": None, "topics": [], "fields": {}}
            return {"kind": "subscription", "pkg_id": value[0] if value else None, **unknown}
        package = push.package
        return {
            "kind": "subscription",
            "pkg_id": package.id,
            "freq_hz": package.rate_hz,
            "with_timestamp": package.with_timestamp,
            "topics": [{"name": t.name, "uid": f"0x{t.uid:08x}"} for t in package.topics],
            "fields": push_fields(push),
        }

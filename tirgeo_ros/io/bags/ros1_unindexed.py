"""Read a ROS 1 bag without its index, as a recorder that was killed leaves it: by its chunks."""

from __future__ import annotations

import os
from collections import defaultdict
from contextlib import suppress
from io import BytesIO

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.rosbag1.reader import ChunkInfo, Header, IndexData, RecordType, read_uint32

from tirgeo_ros.io.files.bounded_unpacking import MOST_BYTES, unpacked

#: Records between chunks, which say nothing that the chunks do not.
_BESIDE = (
    *(RecordType.BAGHEADER, RecordType.IDXDATA),
    *(RecordType.CHUNK_INFO, RecordType.CONNECTION),
)


class UnindexedReader(Reader):
    """Read a bag up to the first record that is not whole; it may have no message.

    A chunk that was being written is read too, unless it is compressed. ``lost_bytes`` are left
    at the end.
    """

    lost_bytes = 0

    def open(self) -> None:
        """Find the messages of the bag. Raises OSError."""
        self.bio = self.path.open("rb")
        self._size = os.fstat(self.bio.fileno()).st_size
        self._found: dict[int, Connection] = {}
        self._entries = defaultdict[int, list[IndexData]](list)
        self.bio.readline()
        self._read_to = self.bio.tell()
        # The last two: a text is no UTF-8 or a chunk is damaged, a position is not in the file.
        with suppress(ReaderError, ValueError, OSError):
            while self._read_to < self._size:
                self._take_record()
        self.lost_bytes = self._size - self._read_to
        self._finish()

    def _finish(self) -> None:
        """Give the base class what it would have of an index."""
        self.indexes = {key: sorted(self._entries[key]) for key in self._found}
        counts = {key: len(entries) for key, entries in self.indexes.items()}
        self.connections = [one._replace(msgcount=counts[key]) for key, one in self._found.items()]
        times_ns = [entry.time for entries in self.indexes.values() for entry in entries]
        if times_ns:
            self.chunk_infos = [ChunkInfo(0, min(times_ns), max(times_ns) + 1, counts)]

    def _take_record(self) -> None:
        """Take one record of the file. Raises ReaderError if it is not whole."""
        assert self.bio is not None
        begun, header = self._read_to, Header.read(self.bio)
        if header.get_uint8("op") == RecordType.CHUNK:
            self.bio.seek(begun)
            self._take_chunk(begun, header.get_string("compression"))
            return
        if header.get_uint8("op") not in _BESIDE:
            raise ReaderError("no record that stands between chunks")
        end = read_uint32(self.bio) + self.bio.tell()
        if end > self._size:
            raise ReaderError("a record is cut off")
        self._read_to = self.bio.seek(end)

    def _take_chunk(self, begun: int, compression: str) -> None:
        assert self.bio is not None
        chunk = self.read_chunk()
        left = self._size - chunk.datapos
        if not 0 < chunk.datasize <= left:  # 0 while it was being written
            if compression != "none":
                raise ReaderError("a compressed chunk is cut off")
            chunk = chunk._replace(datasize=min(left, MOST_BYTES))
        self.bio.seek(chunk.datapos)
        inside = unpacked(self.bio.read(chunk.datasize), compression)
        self.chunks[begun] = chunk
        try:
            self._take_messages(begun, inside)
        except ReaderError:
            if compression == "none":
                self._read_to = chunk.datapos + self._inside
            raise
        self._read_to = chunk.datapos + chunk.datasize

    def _take_messages(self, chunk_at: int, inside: bytes) -> None:
        """Take the records of a chunk. Raises ReaderError at one that is not whole."""
        source, self._inside = BytesIO(inside), 0
        while self._inside < len(inside):
            header = Header.read(source)
            end = read_uint32(source) + source.tell()
            if end > len(inside):
                raise ReaderError("a record is cut off")
            key = header.get_uint32("conn")
            if header.get_uint8("op") == RecordType.MSGDATA:
                entry = IndexData(header.get_time("time"), chunk_at, self._inside)
                self._entries[key].append(entry)
            elif key not in self._found:
                self._found[key] = self._connection(inside[self._inside : end])
            self._inside = source.seek(end)

    def _connection(self, record: bytes) -> Connection:
        """Return a connection's record, by the base class, which reads it from its file."""
        file, self.bio = self.bio, BytesIO(record)
        try:
            return self.read_connection()
        finally:
            self.bio = file

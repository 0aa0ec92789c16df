# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Read size, EXIF and XMP out of a JPEG or TIFF, without trusting any of its lengths.

A JPEG is read segment by segment up to its first scan (ISO/IEC 10918-1, Annex B); its XMP is in
APP1 segments (XMP specification part 3, section 1.1.3): a packet, and an extension in pieces. XMP
is XML of a camera, so it has neither document type nor entities: a text with them is refused, and
so is one of more than 1 MB. Only then does Pillow open the file.
"""

from __future__ import annotations

import math
import struct
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO
from xml.parsers import expat

from PIL import Image
from PIL.ExifTags import IFD, Base

from tirgeo_ros.io.messages.pictures import MOST_OF_FILE

#: First bytes of the files that are read.
JPEG, TIFFS = b"\xff\xd8\xff", (b"II*\0", b"MM\0*")
#: Most bytes of a file: R-JPEG have 1.5 MB, stills of 100 million pixels 60 MB.
_MOST_BYTES = 1 << 27
_MOST_OF_XMP = 1 << 20
_XMP, _EXTENSION = b"http://ns.adobe.com/xap/1.0/\0", b"http://ns.adobe.com/xmp/extension/\0"
#: Of a piece of the extension: GUID and full length, then where the piece begins (4 bytes).
_OFFSET = slice(len(_EXTENSION) + 36, len(_EXTENSION) + 40)
_APP1, _SCAN, _END = 0xE1, 0xDA, 0xD9  # markers
_ALONE = {0x01, *range(0xD0, 0xD8)}  # those without a length
_FRAMES = {*range(0xC0, 0xD0)} - {0xC4, 0xC8, 0xCC}  # those with height and width
_STRUCTURE = ("rdf:", "x:")  # elements of XMP that are no properties
_MOST_DEPTH = 64
_TIFF_SIZES = (0, 1, 1, 2, 4, 8, 1, 1, 2, 4, 8, 4, 8, 4)  # bytes of a value, by type
_PARTS_OF_PICTURE = (
    (Base.StripOffsets, Base.StripByteCounts),
    (Base.TileOffsets, Base.TileByteCounts),
)
_TOO_LARGE = f"it has more than {MOST_OF_FILE // 1_000_000} million pixels"
#: What Pillow raises for a damaged picture or EXIF.
_DAMAGES = (OSError, SyntaxError, ValueError, TypeError, LookupError, ArithmeticError)


class Unreadable(Exception):  # noqa: N818  no error of the program: the file is refused by name
    """Say in words why a file gives no still."""


@dataclass(frozen=True, eq=False, slots=True)
class Embedded:
    """Hold what a picture's file says: size, tags of EXIF by number, XMP by name.

    Names of XMP are those written, ``drone-dji:GpsLatitude``; a part of a structure follows the
    structure's name, ``drone-skydio:CameraOrientationNED/drone-skydio:Yaw``.
    """

    size: tuple[int, int]  # width, height
    tags: Mapping[int, object]  # of the picture: maker, model
    exposure: Mapping[int, object]
    gps: Mapping[int, object]
    xmp: Mapping[str, str]


def embedded_metadata(path: Path) -> Embedded:
    """Read the metadata of a JPEG or TIFF, and whether it is whole. Raise Unreadable."""
    try:
        with path.open("rb") as file:
            if (size := path.stat().st_size) > _MOST_BYTES:
                raise Unreadable(f"it has more than {_MOST_BYTES >> 20} MB")
            head = file.read(4)
            if head.startswith(JPEG):
                return _opened(file, "JPEG", _xmp_of_jpeg(file), size)
            if head in TIFFS:
                return _opened(file, "TIFF", _xmp_of_tiff(file, head), size)
    except OSError as fault:
        raise Unreadable(f"it cannot be read: {fault.strerror or fault}") from None
    raise Unreadable("it is no JPEG or TIFF" if head else "it is empty")


def _opened(file: BinaryIO, form: str, xmp: bytes, file_bytes: int) -> Embedded:
    """Return what a file of which only the XMP is read so far holds."""
    texts = properties(xmp)
    file.seek(0)
    try:
        with warnings.catch_warnings(), Image.open(file, formats=(form,)) as image:
            warnings.simplefilter("ignore")  # on EXIF that is odd
            if math.prod(image.size) > MOST_OF_FILE:
                raise Unreadable(_TOO_LARGE)
            exif, size = image.getexif(), image.size
            tags = dict(exif), exif.get_ifd(IFD.Exif), exif.get_ifd(IFD.GPSInfo)
            _check_whole(image, tags[0], file_bytes)
            return Embedded(size, *tags, texts)
    except Image.DecompressionBombError:
        raise Unreadable(_TOO_LARGE) from None
    except _DAMAGES as fault:
        raise Unreadable(f"it is cut off or damaged ({fault})") from None


def _check_whole(image: Image.Image, tags: Mapping[int, object], file_bytes: int) -> None:
    """Raise OSError for a picture that is cut off."""
    if image.format != "TIFF":
        image.draft("L", (1, 1))  # decodes to an eighth of its size
        image.load()
        return
    for offsets, counts in _PARTS_OF_PICTURE:
        starts, sizes = (_numbers(tags.get(tag, ())) for tag in (offsets, counts))
        if any(start + size > file_bytes for start, size in zip(starts, sizes, strict=True)):
            raise OSError("the file ends in the picture")


def _numbers(value: object) -> tuple[int, ...]:
    """Return a tag's whole numbers."""
    return tuple(map(int, value if isinstance(value, tuple) else [value]))


def _xmp_of_jpeg(file: BinaryIO) -> bytes:
    """Return the packet of XMP, else its extension."""
    packet, pieces, total = b"", dict[int, bytes](), 0
    for marker, length in _segments(file):
        content = file.read(length) if marker == _APP1 else b""
        if content.startswith((_XMP, _EXTENSION)):
            total = _checked(total + length)
        if content.startswith(_XMP):
            packet = packet or content[len(_XMP) :]
        elif content.startswith(_EXTENSION):
            pieces[int.from_bytes(content[_OFFSET], "big")] = content[_OFFSET.stop :]
    return packet or b"".join(piece for _, piece in sorted(pieces.items()))


def _segments(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Yield marker and length of each segment before the first scan; the file is at its begin."""
    place = 2
    while True:
        file.seek(place)
        head = file.read(4)
        if len(head) < 4 or head[0] != 0xFF:
            raise Unreadable("it is cut off or damaged (no picture follows its metadata)")
        if head[1] in {_SCAN, _END}:
            return
        if head[1] == 0xFF or head[1] in _ALONE:  # a byte of padding; a marker alone
            place += 1 if head[1] == 0xFF else 2
            continue
        length = int.from_bytes(head[2:], "big")
        yield head[1], max(length - 2, 0)
        place += 2 + max(length, 2)


def _xmp_of_tiff(file: BinaryIO, head: bytes) -> bytes:
    """Return the packet of XMP; Pillow would read one of any length."""
    order = "<" if head[:1] == b"I" else ">"
    try:
        file.seek(*struct.unpack(f"{order}I", file.read(4)))
        (count,) = struct.unpack(f"{order}H", file.read(2))
        entries = list(struct.iter_unpack(f"{order}HHII", file.read(12 * count)))
    except struct.error:
        raise Unreadable("it is cut off or damaged (no directory)") from None
    packet = b""
    for tag, kind, number, place in entries:
        size = number * (_TIFF_SIZES[kind] if kind < len(_TIFF_SIZES) else 0)
        if tag == Base.XMLPacket:
            _checked(size)
            file.seek(place)
            packet = file.read(size)
    return packet


def _checked(total: int) -> int:
    if total > _MOST_OF_XMP:
        raise Unreadable(f"its XMP has more than {_MOST_OF_XMP >> 20} MB")
    return total


def properties(packet: bytes) -> dict[str, str]:
    """Return the properties of a packet of XMP, attributes and elements. Raise Unreadable.

    Of several items (``rdf:li``) of a property the last is returned.
    """
    texts: dict[str, str] = {}
    path: list[str] = []
    current: list[str] = []

    def refuse(*_: object) -> None:
        raise Unreadable("its XMP has a document type or entities, as no camera writes it")

    def begin(name: str, attributes: dict[str, str]) -> None:
        if len(path) == _MOST_DEPTH:
            raise Unreadable("its XMP is nested too deeply")
        path.append("" if name.startswith(_STRUCTURE) else name)
        current.clear()
        for key, text in attributes.items():
            texts["/".join(filter(None, (*path, key)))] = text.strip()

    def end(_name: str) -> None:
        text = "".join(current).strip()
        if text:
            texts["/".join(filter(None, path))] = text
        path.pop()
        current.clear()

    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.StartElementHandler, parser.EndElementHandler = begin, end
    parser.CharacterDataHandler = current.append
    xml = packet[packet.find(b"<") : packet.rfind(b">") + 1]  # without padding
    try:
        parser.Parse(xml or b"<x:none/>", True)
    except (expat.ExpatError, ValueError, LookupError) as fault:
        raise Unreadable(f"its XMP is damaged ({fault})") from None
    return texts

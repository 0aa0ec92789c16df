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
so is one of more than 1 MB.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias
from xml.parsers import expat

from PIL import Image
from PIL.ExifTags import GPSTAGS, IFD, TAGS, Base

from tirgeo_ros.io.messages.pictures import MOST_OF_FILE

#: EXIF's tags by name, ``FocalLength``; XMP's properties as they are written,
#: ``drone-dji:GpsLatitude``, parts behind their structure,
#: ``drone-skydio:CameraOrientationNED/drone-skydio:Yaw``.
Fields: TypeAlias = dict[str, Any]
#: First bytes of the files that are read.
JPEG, TIFFS = b"\xff\xd8\xff", (b"II*\0", b"MM\0*")
#: Most bytes of a JPEG (stills of 100 million pixels have 60 MB), a TIFF and a text of XMP.
_MOST_OF_JPEG, _MOST_OF_TIFF, _MOST_OF_XMP = 1 << 27, 1 << 25, 1 << 20
_XMP, _EXTENSION = b"http://ns.adobe.com/xap/1.0/\0", b"http://ns.adobe.com/xmp/extension/\0"
#: Of a piece of the extension: GUID and full length, then where the piece begins (4 bytes).
_OFFSET = slice(len(_EXTENSION) + 36, len(_EXTENSION) + 40)
_APP1, _SCAN, _END = 0xE1, 0xDA, 0xD9  # markers
_ALONE = {0x01, *range(0xD0, 0xD8)}  # those without a length
_STRUCTURE = ("rdf:", "x:")  # elements of XMP that are no properties
_MOST_DEPTH = 64
_TOO_LARGE = f"it has more than {MOST_OF_FILE // 1_000_000} million pixels"
#: What Pillow raises for a damaged picture or EXIF.
_DAMAGES = (OSError, SyntaxError, ValueError, TypeError, LookupError, ArithmeticError)


class Unreadable(Exception):  # noqa: N818  no error of the program: the file is refused by name
    """Say in words why a file gives no still."""


def embedded_metadata(path: Path) -> tuple[tuple[int, int], Fields]:
    """Return width and height of a JPEG or TIFF, and its fields. Raise Unreadable."""
    try:
        with path.open("rb") as file:
            head = file.read(4)
            is_jpeg = head.startswith(JPEG)
            if not is_jpeg and head not in TIFFS:
                raise Unreadable("it is no JPEG or TIFF" if head else "it is empty")
            _check(path.stat().st_size, _MOST_OF_JPEG if is_jpeg else _MOST_OF_TIFF, "it has")
            packet = _packet(file) if is_jpeg else None
            return _opened(file, "JPEG" if is_jpeg else "TIFF", packet)
    except OSError as fault:
        raise Unreadable(f"it cannot be read: {fault.strerror or fault}") from None


def _check(size: int, most: int, what: str) -> None:
    if size > most:
        raise Unreadable(f"{what} more than {most >> 20} MB")


def _opened(file: BinaryIO, form: str, packet: bytes | None) -> tuple[tuple[int, int], Fields]:
    """Return size and fields of a picture that is whole: it is decoded, a JPEG to an eighth.

    ``packet`` is the XMP, None where it is a tag.
    """
    try:
        with _unwarned(), Image.open(file, formats=(form,)) as image:
            if math.prod(size := image.size) > MOST_OF_FILE:
                raise Unreadable(_TOO_LARGE)
            exif = image.getexif()
            xmp = properties(exif.get(Base.XMLPacket, b"") if packet is None else packet)
            tags = {**exif, **exif.get_ifd(IFD.Exif)}
            fields = {TAGS.get(tag, ""): value for tag, value in tags.items()}
            gps = {GPSTAGS.get(tag, ""): x for tag, x in exif.get_ifd(IFD.GPSInfo).items()}
            image.draft("L", (1, 1))
            image.load()
    except Image.DecompressionBombError:
        raise Unreadable(_TOO_LARGE) from None
    except _DAMAGES as fault:
        raise Unreadable(f"it is cut off or damaged ({fault})") from None
    return size, {**fields, **gps, **xmp}


@contextmanager
def _unwarned() -> Iterator[None]:
    """Keep Pillow's remarks on odd EXIF from the screen."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        yield


def _packet(file: BinaryIO) -> bytes:
    """Return the packet of XMP in a JPEG, else its extension."""
    packet, pieces, total = b"", dict[int, bytes](), 0
    for marker, length in _segments(file):
        content = file.read(length) if marker == _APP1 else b""
        if content.startswith((_XMP, _EXTENSION)):
            total += length
            _check(total, _MOST_OF_XMP, "its XMP has")
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


def properties(packet: bytes) -> dict[str, str]:
    """Return the properties of a packet of XMP, attributes and elements. Raise Unreadable.

    Of several items (``rdf:li``) of a property the last is returned.
    """
    _check(len(packet), _MOST_OF_XMP, "its XMP has")
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

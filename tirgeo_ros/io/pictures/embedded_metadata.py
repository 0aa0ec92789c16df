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

A JPEG's XMP is in APP1 segments (XMP specification part 3, section 1.1.3): a packet, and an
extension in pieces. XMP is XML of a camera, so it has neither document type nor entities: a text
with them is refused, and so is one of more than 1 MB.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias
from xml.parsers import expat

from PIL import Image
from PIL.ExifTags import GPSTAGS, IFD, TAGS, Base

from tirgeo_ros.io.messages.pictures import MOST_OF_FILE
from tirgeo_ros.io.pictures.jpeg_segments import APP1, EXTENSION, XMP, segments

#: EXIF's tags by name, ``FocalLength``; XMP's properties as they are written,
#: ``drone-dji:GpsLatitude``, parts behind their structure,
#: ``drone-skydio:CameraOrientationNED/drone-skydio:Yaw``.
Fields: TypeAlias = dict[str, Any]
#: First bytes of the files that are read.
JPEG, TIFFS = b"\xff\xd8\xff", (b"II*\0", b"MM\0*")
#: Most bytes of a JPEG (stills of 100 million pixels have 60 MB), a TIFF and a text of XMP.
_MOST_OF_JPEG, _MOST_OF_TIFF, _MOST_OF_XMP = 1 << 27, 1 << 25, 1 << 20
#: Of a piece of the extension: GUID and full length, then where the piece begins (4 bytes).
_OFFSET = slice(len(EXTENSION) + 36, len(EXTENSION) + 40)
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
        with path.open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's remarks on odd EXIF
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


def _packet(jpeg: BinaryIO) -> bytes:
    """Return the packet of XMP in a JPEG, else its extension."""
    packet, pieces, total = b"", dict[bytes, bytes](), 0
    for marker, content in segments(jpeg):
        if marker == APP1 and content.startswith((XMP, EXTENSION)):
            total += len(content)
            _check(total, _MOST_OF_XMP, "its XMP has")
            if content.startswith(EXTENSION):
                pieces[content[_OFFSET]] = content[_OFFSET.stop :]
            else:
                packet = packet or content[len(XMP) :]
    return packet or b"".join(piece for _, piece in sorted(pieces.items()))


def _opened(file: BinaryIO, form: str, packet: bytes | None) -> tuple[tuple[int, int], Fields]:
    """Return size and fields of a picture that is whole: it is decoded, a JPEG to an eighth.

    ``packet`` is the XMP, None where it is a tag.
    """
    try:
        with Image.open(file, formats=(form,)) as image:
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


def properties(packet: bytes) -> dict[str, str]:
    """Return the properties of a packet of XMP, attributes and elements. Raise Unreadable.

    Of several items (``rdf:li``) of a property the last is returned.
    """
    _check(len(packet), _MOST_OF_XMP, "its XMP has")
    texts, path, current = dict[str, str](), list[str](), list[str]()

    def refuse(*_: object) -> None:
        raise Unreadable("its XMP has a document type or entities, as no camera writes it")

    def begin(name: str, attributes: dict[str, str]) -> None:
        if len(path) == _MOST_DEPTH:
            raise Unreadable("its XMP is nested too deeply")
        path.append("" if name.startswith(_STRUCTURE) else f"{name}/")
        current.clear()
        texts.update({"".join((*path, key)): text.strip() for key, text in attributes.items()})

    def end(_name: str) -> None:
        if text := "".join(current).strip():
            texts["".join(path)[:-1]] = text
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

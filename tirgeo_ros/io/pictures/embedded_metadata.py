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

XMP is in a segment APP1 of a JPEG (XMP specification part 3, section 1.1.3), in a tag of a TIFF.
It is XML of a camera, which has no document type and so no entities: a text with one is refused.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any, BinaryIO, TypeAlias
from xml.etree import ElementTree as ET

from PIL import Image
from PIL.ExifTags import GPSTAGS, IFD, TAGS, Base

from tirgeo_ros.io.messages.pictures import MOST_OF_FILE
from tirgeo_ros.io.pictures.jpeg_segments import APP1, SOS, XMP, segments

#: EXIF's tags by name, ``FocalLength``; XMP's properties by name, whatever their prefix,
#: ``GpsLatitude``, parts behind their structure, ``CameraOrientationNED/Yaw``; Pix4D's short names
#: with it, ``Camera:Yaw``.
Fields: TypeAlias = dict[str, Any]
#: First bytes of the files that are read.
JPEG, TIFFS = b"\xff\xd8\xff", (b"II*\0", b"MM\0*")
#: Of a file (a JPEG of 50 million pixels has 30 MB), and of XMP (as much as a segment has).
_MOST_BYTES, _MOST_OF_XMP = 1 << 26, 1 << 16
_TOO_LARGE = f"it has more than {MOST_OF_FILE // 1_000_000} million pixels"
#: What Pillow raises for a damaged picture or EXIF.
_DAMAGES = (OSError, SyntaxError, ValueError, TypeError, LookupError, ArithmeticError)
#: Elements around properties, not properties themselves; the short names.
_AROUND = ("{http://www.w3.org/1999/02/22-rdf-syntax-ns#}", "{adobe:ns:meta/}")
_PIX4D = "{http://pix4d.com/camera"


class Unreadable(Exception):  # noqa: N818  no error of the program: the file is refused by name
    """Say in words why a file gives no still."""


def embedded_metadata(path: Path) -> tuple[tuple[int, int], Fields, Fields]:
    """Return width and height of a JPEG or TIFF, its EXIF and its XMP. Raise Unreadable."""
    try:
        with path.open("rb") as file, warnings.catch_warnings():
            warnings.simplefilter("ignore")  # Pillow's remarks on odd EXIF
            head = file.read(4)
            if not head.startswith((JPEG, *TIFFS)):
                raise Unreadable("it is no JPEG or TIFF" if head else "it is empty")
            if path.stat().st_size > _MOST_BYTES:
                raise Unreadable(f"it has more than {_MOST_BYTES >> 20} MB")
            return _opened(file, is_jpeg=head.startswith(JPEG))
    except OSError as fault:
        raise Unreadable(f"it cannot be read: {fault.strerror or fault}") from None


def _opened(file: BinaryIO, *, is_jpeg: bool) -> tuple[tuple[int, int], Fields, Fields]:
    """Return size, EXIF and XMP of a picture that is whole: it is decoded, a JPEG to an eighth."""
    packet, marker = b"", 0
    for marker, content in segments(file):
        if marker == APP1 and content.startswith(XMP):
            packet = packet or content[len(XMP) :]
    if is_jpeg and marker != SOS:
        raise Unreadable("it is cut off or damaged (its header has no end)")
    try:
        with Image.open(file, formats=("JPEG", "TIFF")) as image:
            if math.prod(size := image.size) > MOST_OF_FILE:
                raise Unreadable(_TOO_LARGE)
            exif = image.getexif()
            xmp = properties(packet or exif.get(Base.XMLPacket, b""))
            tags, gps = {**exif, **exif.get_ifd(IFD.Exif)}, exif.get_ifd(IFD.GPSInfo)
            image.draft("L", (1, 1))
            image.load()
    except Image.DecompressionBombError:
        raise Unreadable(_TOO_LARGE) from None
    except _DAMAGES as fault:
        raise Unreadable(f"it is cut off or damaged ({fault})") from None
    fields = {TAGS.get(tag, ""): value for tag, value in tags.items()}
    return size, fields | {GPSTAGS.get(tag, ""): value for tag, value in gps.items()}, xmp


def properties(packet: bytes) -> Fields:
    """Return the properties of a packet of XMP, attributes and elements. Raise Unreadable.

    Of several items (``rdf:li``) of a property the last is returned.
    """
    if len(packet) > _MOST_OF_XMP:
        raise Unreadable(f"its XMP has more than {_MOST_OF_XMP >> 10} kB")
    text = bytes(packet).decode("utf-8", "replace")
    xml = text[text.find("<") : text.rfind(">") + 1]  # without padding
    if "<!DOCTYPE" in xml or "\0" in xml:  # with the latter a parser sees UTF-16
        raise Unreadable("its XMP has a document type or is no UTF-8, as no camera writes it")
    try:
        root = ET.fromstring(xml or "<none/>")  # noqa: S314  no document type, no entities
    except ET.ParseError as fault:
        raise Unreadable(f"its XMP is damaged ({fault})") from None
    texts: Fields = {}
    elements = [("", root)]
    for structure, element in elements:  # the list grows by what is inside of each
        name = "" if element.tag.startswith(_AROUND) else _name(element.tag)
        inside = f"{name}/" if name else structure
        texts |= {inside + _name(key): text.strip() for key, text in element.attrib.items()}
        if own := (element.text or "").strip():
            texts[structure + name if name else structure[:-1]] = own
        elements += [(inside, child) for child in element]
    return texts


def _name(tag: str) -> str:
    space, _, name = tag.rpartition("}")
    return f"Camera:{name}" if space.startswith(_PIX4D) else name

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
"""Make stills: a small JPEG or TIFF with the EXIF and XMP of a drone's camera."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image
from PIL.ExifTags import GPS, IFD, Base

_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_URIS = {
    "drone": "http://www.autelrobotics.com/drone/1.0/",
    "drone-dji": "http://www.dji.com/drone-dji/1.0/",
    "drone-parrot": "http://www.parrot.com/drone-parrot/1.0/",
    "drone-skydio": "https://www.skydio.com/drone-skydio/1.0/",
    "Camera": "http://pix4d.com/camera/1.0/",
    "xmp": "http://ns.adobe.com/xap/1.0/",
}
#: What a Mavic 3T with fixed RTK writes, straight down at 75 m.
M3T = {
    "ImageSource": "InfraredCamera",
    "GpsStatus": "RTK",
    "AltitudeType": "RtkAlt",
    "GpsLatitude": "+51.3660000",
    "GpsLongitude": "+12.3090000",
    "AbsoluteAltitude": "+230.250",
    "RelativeAltitude": "+75.000",
    "GimbalRollDegree": "+0.00",
    "GimbalYawDegree": "+30.00",
    "GimbalPitchDegree": "-90.00",
    "FlightRollDegree": "+1.00",
    "FlightYawDegree": "+28.00",
    "FlightPitchDegree": "-3.00",
    "RtkFlag": "50",
    "RtkStdLon": "0.02",
    "RtkStdLat": "0.01",
    "RtkStdHgt": "0.03",
    "UTCAtExposure": "2024:05:10 08:30:00.250000",
}


def packet(fields: dict[str, str], *, elements: bool = False) -> bytes:
    """Return a packet of XMP, its fields as attributes or as elements; DJI's without a prefix."""
    named = {key if ":" in key else f"drone-dji:{key}": text for key, text in fields.items()}
    spaces = " ".join(f'xmlns:{prefix}="{uri}"' for prefix, uri in _URIS.items())
    inside = "".join(f"<{key}>{text}</{key}>" for key, text in named.items()) if elements else ""
    attributes = "" if elements else " ".join(f'{key}="{text}"' for key, text in named.items())
    return (
        f'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF '
        f'xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#"><rdf:Description {spaces} '
        f"{attributes}>{inside}</rdf:Description></rdf:RDF></x:xmpmeta>"
    ).encode()


def still(
    form="JPEG", *, elements=False, model="M3T", size=(640, 512), tags=None, gps=None, **fields
):
    """Return a Mavic 3T's still with some of its fields changed; None leaves one out."""
    kept = {key: text for key, text in (M3T | fields).items() if text is not None}
    exif = {"model": model, "size": size, "tags": tags, "gps": gps}
    return picture(form, packet(kept, elements=elements), **exif)


def picture(
    form="JPEG", xmp=b"", *, make="DJI", model="M3T", size=(640, 512), grey=90, tags=None, gps=None
) -> bytes:
    """Return a grey picture's file; ``tags`` and ``gps`` are EXIF's of exposure and position."""
    exif, out = Image.Exif(), io.BytesIO()
    exif[Base.Make], exif[Base.Model] = make, model
    exif[IFD.Exif] = {Base[name]: value for name, value in (tags or {}).items()}
    exif[IFD.GPSInfo] = {GPS[name]: value for name, value in (gps or {}).items()}
    if form == "TIFF" and xmp:
        exif[Base.XMLPacket] = xmp
    Image.fromarray(np.full(size[::-1], grey, np.uint8)).save(out, form, exif=exif.tobytes())
    file, content = out.getvalue(), _XMP + xmp
    if form == "TIFF" or not xmp:
        return file
    return file[:2] + b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content + file[2:]

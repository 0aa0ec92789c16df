"""Encode a still with its metadata: JPEG of 8 bits, TIFF of 16."""

from __future__ import annotations

import io

import numpy as np
from PIL import Image
from PIL.ExifTags import Base

from tirgeo_ros.core.types.arrays import RawPixels
from tirgeo_ros.io.pictures.exif import still_exif
from tirgeo_ros.io.pictures.still import Still
from tirgeo_ros.io.pictures.xmp import still_xmp

_XMP = b"http://ns.adobe.com/xap/1.0/\0"
_FIRST = (b"\xff\xe0", b"\xff\xe1")  # the segments of JFIF and EXIF


def ending_of(pixels: RawPixels) -> str:
    """Return the ending of the file's name."""
    return ".tif" if pixels.dtype == np.uint16 else ".jpg"


def still_bytes(pixels: RawPixels, still: Still) -> bytes:
    """Return the file of a picture: (h, w) of 8 or 16 bits, or (h, w, 3) BGR of 8.

    The pixels of a TIFF are unchanged; those of a JPEG are of its best quality.
    """
    return _tiff(pixels, still) if pixels.dtype == np.uint16 else _jpeg(pixels, still)


def _tiff(pixels: RawPixels, still: Still) -> bytes:
    exif = still_exif(still)
    exif[Base.XMLPacket] = still_xmp(still)
    out = io.BytesIO()
    Image.fromarray(np.ascontiguousarray(pixels)).save(out, "TIFF", exif=exif.tobytes())
    return out.getvalue()


def _jpeg(pixels: RawPixels, still: Still) -> bytes:
    rgb = pixels if pixels.ndim == 2 else pixels[..., ::-1]
    out = io.BytesIO()
    picture = Image.fromarray(np.ascontiguousarray(rgb))
    picture.save(out, "JPEG", quality=100, subsampling=0, exif=still_exif(still))
    return _with_xmp(out.getvalue(), still_xmp(still))


def _with_xmp(jpeg: bytes, packet: bytes) -> bytes:
    """Return the file with the packet behind its EXIF, as cameras write it."""
    end = 2
    while jpeg[end : end + 2] in _FIRST:
        end += 2 + int.from_bytes(jpeg[end + 2 : end + 4], "big")
    content = _XMP + packet
    segment = b"\xff\xe1" + (len(content) + 2).to_bytes(2, "big") + content
    return jpeg[:end] + segment + jpeg[end:]

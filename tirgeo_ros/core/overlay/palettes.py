"""Compute the colours of thermal pictures: tables from 256 grey levels to blue, green, red.

The palettes are our own. ``white_hot`` is the grey levels, ``black_hot`` the grey levels reversed.
Any other palette is a few colours, cold to hot, joined by straight lines in CIE L*a*b*. Lightness
is not taken from these colours: it runs linearly from the first to the last, so that a hotter
point is never darker, even on a screen without colour. Only ``rainbow`` keeps the lightness of its
colours: it separates close temperatures by hue and shows nothing by brightness.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np

from tirgeo_ros.core.config.overlay import PALETTES
from tirgeo_ros.core.types.arrays import Array, Pixels
from tirgeo_ros.core.types.errors import ConfigError

#: Red, green, blue (hex) of colours at equal distances, coldest first.
_STOPS: dict[str, tuple[str, ...]] = {
    "iron": ("00000c", "2b0a6b", "8a118f", "c9346a", "ee7a1c", "f8bf30", "fff8dc"),
    "rainbow": ("10106e", "1446d8", "12b4d2", "28c850", "e6dc28", "f07814", "dc1e1e", "fadcdc"),
    "arctic": ("040a28", "0f2f78", "2a66b8", "4fa3c4", "a8b48c", "e3b04c", "fde9a8"),
    "lava": ("000000", "3c0a0a", "82140f", "c8320a", "f07814", "fac03c", "fffae6"),
}
_UNEVEN = {"rainbow"}  # palettes that keep the lightness of their colours
_LEVELS = 256
_GREY = np.repeat(np.arange(_LEVELS, dtype=np.uint8)[:, None, None], 3, axis=2)
_GREYS = {"white_hot": _GREY, "black_hot": _GREY[::-1]}


@lru_cache(maxsize=8)
def palette_table(name: str) -> Pixels:
    """Return (256, 1, 3) BGR for grey levels 0 to 255; raise ConfigError for an unknown name."""
    if name not in PALETTES:
        raise ConfigError(f"palette: {name!r} is not one of {', '.join(PALETTES)}")
    table = np.ascontiguousarray(_GREYS[name]) if name in _GREYS else _mixed(name)
    table.setflags(write=False)
    return table


def _mixed(name: str) -> Pixels:
    stops_rgb = np.array([list(bytes.fromhex(stop)) for stop in _STOPS[name]])
    unit = (stops_rgb[:, None, ::-1] / 255).astype(np.float32)
    stops = np.asarray(cv2.cvtColor(unit, cv2.COLOR_BGR2LAB), float)[:, 0]
    place = np.linspace(0, len(stops) - 1, _LEVELS)
    lab = np.stack([np.interp(place, range(len(stops)), row) for row in stops.T], axis=1)
    if name not in _UNEVEN:
        lab[:, 0] = np.linspace(stops[0, 0], stops[-1, 0], _LEVELS)
    return _bgr(lab)


def _bgr(lab: Array) -> Pixels:
    """Return (256, 1, 3) BGR; reduce the chroma of a colour outside sRGB until it is inside.

    Clipping each channel instead would change the colour's lightness.
    """
    chroma = np.ones(len(lab))
    for _ in range(40):
        faded = lab * np.stack([np.ones_like(chroma), chroma, chroma], axis=1)
        bgr = np.asarray(
            cv2.cvtColor(faded[:, None].astype(np.float32), cv2.COLOR_LAB2BGR), np.float32
        )
        # Clipped and converted back, a colour outside sRGB has changed by more than one L*a*b*
        # unit, which is barely visible.
        again = np.asarray(cv2.cvtColor(np.clip(bgr, 0, 1), cv2.COLOR_BGR2LAB), float)[:, 0]
        outside = np.abs(again - faded).max(axis=1) > 1.0
        if not outside.any():
            break
        chroma[outside] *= 0.95
    return np.asarray(np.rint(np.clip(bgr, 0, 1) * 255), np.uint8)

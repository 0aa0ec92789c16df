"""The parts of a broadcast as documented, written down a second time for the tests."""

from __future__ import annotations

import struct

from hypothesis import strategies as st

from tirgeo_ros.dji.protocol.broadcast import Layout

#: Bytes of each part by bit, in the modern layout.
MODERN_BYTES = (15, 16, 12, 13, 12, 50, 68, 44, 6, 12, 13, 4, 13, 2, 1)

MODERN = {
    0: "IIIHB",
    1: "ffff",
    2: "fff",
    3: "fffB",
    4: "fff",
    5: "ddffB" + "ffffffB",
    6: "IIiiifff" + "ffffffIIHH",
    7: "IIddffffhBB",
    8: "hhh",
    9: "hhhhhh",
    10: "fffB",
    11: "BBBB",
    12: "IiiB",
    13: "BB",
    14: "B",
}
LEGACY = {bit: form for bit, form in MODERN.items() if bit != 14} | {
    0: "IIB",
    5: "ddffB",
    6: "IIiiifff",
    11: "B",
    12: "B",
}
FORMS = {Layout.MODERN: MODERN, Layout.LEGACY: LEGACY}


def form_of(layout, mask):
    return "<H" + "".join(form for bit, form in FORMS[layout].items() if mask >> bit & 1)


def size_of(layout, mask):
    return struct.calcsize(form_of(layout, mask))


_BITS = {"b": 8, "B": 8, "h": 16, "H": 16, "i": 32, "I": 32}


def number(code):
    """Any number that a code of ``struct`` can hold, but NaN."""
    if code in "fd":
        return st.floats(width=32 if code == "f" else 64, allow_nan=False)
    if code.isupper():
        return st.integers(0, 2 ** _BITS[code] - 1)
    return st.integers(-(2 ** (_BITS[code] - 1)), 2 ** (_BITS[code] - 1) - 1)


@st.composite
def values(draw, layout):
    """The value of a broadcast in a layout, with any parts."""
    mask = draw(st.integers(0, 2 ** len(FORMS[layout]) - 1))
    form = form_of(layout, mask)
    return struct.pack(form, mask, *[draw(number(code)) for code in form[2:]])

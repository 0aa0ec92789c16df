"""Read subtitles: cues by FFmpeg, the fields of DJI's bracket form by what its files look like."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import av

_DATE = re.compile(r"^(\d{4})-(\d\d)-(\d\d) (\d\d):(\d\d):(\d\d)[.,](\d{3})", re.MULTILINE)
_BRACKET = re.compile(r"\[([^\[\]]*)\]")
_FIELD = re.compile(r"(\w+) ?: ?([^\s\],]+)")


class Cue(NamedTuple):
    """Begin and end, s; the fields by name; the whole text."""

    begin_s: float
    end_s: float
    fields: dict[str, str]
    text: str

    def numbers(self, *names: str) -> list[float]:
        return [float(self.fields[name]) for name in names]


def cues_of(path: Path) -> list[Cue]:
    """The cues as FFmpeg's reader of SubRip finds them."""
    found = []
    with av.open(str(path)) as container:
        for packet in container.demux(subtitles=0):
            if packet.pts is None:
                continue
            text = bytes(packet).decode()
            begin, length = (x * packet.time_base for x in (packet.pts, packet.duration))
            found.append(Cue(float(begin), float(begin + length), fields_of(text), text))
    return found


def fields_of(text: str) -> dict[str, str]:
    """What stands in brackets, and in the two lines before them."""
    fields = dict(_FIELD.findall(text.partition("[")[0].partition("\n")[0]))
    for part in _BRACKET.findall(text):
        fields |= dict(_FIELD.findall(part))
    if date := _DATE.search(text):
        fields["date"] = date.group()
    return fields

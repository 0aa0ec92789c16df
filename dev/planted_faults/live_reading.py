"""What a recording of the graph tells of a fault: who named it when, and what pictures said."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tirgeo_ros.core.overlay.status_and_notices import VERDICT_BGR, status_box
from tirgeo_ros.core.overlay.text_rendering import line_px, text_px
from tirgeo_ros.core.types.arrays import Pixels
from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.io import messages as convert
from tirgeo_ros.io.bags.bag import BagReader, Cdr

_WORSE = (Severity.CAUTION, Severity.STOP)
#: Under words the picture is darkened to a seventh. JPEG leaves the colour of a letter's middle
#: this near, and grey ones greyer than that; a word has hundreds of such pixels.
_DARK, _NEAR, _COLOURED, _FEWEST_PX = 45, 60, 90, 30


@dataclass(frozen=True)
class Report:
    """A finding that a node reported, worse than a note."""

    at_s: float  # of the recording's clock
    node: str
    finding: Finding

    def names(self, parameters: Iterable[str]) -> bool:
        """Return whether one of these is in the parameter that it names."""
        return any(name in self.finding.parameter for name in parameters)


@dataclass(frozen=True)
class Picture:
    """An overlay picture: when it was taken, and what it says."""

    at_s: float
    notice: bool  # at its top, from the checks
    green: bool  # neither that, nor anything in colour in the status line


def read_reports(recording: Path, begin_ns: int) -> list[Report]:
    """Return what the nodes' checks found, in order; seconds count from ``begin_ns``."""
    cdr = Cdr()
    reports: list[Report] = []
    for item in BagReader(recording).messages(["/tirgeo/findings"]):
        node, stamp_ns, findings = convert.findings_of(cdr.deserialize(item.data, item.typename))
        at_s = (stamp_ns - begin_ns) * 1e-9
        worse = [one for one in findings if one.severity is not Severity.NOTE]
        reports += [Report(at_s, node.strip("/"), one) for one in worse]
    return reports


def seen(at_s: float, pixels: Pixels) -> Picture:
    """Return what an overlay picture (h, w, 3) BGR says of the checks and the filter."""
    top = pixels[: line_px(text_px(pixels)), : pixels.shape[1] // 2]
    strip = float(np.median(top)) < _DARK
    notice = strip and any(_count(top, VERDICT_BGR[one]) > _FEWEST_PX for one in _WORSE)
    status = pixels[status_box(pixels).top :].astype(np.int16)
    coloured = np.count_nonzero(np.ptp(status, axis=2) > _COLOURED) > _FEWEST_PX
    return Picture(at_s, notice, green=not (notice or coloured))


def _count(pixels: Pixels, colour: Sequence[int]) -> int:
    off = np.abs(pixels.astype(np.int16) - np.array(colour, np.int16)).max(axis=2)
    return int(np.count_nonzero(off < _NEAR))

"""Define what a reader of a foreign log gives."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

from tirgeo_ros.io.messages import SensedSample


@dataclass(frozen=True)
class LogOptions:
    """Hold what a log does not say itself."""

    geoid_undulation_m: float | None = None  # for heights above mean sea level
    baseline_m: float | None = None  # between the two antennas: other lengths are refused


@dataclass
class LogContents:
    """Hold the samples of a log, with stamps in ns of Unix time (UTC), and what was left out.

    ``read`` counts the log's records by name, ``refused`` those that gave no sample, by name and
    reason. ``notes`` say in a sentence each what the log left open and how it was taken.
    """

    samples: list[SensedSample] = field(default_factory=list)
    read: Counter[str] = field(default_factory=Counter)
    refused: Counter[tuple[str, str]] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)

"""Define what a reader of a foreign log takes and gives."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

from tirgeo_ros.core.types.errors import LogError
from tirgeo_ros.core.types.measurements import PositionSample, Source, VelocitySample
from tirgeo_ros.io.logs.log_times import SECOND_NS, WrittenTime
from tirgeo_ros.io.messages import SensedSample

ELLIPSOIDAL, MSL, TAKEOFF = DATUMS = ("ellipsoidal", "msl", "takeoff")


class Refused(Exception):  # noqa: N818  no error: the record is counted
    """Say why a record of a log gives no sample."""


@dataclass(frozen=True)
class LogOptions:
    """Hold what a log does not say itself; None or empty: not given."""

    geoid_undulation_m: float | None = None  # for heights above mean sea level
    baseline_m: float | None = None  # between the two antennas: other lengths are refused
    baseline_rad: float = 0.0  # direction from the first antenna to the second, from the nose
    rover_first: bool = False  # the first antenna is the rover's, the second the moving base's
    takeoff_height_m: float | None = None  # ellipsoidal, for heights above the take-off
    height: str = ""  # datum of heights where the log does not tell it: ellipsoidal or msl
    time_scale: str = ""  # of times where the log does not tell it: gpst or utc
    utc_offset_s: int | None = None  # of local times, east positive
    start_ns: int | None = None  # UTC of the log's first record, where it has no date
    set_heading_rad: float | None = None  # of the nose, as a person says
    columns: Path | None = None  # what the columns of a CSV file mean

    def to_ellipsoid_m(self, datum: str, path: Path) -> float:
        """Return what is added to heights above ``datum``, one of DATUMS.

        Raise LogError, naming the option, where that is not known.
        """
        known: dict[str, tuple[float | None, str]] = {
            ELLIPSOIDAL: (0.0, ""),
            MSL: (
                self.geoid_undulation_m,
                "above mean sea level: give the geoid's height there with --geoid-undulation",
            ),
            TAKEOFF: (
                self.takeoff_height_m,
                "above the take-off: give that place's ellipsoidal height with --takeoff-height",
            ),
        }
        offset_m, mend = known[datum]
        if offset_m is None:
            raise LogError(f"{path}: its heights are {mend}")
        return offset_m

    def utc_ns(self, written: WrittenTime, path: Path) -> int:
        """Return the Unix time of a written one; raise LogError without a zone for local times."""
        offset_s = self.utc_offset_s if written.offset_s is None else written.offset_s
        if offset_s is None:
            raise LogError(
                f"{path}: its times are local, without a zone: give --utc-offset, as +02:00"
            )
        return written.local_ns - offset_s * SECOND_NS


@dataclass
class LogContents:
    """Hold the samples of a log, with stamps in ns of Unix time (UTC), and what was left out.

    ``read`` counts the log's records by name, ``refused`` those that gave no sample, by name and
    reason. ``notes`` say in a sentence each what the log left open and how it was taken. A
    ``damaged`` file, or one that was cut off, may have held more than that.
    """

    samples: list[SensedSample] = field(default_factory=list)
    read: Counter[str] = field(default_factory=Counter)
    refused: Counter[tuple[str, str]] = field(default_factory=Counter)
    notes: list[str] = field(default_factory=list)
    damaged: bool = False


_ORDINARY = {Source.RTK_POSITION: Source.GPS_POSITION, Source.RTK_VELOCITY: Source.GPS_VELOCITY}


def say_receiver(contents: LogContents, name: str, *, is_rtk: bool) -> None:
    """Make the samples of a receiver that was never RTK float or fixed those of ordinary GPS.

    The filter has no use for ``rtk/fix`` of such a one. Which it is becomes a note.
    """
    if not is_rtk:
        contents.samples = [
            replace(sample, source=_ORDINARY[sample.source])
            if isinstance(sample, PositionSample | VelocitySample)
            else sample
            for sample in contents.samples
        ]
    contents.notes.append(
        f"{name} was {'' if is_rtk else 'never '}RTK float or fixed: its positions are "
        f"{'rtk/fix' if is_rtk else 'gps/fix'}"
    )

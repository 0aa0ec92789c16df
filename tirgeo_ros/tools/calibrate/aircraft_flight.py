"""Read a recorded flight into memory, for a calibration that filters it many times."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

from tirgeo_ros.core.aircraft_calibration.filter_run import Recorded, longest_piece
from tirgeo_ros.core.navigation.aiding.state_estimate import Aiding, source_of
from tirgeo_ros.core.navigation.duplicates import DuplicateDetector, Same
from tirgeo_ros.core.streams.arrival_stamps import Arrivals
from tirgeo_ros.core.streams.sanity_checks import fault_of
from tirgeo_ros.core.types.errors import BagError, CalibrationError, MessageError
from tirgeo_ros.core.types.measurements import ImuSample, NavigationInput, Source
from tirgeo_ros.io.bags.bag import BagReader, Cdr
from tirgeo_ros.io.messages import NAVIGATION_INPUTS, TOPIC_TYPES
from tirgeo_ros.tools.presentation.progress import Report
from tirgeo_ros.tools.replay.flight_topics import resolved

_SOURCES = (Source.IMU, Source.RTK_POSITION, Source.RTK_VELOCITY, Source.RTK_HEADING)
_NEEDED = (Source.IMU, Source.RTK_POSITION)
_LEAST_S = 20.0


@dataclass(frozen=True)
class ReadAircraft:
    """Hold a flight, its length (s) and notes on what was left out of it."""

    recorded: Recorded
    seconds: float
    notes: list[str]


def read_aircraft(
    reader: BagReader, namespace: str, max_gap_s: float, progress: Report
) -> ReadAircraft:
    """Read a bag once. Raise BagError if a needed topic is absent, or CalibrationError."""
    topics = _topics(reader, namespace)
    imu: list[ImuSample] = []
    aids: dict[tuple[Source, int], Aiding] = {}
    left_out: Counter[str] = Counter()
    repeats, newest_ns = DuplicateDetector(), 0
    for source, sample in _samples(reader, topics, left_out, progress):
        if fault_of(sample):
            left_out[f"invalid {NAVIGATION_INPUTS[source][0]}"] += 1
        elif isinstance(sample, ImuSample):
            if sample.stamp_ns > newest_ns:
                imu.append(sample)
                newest_ns = sample.stamp_ns
            else:
                left_out["imu/data out of order"] += 1
        elif repeats.compared(sample) is not Same.MEASUREMENT:
            aids.setdefault((source_of(sample), sample.stamp_ns), sample)
    return _piece(reader, imu, list(aids.values()), max_gap_s, left_out)


def _topics(reader: BagReader, namespace: str) -> dict[str, Source]:
    """Return the sources in the bag: resolved topic name -> source."""
    present = reader.topics()
    found = {}
    for source in _SOURCES:
        topic = NAVIGATION_INPUTS[source][0]
        name = resolved(topic, namespace)
        if present.get(name) == TOPIC_TYPES[topic]:
            found[name] = source
        elif source in _NEEDED:
            hint = "" if namespace else "; is there a --namespace?"
            raise BagError(f"{reader.path}: needed topic absent: {name}{hint}")
    return found


def _samples(
    reader: BagReader, topics: dict[str, Source], left_out: Counter[str], progress: Report
) -> list[tuple[Source, NavigationInput]]:
    cdr, arrivals = Cdr(), Arrivals()
    first_ns, last_ns = reader.span_ns
    found = []
    for message in reader.messages(topics):
        progress((message.log_time_ns - first_ns) * 1e-9, (last_ns - first_ns) * 1e-9)
        source = topics[message.topic]
        topic, decoded = NAVIGATION_INPUTS[source]
        try:
            sample = decoded(cdr.deserialize(message.data, message.typename))
        except MessageError:
            left_out[f"unreadable {topic}"] += 1
            continue
        found.append((source, arrivals.stamped(topic, sample, message.log_time_ns)))
    return found


def _piece(
    reader: BagReader,
    imu: list[ImuSample],
    aids: list[Aiding],
    max_gap_s: float,
    left_out: Counter[str],
) -> ReadAircraft:
    """Return the longest part without a gap; raise CalibrationError if it is too short."""
    notes = [f"left out: {number} {what}" for what, number in left_out.items()]
    begin, end = longest_piece(imu, max_gap_s) if imu else (0, 0)
    piece = imu[begin:end]
    seconds = (piece[-1].stamp_ns - piece[0].stamp_ns) * 1e-9 if piece else 0.0
    if seconds < _LEAST_S:
        raise CalibrationError(
            f"{reader.path}: only {seconds:.1f} s of imu/data without a gap; record a flight of "
            "three minutes with turns"
        )
    if len(piece) < len(imu):
        notes.append(f"imu/data has gaps: the longest part, {seconds:.0f} s, is used")
    return ReadAircraft(Recorded(piece, aids), seconds, notes)

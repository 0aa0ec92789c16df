"""What a soak must show, beside what it has shown."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import count

import numpy as np

from dev.soak.balance import FATES, Balance
from dev.soak.flight import SoakFlight
from dev.soak.lives import Life
from dev.soak.records import Ledger, Record
from dev.soak.run import WITNESS
from dev.soak.schedule import GUEST
from dev.soak.truth import deviations, has_lines, lines_without_pose, witnessed
from tirgeo_ros.core.config import OverlayConfig
from tirgeo_ros.core.types.arrays import Array

#: What is asked, at the most.
GROWTH, SIGMAS = 0.02, 4.0
#: So long may no pose and no picture come, by the clock on the wall: a node is down for 3 s, and
#: on a machine with much other work takes many more to start and to be found.
SILENCE_S = 60.0
SETTLED_S = 60.0
#: Means over so long are compared: single samples show what a frame borrows.
_BLOCK_S = 15.0
Sample = tuple[float, int, int]  # seconds of life, bytes resident, bytes of them shared


@dataclass(frozen=True)
class Figure:
    """One line of the table."""

    what: str
    value: float
    unit: str = ""
    asked: float | None = None  # at the most; None: told, not judged

    @property
    def missed(self) -> bool:
        """Whether it is not what is asked; what is not a number is not."""
        return self.asked is not None and not self.value <= self.asked


@dataclass(frozen=True)
class Growth:
    """How much more memory a process has later than after its first minute: parts of that.

    A process's own memory is judged: what is resident, less the pages of shared memory. These are
    all of Fast DDS's segments, each of which the process that makes it fills whole at its start; a
    reader counts those pages of a peer's segment as resident that it has ever read from.
    docs/soak.md tells why they become more where a peer is killed, and the table how many did.
    """

    own: float
    resident: float  # with the pages of shared memory that it has touched


def growth(samples: Sequence[Sample]) -> Growth | None:
    """The growth of one life, None where it was too short to have a later block."""
    means: list[Array] = []  # own and resident bytes of each block
    for number in count():
        begin_s = SETTLED_S + number * _BLOCK_S
        block = [sample for sample in samples if begin_s <= sample[0] < begin_s + _BLOCK_S]
        if not block or samples[-1][0] < begin_s + _BLOCK_S:
            break
        _, resident, shared = np.mean(block, axis=0)
        means.append(np.array([resident - shared, resident]))
    return Growth(*(np.max(means[1:], axis=0) / means[0] - 1)) if len(means) > 1 else None


def worst_growth(lives: Sequence[Life]) -> dict[str, Growth | None]:
    """By node the largest growth of its lives; None where each was too short to tell."""
    by_node: dict[str, list[Growth]] = {life.node: [] for life in lives}
    for life in lives:
        if (grown := growth(life.memory)) is not None:
            by_node[life.node].append(grown)
    return {
        node: Growth(max(g.own for g in grown), max(g.resident for g in grown)) if grown else None
        for node, grown in by_node.items()
    }


def memory_figures(lives: Sequence[Life], *, short: bool = False) -> Iterator[Figure]:
    """The growth of each node; the witness's is not the product's. A short soak cannot tell."""
    for node, grown in worst_growth([life for life in lives if life.node != GUEST]).items():
        own, resident = (grown.own, grown.resident) if grown else (math.nan, math.nan)
        judged = node != WITNESS and not (short and grown is None)
        asked = 100 * GROWTH if judged else None
        yield Figure(f"{node}: memory grown after its first minute", 100 * own, "%", asked)
        yield Figure("  with the pages of shared memory that it has touched", 100 * resident, "%")


def leftover_figures(
    left_files: Sequence[str], left_processes: Sequence[int], by_themselves: Sequence[str]
) -> Iterator[Figure]:
    """What is left, and who went without being asked.

    A killed process's ports (0.1 MB each) stay until the next one takes their numbers: to remove
    one might cut off that next one.
    """
    ports = [name for name in left_files if "port" in name]
    yield Figure("segments left in shared memory", len(left_files) - len(ports), "", 0)
    yield Figure("  files of ports left there", len(ports))
    yield Figure("processes left", len(left_processes), "", 0)
    yield Figure("nodes that ended by themselves or with an error", len(by_themselves), "", 0)


def frame_figures(found: Balance) -> Iterator[Figure]:
    """The balance of the frames."""
    yield Figure("frames sent", found.sent)
    for key, words in FATES.items():
        yield Figure(f"  {words}", found.fates[key])
    yield Figure("  sent while overlay_node was down or had not found the sender", found.down)
    yield Figure("  after the last report of a killed overlay_node", found.died)
    yield Figure("  last and first frames of a killed player and its successor", found.changed)
    yield Figure("  without account", found.unaccounted + abs(found.sent - found.told), "", 0)
    yield Figure("reports that contradict themselves", len(found.contradictions), "", 0)
    yield Figure("lives of overlay_node of 20 s and more without a line", found.blind, "", 0)


def pose_figures(record: Record, ledger: Ledger, flight: SoakFlight) -> Iterator[Figure]:
    """The poses against the truth, in sigmas, axis by axis."""
    found = deviations(
        record.poses, flight.cameras, ledger.shift_ns, flight.period_ns, flight.start_ns
    )
    sigmas = found.sigmas if len(found.sigmas) else np.full((1, 6), math.nan)
    yield Figure("camera poses", len(found.stamps_ns))
    yield Figure("  at times of which nothing was sent", found.strangers, "", 0)
    position, attitude = float(sigmas[:, :3].max()), float(sigmas[:, 3:].max())
    yield Figure("  farthest from the truth, position", position, "sigma", SIGMAS)
    yield Figure("  farthest from the truth, attitude", attitude, "sigma", SIGMAS)
    yield Figure("longest time without a pose", _silence(record.poses.came_s), "s", SILENCE_S)


def picture_figures(record: Record, lives: Sequence[Life]) -> Iterator[Figure]:
    """The pictures with lines, and those of them that had no pose."""
    latency_ns = round(OverlayConfig().video_latency_s * 1e9)
    gimbals = [life.began_s for life in lives if life.node == "gimbal_node"]
    judged = witnessed(record.pictures, record.poses, gimbals, latency_ns)
    wrong = lines_without_pose(judged, record.poses.stamps_ns, latency_ns)
    came_s = np.array([picture.came_s for picture in record.pictures])
    yield Figure("pictures with lines", sum(map(has_lines, judged)))
    yield Figure("  where there is no pose", len(wrong), "", 0)
    left_out = len(record.pictures) - len(judged)
    yield Figure("pictures not judged: the witness had not found the poses", left_out)
    yield Figure("longest time without a picture", _silence(came_s), "s", SILENCE_S)


def _silence(came_s: Array) -> float:
    """The longest time between two that came; infinite where none or one did."""
    return float(np.diff(came_s).max()) if len(came_s) > 1 else math.inf


def table(figures: Sequence[Figure]) -> list[str]:
    """The figures as lines of text; those that are missed are marked."""
    lines = [f"{'':<66}{'measured':>10}  {'asked':>8}"]
    for figure in figures:
        asked = "" if figure.asked is None else f"<= {figure.asked:g}"
        whole = float(figure.value).is_integer()
        value = f"{figure.value:.0f}" if whole else f"{figure.value:.2f}"
        mark = " !" if figure.missed else ""
        lines.append(f"{figure.what:<66}{value:>10}  {asked:>8} {figure.unit}{mark}")
    return lines


def as_json(figures: Sequence[Figure]) -> list[dict[str, object]]:
    """The figures for a file; what is not a number is null."""
    return [
        asdict(figure) | {
            "value": figure.value if math.isfinite(figure.value) else None,
            "missed": figure.missed,
        }
        for figure in figures
    ]  # fmt: skip

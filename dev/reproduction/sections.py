"""What every part of the page is made of, and how much is simulated for it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from dev.reproduction.script import WORK, Results, Step, shell

SCENARIO = "config/scenarios/paper_flight.yaml"
FLIGHT = f"{WORK}/flight"


@dataclass(frozen=True)
class Amounts:
    """How much is simulated."""

    hours: float = 5.0  # of an IMU at rest
    seeds: Sequence[int] = (1, 2, 3, 4, 5)  # of flights beside the paper's
    calibration_seed: int = 11  # of the flight that a calibration is made from
    window: str = ""  # of a flight: all
    views: int = 40  # of a board
    seconds: float = 30.0  # of a board's video


#: Little of all: for a look at the page, and for tests. Its numbers say nothing.
QUICK = Amounts(0.05, (1,), 11, " --start 25 --duration 30", 8, 1.5)


@dataclass(frozen=True)
class Section:
    """A heading, commands, and what is told of their results and those of the parts before."""

    title: str
    steps: Sequence[Step]
    tell: Callable[[Results], str]

    def text(self, found: Results) -> str:
        """In Markdown."""
        block = [f"```sh\n{shell(self.steps)}\n```"] if self.steps else []
        return "\n\n".join([f"## {self.title}", *block, self.tell(found)])


def evaluation(flight: str, output: str, *params: str, boresight: str) -> str:
    """The command that evaluates a flight in a folder, with more parameter files than its own."""
    return f"tirgeo evaluate {_inputs(flight, params)} --boresight {boresight} -o {output}"


def calibration(flight: str, output: str, *params: str) -> str:
    """The command that finds a boresight from a flight in a folder."""
    return f"tirgeo calibrate boresight {_inputs(flight, params)} -o {output}"


def _inputs(flight: str, params: Sequence[str]) -> str:
    files = " ".join(f"--params {path}" for path in (f"{flight}/params.yaml", *params))
    return (
        f"{flight}/flight.mcap --survey {flight}/survey.geojson "
        f"--observations {flight}/observations.csv {files}"
    )

"""Record features that cannot be drawn, so that the rest of their file can be."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field

from tirgeo_ros.core.types.errors import MapError

_MOST_NAMED = 3


class FeatureError(MapError):
    """Report why a feature, or a part of it, cannot be drawn."""


@dataclass(slots=True)
class Faults:
    """Hold the features that are left out, wholly or in part, and the first ones' reasons.

    ``numbers`` count from 0 in the order of the file.
    """

    numbers: set[int] = field(default_factory=set)
    why: dict[int, str] = field(default_factory=dict)

    def add(self, feature: int, why: str) -> None:
        """Record a feature; if it is recorded already, its first reason stays."""
        self.numbers.add(feature)
        if len(self.why) < _MOST_NAMED:
            self.why.setdefault(feature, why)

    def notes(
        self, where: str, name: Callable[[int], str], drawn: Collection[int]
    ) -> Iterator[str]:
        """Yield a line for each of the first features, and one for the rest.

        ``name`` returns a feature's name; ``drawn`` are the features of which a part is drawn.
        """
        for number, why in self.why.items():
            part = "part of " if number in drawn else ""
            yield f"{where}: {part}{_called(number, name)}: {why}; left out"
        more = len(self.numbers) - len(self.why)
        if more:
            yield f"{where}: {more} more features left out, wholly or in part"

    def refusal(self, where: str, name: Callable[[int], str]) -> str:
        """Return why nothing of a table can be drawn; "" if no feature is at fault."""
        if not self.why:
            return ""
        first, why = next(iter(self.why.items()))
        count = len(self.numbers)
        rest = f" (none of {count} features can be drawn)" if count > 1 else ""
        return f"{where}: {_called(first, name)}: {why}{rest}"


def _called(number: int, name: Callable[[int], str]) -> str:
    text = name(number)
    return f"feature {number + 1} ({text})" if text else f"feature {number + 1}"

"""Select which properties of features are read, and which features are drawn."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from tirgeo_ros.io.maps.condition import Condition
from tirgeo_ros.io.maps.label_rule import LabelRule


@dataclass(frozen=True, slots=True)
class Wanted:
    """Hold the label rule of a layer's features, and the condition for drawing them."""

    label: LabelRule = LabelRule()
    condition: Condition | None = None  # None: all are drawn

    def columns(self, known: Collection[str], where: str) -> list[str]:
        """Return the table's own names of the properties to read, each once.

        Raises ConfigError for an unknown one that a style sheet wants as a label.
        """
        names = self.label.columns(known, where)
        if self.condition:
            names += self.condition.columns(known)
        return [name for name in dict.fromkeys(names) if name is not None]

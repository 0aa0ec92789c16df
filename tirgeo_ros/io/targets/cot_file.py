"""Write the pixels of ``tirgeo locate`` as Cursor-on-Target."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree import ElementTree as ET

from tirgeo_ros.io.cot.target_events import target_event
from tirgeo_ros.io.surveys.survey import Answered
from tirgeo_ros.io.targets.rows import of_answers


def cot(answers: Sequence[Answered]) -> str:
    """Return Cursor-on-Target 2.0: an ``event`` for each located point, in a root ``events``.

    The events are those of targets, as the operator's page sends them; the time is the picture's.
    """
    root = ET.Element("events")
    targets = [row.target for row in of_answers(answers) if row.target is not None]
    root.extend([target_event(target, target.changed_ns) for target in targets])
    ET.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(root, "unicode") + "\n"

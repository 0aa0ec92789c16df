"""Read the quality of service that recorders note with a topic: ``offered_qos_profiles``.

It is a YAML list with one entry for each publisher. Its policies are numbers in the bags of Humble
and before, and words in those of Jazzy.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import yaml

from tirgeo_ros.io.messages.offered_qos import offered_qos

#: The numbers of rmw/types.h.
_WORDS = {
    "history": ("system_default", "keep_last", "keep_all", "unknown"),
    "reliability": ("system_default", "reliable", "best_effort", "unknown"),
    "durability": ("system_default", "transient_local", "volatile", "unknown"),
    "liveliness": ("system_default", "automatic", "manual_by_node", "manual_by_topic", "unknown"),
}


def qos_in_words(topic: str, metadata: Mapping[str, str]) -> str:
    """Return the QoS of a recorded topic as Jazzy writes it.

    Without one, or with one that cannot be read, it is what tirgeo would offer.
    """
    text = metadata.get("offered_qos_profiles", "")
    publishers = _publishers(text)
    if not publishers:
        return offered_qos(topic).text
    numbered = [one for one in publishers if any(isinstance(one.get(key), int) for key in _WORDS)]
    if not numbered:
        return text
    for one in numbered:
        one.update({key: _word(key, one.get(key)) for key in _WORDS})
    return str(yaml.safe_dump(publishers, sort_keys=False)).strip()


def is_latched(topic: str, metadata: Mapping[str, str]) -> bool:
    """Return whether late subscribers of a recorded topic get its last message."""
    publishers = _publishers(qos_in_words(topic, metadata))
    return any(one.get("durability") == "transient_local" for one in publishers)


def _publishers(text: str) -> list[dict[str, Any]]:
    try:
        found = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError):
        return []
    entries = found if isinstance(found, list) else []
    return [one for one in entries if isinstance(one, dict)]


def _word(key: str, value: object) -> str:
    words = _WORDS[key]
    return words[value] if isinstance(value, int) and 0 <= value < len(words) else str(value)

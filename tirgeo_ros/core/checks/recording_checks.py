"""Check topics before their messages are read: absent, of another type or name.

The topics are those of a recording or of a running graph.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from tirgeo_ros.core.types.finding import Finding, Severity
from tirgeo_ros.core.types.verdicts import NavigationStatus

_PICTURES = ("thermal/image_raw", "thermal/image_raw/compressed")
_GIMBAL = ("gimbal/joint_states", "gimbal/attitude")
_CAMERA_INFO = "thermal/camera_info"
_POSITIONS = ("rtk/fix", "gps/fix")
_UNREADABLE_SHARE = 0.01


@dataclass(frozen=True)
class RecordedTopics:
    """Hold the topics of a bag or a graph, and those that it should have."""

    topics: Mapping[str, str]  # name to type, of the bag or the graph
    contract: Mapping[str, str]  # topic to type, of the inputs, without a namespace
    namespace: str = ""
    has_camera: bool = False  # whether a calibration replaces thermal/camera_info
    wants_pictures: bool = True  # whether something may be drawn
    live: bool = False  # whether it is a graph, not a bag

    def name(self, topic: str) -> str:
        """Return the full name of an input topic."""
        space = self.namespace.strip("/")
        return f"/{space}/{topic}" if space else f"/{topic}"

    @property
    def there(self) -> set[str]:
        """Return the input topics that are present with the right type."""
        names = self.contract.items()
        return {topic for topic, kind in names if self.topics.get(self.name(topic)) == kind}

    def elsewhere(self, wanted: Sequence[str]) -> list[tuple[str, str]]:
        """Return ``wanted`` input topics with the names that they have in other namespaces."""
        return [
            (topic, name)
            for name, kind in self.topics.items()
            for topic in wanted
            if name.endswith(f"/{topic}") and kind == self.contract[topic]
            if name != self.name(topic)
        ]


def recording_findings(recording: RecordedTopics) -> list[Finding]:
    """Return what is wrong with a recording's or a graph's topics."""
    contract = list(recording.contract)
    others = recording.elsewhere(contract)
    if others and not any(recording.name(topic) in recording.topics for topic in contract):
        spaces = [name.rsplit("/", topic.count("/") + 1)[0] for topic, name in others]
        space = max(spaces, key=spaces.count).strip("/")
        evidence = (
            f"no input topic under {recording.name('')}; there are {len(others)} in other "
            f"namespaces, most of them in /{space}"
        )
        mend = f"did you mean --namespace {space or '/'}?"
        # All other findings would follow from it.
        return [Finding("namespace", Severity.STOP, evidence, "--namespace", mend)]
    needed: list[tuple[str, ...]] = [("imu/data",), _POSITIONS]
    if recording.there.intersection(_PICTURES):
        needed += [_GIMBAL] if recording.has_camera else [_GIMBAL, (_CAMERA_INFO,)]
    found = needed_findings(recording, needed)
    if not recording.wants_pictures:  # poses of the body are made without gimbal and lens
        found = [_poses_only(one) for one in found]
    seen = {*recording.there, *(finding.parameter for finding in found)}
    if recording.wants_pictures and not seen.intersection(_PICTURES):
        found.append(_no_pictures(recording))
    return found


def _no_pictures(recording: RecordedTopics) -> Finding:
    """Return that a flight was recorded without pictures, or has them under another name."""
    kinds = {recording.contract[topic] for topic in _PICTURES}
    near = [name for name, kind in recording.topics.items() if kind in kinds]
    evidence = f"no picture: neither {' nor '.join(map(recording.name, _PICTURES))}"
    evidence += f" (there is {', '.join(near)})" if near else ""
    severity = Severity.STOP if near else Severity.NOTE
    mend = "give --namespace or a remapping" if near else "to draw, record the camera's topic"
    return Finding("no_pictures", severity, evidence, "thermal/image_raw", mend)


def _poses_only(found: Finding) -> Finding:
    """Return a finding that is a caution if what it lacks is for pictures alone."""
    lacks = set(found.parameter.split(" or ")).intersection((*_GIMBAL, _CAMERA_INFO))
    return replace(found, severity=min(found.severity, Severity.CAUTION)) if lacks else found


def needed_findings(recording: RecordedTopics, needed: Sequence[Sequence[str]]) -> list[Finding]:
    """Return topics of wrong type, and groups of ``needed`` topics of which none is there."""
    missed = [topics for topics in needed if not recording.there.intersection(topics)]
    found = []
    for topic, wanted in recording.contract.items():
        name = recording.name(topic)
        kind = recording.topics.get(name, wanted)
        if kind != wanted:
            is_needed = any(topic in topics for topics in missed)
            severity = Severity.STOP if is_needed else Severity.CAUTION
            evidence = f"{name} is a {kind or 'message of no type'}, and should be a {wanted}"
            check, mend = (
                f"type_of_{topic.replace('/', '_')}",
                "convert or remap the driver's topic",
            )
            found.append(Finding(check, severity, evidence, topic, mend))
    wrong = {finding.parameter for finding in found}
    absent = [_absent(recording, topics) for topics in missed if not wrong.intersection(topics)]
    return [*found, *absent]


def _absent(recording: RecordedTopics, topics: Sequence[str]) -> Finding:
    names = " nor ".join(map(recording.name, topics))
    near = [name for _, name in recording.elsewhere(topics)]
    hint = f" (there is {', '.join(near)})" if near else ""
    place, mend = ("graph", "publish it") if recording.live else ("bag", "record it")
    if near:
        mend += ", or remap it" if recording.live else ", or give --namespace or a remapping"
    if _CAMERA_INFO in topics:
        option = "the parameter camera" if recording.live else "--camera"
        mend += f", or give its calibration with {option}"
    check = f"no_{topics[0].replace('/', '_')}"
    evidence = f"the {place} has {'neither ' if len(topics) > 1 else 'no '}{names}{hint}"
    return Finding(check, Severity.STOP, evidence, " or ".join(topics), mend)


def damage_findings(damage: str | None) -> list[Finding]:
    """Return what could not be read of a bag; ``damage`` is None if all was read."""
    if damage is None:
        return []
    mend = "record again, or use what is readable: gaps restart the filter"
    return [Finding("damaged_bag", Severity.CAUTION, damage, "IN.mcap", mend)]


def unreadable_findings(
    read: Mapping[str, int], refused: Mapping[str, int], reasons: Mapping[str, str]
) -> list[Finding]:
    """Return the topics with many unusable messages, with the newest reason.

    ``read`` and ``refused`` are numbers of messages by topic. A few may be lost on a link.
    """
    found = []
    for topic, number in refused.items():
        total = number + read.get(topic, 0)
        if number < max(_UNREADABLE_SHARE * total, 2) and number < total:
            continue
        severity = Severity.CAUTION if read.get(topic) else Severity.STOP
        evidence = f"{number} of {total} messages of {topic} cannot be used: {reasons[topic]}"
        check = f"unreadable_{topic.replace('/', '_')}"
        found.append(Finding(check, severity, evidence, topic, "mend what publishes it"))
    return found


def no_pose_findings(status: NavigationStatus) -> list[Finding]:
    """Return the finding that a whole flight gave no pose."""
    why = f"{status.state.value}{': ' if status.reason else ''}{status.reason}"
    mend = "fly with RTK fixes and some motion, or see the other findings"
    evidence = f"the filter made no pose: {why}"
    return [Finding("no_pose", Severity.STOP, evidence, f"ekf_node method {status.method}", mend)]

"""Subscribe to packages; report which are refused and why, and continue with the others."""

from __future__ import annotations

from collections.abc import Sequence

from tirgeo_ros.dji.host.requests import Dialogue, ask_code
from tirgeo_ros.dji.protocol.commands import (
    MATCH_VERSION,
    PACKAGE_IDS,
    RESET_PACKAGES,
    explain,
    remove_package,
)
from tirgeo_ros.dji.protocol.subscription import Package, PackageTable
from tirgeo_ros.dji.protocol.subscription_topics import BY_NAME

_DONE, _UNKNOWN_TOPIC, _OFFLINE = 0x00, 0x22, 0x25
#: Answers that another try does not change: done, or refused for the request's length, version,
#: id, rate or size, or for its topics.
_FINAL = {_DONE, 0x01, 0x02, 0x03, 0x06, 0x07, 0x20, 0x21, _UNKNOWN_TOPIC}
_NEEDS_ACTIVATION = {0x23, 0x50}
#: Topics that are left out when a package is refused with this code: those that an M600 does not
#: know (they were announced, or belong to other aircraft), and those of RTK hardware that is
#: absent or off.
_DISPENSABLE = {
    _UNKNOWN_TOPIC: {"RTK_CONNECT_STATUS", "GIMBAL_CONTROL_MODE", "HEIGHT_FUSION"},
    _OFFLINE: {name for name in BY_NAME if name.startswith("RTK_")},
}


class Subscriber:
    """Manage the subscription of the packages ``wanted``, which may be none.

    While it runs, ``table`` is kept to what the aircraft pushes: the packages that it accepted.
    """

    def __init__(self, wanted: Sequence[Package], table: PackageTable) -> None:
        self._wanted, self._table = wanted, table
        self.forget()

    def forget(self) -> None:
        """Mark everything as not asked for; the table stays until the aircraft is asked."""
        self._is_clean = False  # versions match and no package of another host is left
        self._asked: set[int] = set()
        self._answers: dict[int, int] = {}  # package's id -> code of its last refusal, or 0
        self.problems: dict[int, str] = {}  # of packages that are not fully subscribed

    @property
    def has_packages(self) -> bool:
        """Return whether the aircraft pushes a package that was asked for."""
        return any(number in self._table for number in self._answers)

    @property
    def is_open(self) -> bool:
        """Return whether another try may bring a package."""
        return any(self._answers.get(package.id) not in _FINAL for package in self._wanted)

    def run(self) -> Dialogue[str]:
        """Ask for everything that is open; return "" or why nothing can be subscribed to.

        Raises NoAnswerError if the aircraft does not answer.
        """
        if not self._is_clean:
            refusal = yield from self._clean()
            if refusal:
                return refusal
        for package in self._wanted:
            if self._answers.get(package.id) not in _FINAL:
                yield from self._add(package)
                if self._answers[package.id] in _NEEDS_ACTIVATION:
                    return self.problems[package.id]
        return ""

    def _clean(self) -> Dialogue[str]:
        """Match versions; remove the packages that this or another host left behind."""
        code = yield from ask_code(MATCH_VERSION)
        if code != _DONE:
            return explain(MATCH_VERSION, code)
        if (yield from ask_code(RESET_PACKAGES)) != _DONE:
            for number in PACKAGE_IDS:
                yield from ask_code(remove_package(number))
        self._table.clear()
        self._is_clean = True
        return ""

    def _add(self, wanted: Package) -> Dialogue[None]:
        """Add a package, without the dispensable topics for which it is refused."""
        number, package, answer = wanted.id, wanted, _DONE
        if number in self._asked:  # it may be there in part, or its ack was lost
            yield from ask_code(remove_package(number))
            self._table.pop(number, None)
        self._asked.add(number)
        while (code := (yield from ask_code(package.request))) != _DONE:
            answer = _OFFLINE if _OFFLINE in {answer, code} else code
            left_out = _DISPENSABLE.get(code, set())
            topics = tuple(topic for topic in package.topics if topic.name not in left_out)
            if not topics or len(topics) == len(package.topics):
                break
            package = package._replace(topics=topics)
        else:
            self._table[number] = package
        self._answers[number] = answer
        self.problems.pop(number, None)
        if answer != _DONE:
            missing = [topic.name for topic in wanted.topics if topic not in package.topics]
            what = f"is without {', '.join(missing)}" if number in self._table else "refused"
            self.problems[number] = f"package {number} {what}: {explain(wanted.request, answer)}"

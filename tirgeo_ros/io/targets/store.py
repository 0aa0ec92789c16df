# Copyright 2026 The tirgeo maintainers
# SPDX-License-Identifier: Apache-2.0
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.
"""Keep targets in a file: each change is on disk before it is confirmed, and can be undone."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import threading
import uuid
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from tirgeo_ros.core.frames.wgs84 import ecef_from_geodetic
from tirgeo_ros.core.ground.ground_point import Located
from tirgeo_ros.core.targets.target import KINDS, MOST_TARGETS, NEW, STATUSES, Target
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.core.types.texts import legible, utc
from tirgeo_ros.io.targets.columns import CLICK
from tirgeo_ros.io.targets.geopackage import (
    explained,
    next_number,
    opened,
    put_picture,
    put_target,
    remove_target,
    transaction,
)

#: Limits: characters, bytes and numbers.
MOST_NAME, MOST_NOTE, MOST_MARK = 100, 2000, 200
MOST_PICTURE = 1 << 18
MOST_CLICKS, MOST_MARKS, MOST_ALTERNATIVES = 50, 10_000, 5
MOST_CHANGES = 1000  # that can be undone
#: A click farther than this from a target belongs to another one.
MOST_APART_M = 5000.0

_UNDONE = {
    "add": "target {} removed again",
    "refine": "the last click on target {} removed",
    "edit": "target {} as before",
    "delete": "target {} is back",
    "merge": "target {} as before",  # and the change before it, the deletion of the other one
}
_LOG = (
    "INSERT INTO tirgeo_changes (at_ns, action, target, before, undone, status) "
    "VALUES (?, ?, ?, ?, ?, ?)"
)
_NEWEST_CHANGES = (
    "SELECT revision, action, target, before, status FROM tirgeo_changes WHERE undone = 0 "
    "AND (?1 IS NULL OR target = ?1) ORDER BY revision DESC"
)
_DELETED = (
    "SELECT action, target, before, status FROM tirgeo_changes WHERE undone = 0 AND revision = ?"
)
#: The target that one which was deleted at ``revision - 1`` became part of, and whether that is
#: still its newest change.
_MERGED = (
    "SELECT target, revision = (SELECT max(revision) FROM tirgeo_changes "
    "WHERE undone = 0 AND target = merging.target) FROM tirgeo_changes AS merging "
    "WHERE undone = 0 AND revision = ? AND action = 'merge'"
)
#: A merging cannot be undone without the deletion before it.
_DROP_CHANGES = (
    "DELETE FROM tirgeo_changes WHERE revision <= ?1 OR revision = ?1 + 1 AND action = 'merge'"
)
_MARK_UNDONE = "UPDATE tirgeo_changes SET undone = 1 WHERE revision = ?"
_OPEN = "SELECT target, field, text FROM tirgeo_alternatives WHERE settled IS NULL ORDER BY rowid"
_ONE_OPEN = "settled IS NULL AND target = ? AND field = ? AND text = ?"
_SETTLE = f"UPDATE tirgeo_alternatives SET settled = ? WHERE {_ONE_OPEN}"  # noqa: S608  our own names
#: Errors on reading a damaged record.
_DAMAGE = (TargetError, KeyError, TypeError, ValueError, AttributeError, RecursionError)
_WITH_LOST_CLICKS = (
    "SELECT number FROM targets WHERE clicks > "
    "(SELECT count(*) FROM clicks WHERE target = targets.id) ORDER BY number"
)
#: For pictures of deleted targets that no undo can bring back.
_DROP_PICTURES = (
    "DELETE FROM pictures WHERE target NOT IN (SELECT id FROM targets) "
    "AND target NOT IN (SELECT target FROM tirgeo_changes)"
)


class TargetStore:
    """Keep targets in a GeoPackage that this process alone has open.

    Each method that changes something returns after the change is on disk, and raises TargetError,
    with nothing changed, if that is not possible. Threads may share a store. ``revision`` grows
    with each change of a target, also from one run of the program to the next.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        self._lock = threading.RLock()
        self._db, targets = opened(self.path)
        self._open = True
        self._file = _identity(self.path)
        self._targets = {target.id: target for target in targets}
        #: Numbers of the targets that lacked clicks in the file when it was opened.
        self.lost_clicks = [number for (number,) in self._read(_WITH_LOST_CLICKS)]
        last = self._read("SELECT max(revision) FROM tirgeo_changes")
        self.revision = int(last[0][0] or 0)

    def all(self) -> list[Target]:
        """Return the targets by number, without deleted ones; never wait for the disk."""
        return sorted(self._targets.copy().values(), key=lambda target: target.number)

    def get(self, target_id: str) -> Target:
        """Return a target. Raises TargetError if it does not exist or was deleted."""
        with self._lock:
            if target_id not in self._targets:
                raise TargetError("there is no such target; perhaps it was deleted")
            return self._targets[target_id]

    def add(
        self,
        click: Located,
        *,
        aircraft: str = "",
        kind: str = "other",
        name: str = "",
        picture: bytes | None = None,
        now_ns: int,
    ) -> Target:
        """Add a target at a click; ``picture`` is a cut-out of the video, JPEG."""
        texts = _CHECKED["name"](name), _CHECKED["kind"](kind), ""
        aircraft = _text("aircraft", MOST_NAME, aircraft)
        if picture is not None and not (
            len(picture) <= MOST_PICTURE and picture.startswith(b"\xff\xd8")
        ):
            raise TargetError(f"the picture is no JPEG of up to {MOST_PICTURE} bytes")
        with self._lock:
            if len(self._targets) >= MOST_TARGETS:
                raise TargetError(f"there are {MOST_TARGETS} targets already; delete some")
            with self._transaction():
                number = next_number(self._db)
                own = uuid.uuid4().hex, number, *texts, aircraft, now_ns, now_ns, (click,)
                target = Target(*own)
                put_target(self._db, target)
                if picture is not None:
                    put_picture(self._db, target.id, picture)
                revision = self._log("add", target.id, None, now_ns)
            return self._remember(target, revision)

    def refine(self, target_id: str, click: Located, now_ns: int) -> Target:
        """Add a click to a target, whose place becomes the average of its clicks."""
        with self._lock:
            before = self.get(target_id)
            if len(before.clicks) >= MOST_CLICKS:
                raise TargetError(f"target {before.number} has {MOST_CLICKS} clicks already")
            places = [
                ecef_from_geodetic(p.latitude_rad, p.longitude_rad, p.height_m)
                for p in (before.place, click)
            ]
            apart_m = math.dist(*places)  # straight through the earth
            if apart_m > MOST_APART_M:
                raise TargetError(
                    f"the click is {apart_m / 1000:.1f} km from target {before.number}: "
                    "click it as a target of its own"
                )
            return self._change("refine", before, now_ns, clicks=(*before.clicks, click))

    def edit(
        self, target_id: str, now_ns: int, was: Mapping[str, str] | None = None, **words: str
    ) -> Target:
        """Change name, kind, note or status; ``was``: what the writer saw (None: the current).

        If a field was changed meanwhile, or its target deleted, it stays and the new text is kept
        as an alternative. Raises TargetError also for a deleted target.
        """
        new = {field: _CHECKED[field](text) for field, text in words.items()}
        with self._lock:
            before = self._targets.get(target_id)
            if before is None:
                self._keep(target_id, new, was or {}, now_ns)
                raise TargetError("it was deleted meanwhile; your text is kept with it")
            changed = {f: text for f, text in new.items() if getattr(before, f) != text}
            late = {f: text for f, text in changed.items() if not _is_still(before, f, was)}
            self._keep(target_id, late, was or {}, now_ns)
            new = {f: text for f, text in changed.items() if f not in late}
            return self._change("edit", before, now_ns, **new) if new else before

    def alternatives(self) -> dict[str, list[list[str]]]:
        """Return the open alternatives, each a field and a text, by the target's id."""
        texts = defaultdict(list)
        for target_id, field, text in self._read(_OPEN):
            texts[target_id].append([field, text])
        return texts

    def leave_out(self, target_id: str, field: str, text: str, now_ns: int) -> Target:
        """Dismiss an alternative: the field stays as it is; ``undo`` opens it again."""
        with self._lock:
            target = self.get(target_id)
            if [field, text] not in self.alternatives()[target_id]:
                return target  # somebody else has dismissed or chosen it
            with self._transaction():
                revision = self._log("edit", target_id, target, now_ns)
                self._db.execute(_SETTLE, (revision, target_id, field, text))
            return self._remember(target, revision)

    def for_others(self) -> list[Target]:
        """Return the targets by number, with the alternatives in their notes."""
        targets, others = {target.id: target for target in self.all()}, self.alternatives()
        for id_ in targets.keys() & others.keys():
            note = _with_others(targets[id_].note, others[id_])
            targets[id_] = dataclasses.replace(targets[id_], note=note)
        return [*targets.values()]

    def _keep(
        self, target_id: str, texts: Mapping[str, str], was: Mapping[str, str], now_ns: int
    ) -> None:
        """Keep texts as alternatives, each in place of the alternative that its writer changed."""
        if not self._read("SELECT 1 FROM tirgeo_changes WHERE target = ? LIMIT 1", target_id):
            self.get(target_id)  # raises: it never existed
        revision = self.revision
        with self._transaction():
            for field, text in texts.items():
                for older in (text, was.get(field)):
                    place = (target_id, field, older)
                    self._db.execute(f"DELETE FROM tirgeo_alternatives WHERE {_ONE_OPEN}", place)  # noqa: S608  a constant of ours
                row = "INSERT INTO tirgeo_alternatives (target, field, text) VALUES (?, ?, ?)"
                self._db.execute(row, (target_id, field, text))
                revision = self._log("alternative", target_id, None, now_ns)
            if len(self.alternatives()[target_id]) > MOST_ALTERNATIVES:
                raise TargetError(f"it has {MOST_ALTERNATIVES} texts to choose from: choose one")
        self.revision = revision

    def delete(self, target_id: str, now_ns: int, was: Mapping[str, str] | None = None) -> None:
        """Delete a target if its texts, and status if given, are those that the writer saw.

        ``undo`` restores it.
        """
        with self._lock:
            before = self.get(target_id)
            seen = was if was is None else {"status": before.status, **was}
            if not all(_is_still(before, field, seen) for field in _CHECKED):
                raise TargetError("it was changed meanwhile: look at it, then delete it")
            with self._transaction():
                remove_target(self._db, before.id)
                revision = self._log("delete", before.id, before, now_ns)
            del self._targets[before.id]
            self.revision = revision

    def merge(self, target_id: str, into_id: str, now_ns: int) -> Target:
        """Give the clicks and texts of a target to another one, and delete it."""
        with self._lock:
            gone, into = self.get(target_id), self.get(into_id)
            clicks = (*into.clicks, *gone.clicks)
            if gone is into:
                raise TargetError("a target cannot be merged with itself")
            if len(clicks) > MOST_CLICKS:
                raise TargetError(f"together they have more than {MOST_CLICKS} clicks")
            others = self.alternatives()[gone.id]
            if into.name and gone.name not in {"", into.name}:
                others.append(["name", gone.name])
            note = "\n".join(filter(None, (into.note, _with_others(gone.note, others))))
            new = {"note": _CHECKED["note"](note), "name": into.name or gone.name}
            with self._transaction():
                remove_target(self._db, gone.id)
                self._log("delete", gone.id, gone, now_ns)
                after, revision = self._put("merge", into, now_ns, clicks=clicks, **new)
            del self._targets[gone.id]
            return self._remember(after, revision)

    def undo(self, of: str | None = None) -> str:
        """Undo the newest change not yet undone, of all targets or ``of`` the target with this id.

        Return words for the operator, "" if there is no such change. Of a target that was merged
        the whole merging is undone, so that no click is in two targets. Raises TargetError if the
        other one was changed since, or the record is damaged; the next undo skips a damaged one.
        """
        with self._lock:
            passed, fault = [], ""
            for revision, action, target_id, text, status in self._read(_NEWEST_CHANGES, of):
                passed.append((revision,))
                for into_id, is_newest in self._read(_MERGED, revision + 1):
                    if not is_newest:
                        raise TargetError("it is part of one that changed since: undo that first")
                    return self.undo(into_id)
                try:
                    before = _before(self._targets.values(), action, target_id, text, status)
                    merged = self._deleted_at(revision - 1) if action == "merge" else None
                except _DAMAGE:
                    fault = (
                        "the record of the last change is damaged: Undo again for the one before"
                    )
                    break
                if before or target_id in self._targets:
                    return self._take_back(passed, action, target_id, before, merged)
            with self._transaction():  # another program removed these targets meanwhile
                self._db.executemany(_MARK_UNDONE, passed)
            if fault:
                raise TargetError(fault)
            return ""

    def _deleted_at(self, revision: int) -> Target | None:
        """Return the target that a change deleted, unless that is undone already."""
        rows = self._read(_DELETED, revision)
        return _before(self._targets.values(), *rows[0]) if rows else None

    def _take_back(
        self,
        changes: list[tuple[int]],
        action: str,
        target_id: str,
        before: Target | None,
        merged: Target | None,
    ) -> str:
        with self._transaction():
            self._db.executemany(_MARK_UNDONE, changes)
            if before is None:
                remove_target(self._db, target_id)
            else:
                put_target(self._db, before)
            again = "UPDATE tirgeo_alternatives SET settled = NULL WHERE settled = ?"
            self._db.execute(again, changes[-1])
            # The journal keeps the undone state, so no text is lost from the file.
            revision = self._log("undo", target_id, self._targets.get(target_id), None)
            if merged is not None:
                self._db.execute(_MARK_UNDONE, (changes[-1][0] - 1,))
                put_target(self._db, merged)
                revision = self._log("undo", merged.id, None, None)
        target = before or self._targets.pop(target_id)
        self._targets |= {each.id: each for each in (before, merged) if each is not None}
        self.revision = revision  # last: who has seen it reads the whole change
        words = _UNDONE[action].format(target.number)
        return words if merged is None else f"{words}; {_UNDONE['delete'].format(merged.number)}"

    def picture(self, target_id: str) -> bytes | None:
        """Return a target's cut-out of the video, JPEG, or None."""
        rows = self._read("SELECT jpeg FROM pictures WHERE target = ?", target_id)
        return bytes(rows[0][0]) if rows else None

    def mark(self, text: str, stamp_ns: int) -> None:
        """Add a mark: a text at a time."""
        text = _text("mark", MOST_MARK, text)
        with self._lock:
            if self._read("SELECT count(*) FROM marks")[0][0] >= MOST_MARKS:
                raise TargetError(f"there are {MOST_MARKS} marks already")
            with self._transaction():
                row = "INSERT INTO marks (stamp_ns, time, text) VALUES (?, ?, ?)"
                self._db.execute(row, (stamp_ns, utc(stamp_ns), text))

    def marks(self) -> list[tuple[int, str]]:
        """Return stamps and texts of the marks in the order in which they were made."""
        return self._read("SELECT stamp_ns, text FROM marks")

    def switch(self, what: str, on: bool) -> None:
        """Keep in the file whether a switch, which concerns no target, is on."""
        with self._lock, self._transaction():
            self._db.execute("DELETE FROM tirgeo_switches WHERE what = ?", (what,))
            if on:
                self._db.execute("INSERT INTO tirgeo_switches VALUES (?)", (what,))

    def switched_on(self) -> list[str]:
        """Return the switches that are on, also those of an earlier run that was killed."""
        return [what for (what,) in self._read("SELECT what FROM tirgeo_switches ORDER BY rowid")]

    def close(self) -> None:
        """Close the file: another process may then open it. May be called several times."""
        with self._lock:
            self._open = False
            self._db.close()

    def _change(self, action: str, before: Target, now_ns: int, **new: Any) -> Target:
        with self._transaction():
            after, revision = self._put(action, before, now_ns, **new)
        return self._remember(after, revision)

    def _put(self, action: str, before: Target, now_ns: int, **new: Any) -> tuple[Target, int]:
        """Write a changed target; return it with the revision."""
        after = dataclasses.replace(before, changed_ns=now_ns, **new)
        put_target(self._db, after)
        revision = self._log(action, before.id, before, now_ns)
        for field, text in self.alternatives()[before.id]:
            if field in new and f"\n{text}\n" in f"\n{new[field]}\n":
                self._db.execute(_SETTLE, (revision, before.id, field, text))
        return after, revision

    def _remember(self, target: Target, revision: int) -> Target:
        self._targets[target.id] = target
        self.revision = revision
        return target

    def _log(self, action: str, target_id: str, before: Target | None, now_ns: int | None) -> int:
        """Add a change to the journal, and drop its oldest ones; return the revision."""
        text, status = (None, None) if before is None else (_record(before), before.status)
        row = (now_ns, action, target_id, text, action in {"undo", "alternative"}, status)
        revision = int(self._db.execute(_LOG, row).lastrowid or 0)
        oldest = (revision - MOST_CHANGES,)
        self._db.execute("DELETE FROM tirgeo_alternatives WHERE settled <= ?", oldest)
        if self._db.execute(_DROP_CHANGES, oldest).rowcount:
            self._db.execute(_DROP_PICTURES)
        return revision

    @contextlib.contextmanager
    def _transaction(self) -> Iterator[None]:
        self._check_open()
        if _identity(self.path) != self._file:
            raise TargetError(
                f"{self.path}: moved or deleted while it is in use; put it back, or export the "
                "targets and start again"
            )
        with explained(self.path), transaction(self._db):
            yield

    def _read(self, query: str, *values: object) -> list[Any]:
        with self._lock, explained(self.path):
            self._check_open()
            return self._db.execute(query, values).fetchall()

    def _check_open(self) -> None:
        if not self._open:
            raise TargetError(f"{self.path}: closed")


def _identity(path: Path) -> tuple[int, int] | None:
    """Return the identity (device, inode) of the file at a path; None if there is none."""
    try:
        status = path.stat()
    except OSError:
        return None
    return status.st_dev, status.st_ino


def _record(target: Target) -> str:
    """Return a target as the journal keeps it, without its status."""
    fields = {field.name: getattr(target, field.name) for field in dataclasses.fields(target)}
    del fields["status"]  # it has a column, as earlier versions read no record with another field
    clicks = [{key: getattr(click, key) for key in CLICK} for click in fields.pop("clicks")]
    return json.dumps(fields | {"fixings": clicks})


def _before(
    now: Iterable[Target], action: str, id_: str, text: str | None, status: str | None
) -> Target | None:
    """Return the target before a change, None if that added it; raise one of ``_DAMAGE``."""
    if action not in _UNDONE or (action == "add") != (text is None):
        raise ValueError(action)
    if text is None:
        return None
    fields = json.loads(text)
    clicks = (
        click | {"covariance_enu": tuple(click["covariance_enu"])}
        for click in fields.pop("fixings")
    )
    places = tuple(Located(**click) for click in clicks)
    before = Target(**fields, clicks=places, status=NEW if status is None else status)
    sound = before.kind in KINDS and before.status in STATUSES and before.clicks
    largest = max(map(abs, (before.number, before.created_ns, before.changed_ns)))
    same = {before.id, *(other.id for other in now if other.number == before.number)}
    if not sound or largest >= 1 << 63 or same != {id_}:
        raise ValueError(text)
    return before


def _text(what: str, most: int, text: str) -> str:
    """Return a text without control characters. Raises TargetError if it is too long."""
    clean = legible(text).strip()
    if len(clean) > most:
        raise TargetError(f"the {what} has {len(clean)} characters; shorten it to {most}")
    return clean if what == "note" else " ".join(clean.split())


def _is_still(target: Target, field: str, was: Mapping[str, str] | None) -> bool:
    """Return whether a field has the text that the writer saw, as typed or as kept."""
    if was is None or field not in was:
        return was is None
    return getattr(target, field) in {was[field], _text(field, len(was[field]), was[field])}


def _with_others(note: str, others: Iterable[Sequence[str]]) -> str:
    """Return a note with alternatives, each a field and a text, as lines of their own."""
    lines = [f"also written as the {field}: {text}" for field, text in others]
    return "\n".join([note, *lines]).strip()


def _one_of(what: str, words: Sequence[str], text: str) -> str:
    if text not in words:
        raise TargetError(f"unknown {what} of target; give one of {', '.join(words)}")
    return text


#: What an operator may change of a target -> returns it as it is kept, or raises TargetError.
_CHECKED: Mapping[str, Callable[[str], str]] = {
    "name": partial(_text, "name", MOST_NAME),
    "kind": partial(_one_of, "kind", KINDS),
    "note": partial(_text, "note", MOST_NOTE),
    "status": partial(_one_of, "status", STATUSES),
}

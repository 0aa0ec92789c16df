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
"""The store of targets: changes are in the file, and are undone step by step."""

from __future__ import annotations

import sqlite3
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest
from hypothesis import given, settings, strategies as st
from target_samples import click

from tirgeo_ros.core.targets.target import averaged
from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets import store as store_module
from tirgeo_ros.io.targets.formats import exported
from tirgeo_ros.io.targets.store import (
    MOST_CLICKS,
    MOST_NAME,
    MOST_NOTE,
    MOST_PICTURE,
    TargetStore,
)

JPEG = b"\xff\xd8 a picture"
#: Zero-width joiner and non-joiner, which Python does not call printable.
JOINERS = str.maketrans("", "", "\u200c\u200d")


def reopened(store):
    store.close()
    return TargetStore(store.path)


def test_a_target_its_changes_and_marks_come_back(store):
    item = store.add(click(), kind="fire", name="barn", aircraft="uav1", picture=JPEG, now_ns=5)
    two = store.add(click(3), now_ns=6)
    assert (item.number, two.number, two.kind, two.name) == (1, 2, "other", "")
    refined = store.refine(item.id, click(1, after_s=60), 7)
    assert refined.place == averaged([click(), click(1, after_s=60)])
    edited = store.edit(two.id, 8, kind="person", note="waves\nboth arms")
    assert (edited.created_ns, edited.changed_ns) == (6, 8)
    assert store.all() == [refined, edited]
    store.mark("smoke", 7)
    store.mark("second pass", 9)
    again = reopened(store)
    assert again.all() == [refined, edited]
    assert again.picture(item.id) == JPEG
    assert again.picture(two.id) is None
    assert again.revision == 4
    assert again.marks() == [(7, "smoke"), (9, "second pass")]
    again.close()
    with pytest.raises(TargetError, match=r"targets\.gpkg: closed"):
        again.add(click(), now_ns=1)


def test_a_number_is_never_given_again(store):
    first = store.add(click(), now_ns=1)
    store.undo()
    second = store.add(click(), now_ns=2)
    store.delete(second.id, 3)
    again = reopened(store)
    assert again.add(click(), now_ns=4).number == 3
    assert first.id != second.id
    again.close()


def test_each_change_is_undone_in_turn_also_after_a_restart(store):
    item = store.add(click(), name="a", picture=JPEG, now_ns=1)
    refined = store.refine(item.id, click(1), 2)
    edited = store.edit(item.id, 3, name="b")
    store.delete(item.id, 4)
    assert store.all() == []
    store = reopened(store)
    words, states = [], []
    for _ in range(5):
        words.append(store.undo())
        states.append(store.all())
    assert words == [
        "target 1 is back",
        "target 1 as before",
        "the last click on target 1 removed",
        "target 1 removed again",
        "",
    ]
    assert states == [[edited], [refined], [item], [], []]
    assert store.picture(item.id) == JPEG
    store.close()


def test_one_target_is_undone_past_the_changes_of_others(store):
    item = store.add(click(), now_ns=1)
    other = store.add(click(), now_ns=2)
    store.edit(item.id, 3, name="Anna")
    store.edit(other.id, 4, name="Berta")
    assert store.undo(item.id) == "target 1 as before"
    assert [target.name for target in store.all()] == ["", "Berta"]
    assert store.undo(item.id) == "target 1 removed again"
    assert store.undo(item.id) == ""
    assert store.undo() == "target 2 as before"


def test_the_journal_and_pictures_of_deleted_targets_have_a_bound(store, monkeypatch):
    monkeypatch.setattr(store_module, "MOST_CHANGES", 5)
    gone = store.add(click(), picture=JPEG, now_ns=1)
    store.delete(gone.id, 2)
    kept = store.add(click(), picture=JPEG, now_ns=3)
    for number in range(10):
        store.edit(kept.id, number, name=str(number))
    assert store._read("SELECT count(*) FROM tirgeo_changes") == [(5,)]
    assert store.picture(gone.id) is None
    assert store.picture(kept.id) == JPEG
    assert [bool(store.undo()) for _ in range(6)].count(True) <= 5


def test_the_revision_grows_with_each_change_also_from_run_to_run(store):
    revisions = [store.revision]
    item = store.add(click(), now_ns=1)
    revisions.append(store.revision)
    store.edit(item.id, 2, name="x")
    revisions.append(store.revision)
    assert store.edit(item.id, 3, name="x").changed_ns == 2  # nothing was changed
    assert store.revision == revisions[-1]
    store.undo()
    revisions.append(store.revision)
    store = reopened(store)
    assert store.revision == revisions[-1]
    store.delete(item.id, 4)
    revisions.append(store.revision)
    assert revisions == sorted(set(revisions))
    store.close()


@pytest.mark.parametrize(
    ("typed", "kept"),
    [
        ("Team\u00a07\tNord", "Team 7 Nord"),
        ("\u5c71\u7530\u3000\u592a\u90ce", "\u5c71\u7530 \u592a\u90ce"),
        ("\u0645\u06cc\u200c\u062e\u0648\u0627\u0647\u0645", None),
        ("\U0001f469\u200d\U0001f467", None),
    ],
    ids=["no-break", "ideographic", "non-joiner", "emoji"],
)
def test_spaces_of_all_scripts_and_joiners_stay(store, typed, kept):
    item = store.add(click(), name=typed, now_ns=1)
    assert item.name == (kept or typed)
    for form in ("kml", "gpx", "geojson", "csv"):
        assert item.name in exported([item], form).decode()


@settings(max_examples=40)
@given(st.text(max_size=80), st.text(max_size=80))
def test_any_text_can_be_a_name_and_a_note(shared_store, name, note):
    item = shared_store.add(click(), name=name, now_ns=1)
    edited = shared_store.edit(item.id, 2, note=note)
    assert edited.name.translate(JOINERS).isprintable()
    assert edited.note.replace("\n", "").translate(JOINERS).isprintable()
    # what is there is what was typed
    assert set(edited.name) <= set(name) | {" "}
    assert shared_store._read("SELECT name, note FROM targets WHERE id = ?", item.id) == [
        (edited.name, edited.note)
    ]
    shared_store.delete(item.id, 3)


@pytest.fixture(scope="module")
def shared_store(tmp_path_factory):
    opened = TargetStore(tmp_path_factory.mktemp("store") / "targets.gpkg")
    yield opened
    opened.close()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda s, _: s.add(click(), kind="cow", now_ns=1), "one of person, fire"),
        (lambda s, _: s.add(click(), name="x" * (MOST_NAME + 1), now_ns=1), "shorten it to 100"),
        (lambda s, _: s.add(click(), picture=b"GIF8", now_ns=1), "no JPEG"),
        (lambda s, _: s.add(click(), picture=JPEG * MOST_PICTURE, now_ns=1), "no JPEG of up to"),
        (lambda s, t: s.edit(t.id, 1, note="x" * (MOST_NOTE + 1)), "shorten it to 2000"),
        (lambda s, _: s.edit("0" * 32, 1, name="x"), "no such target"),
        (lambda s, _: s.delete("0" * 32, 1), "no such target"),
        (lambda s, _: s.refine("0" * 32, click(), 1), "no such target"),
        (lambda s, t: s.refine(t.id, click(7000), 1), r"7\.0 km from target 1"),
    ],
)
def test_a_refused_change_changes_nothing(store, change, text):
    item = store.add(click(), picture=JPEG, now_ns=1)
    revision = store.revision
    with pytest.raises(TargetError, match=text):
        change(store, item)
    assert store.all() == [item]
    assert store.revision == revision
    again = reopened(store)
    assert again.all() == [item]
    again.close()


def test_targets_clicks_and_marks_have_a_bound(store, monkeypatch):
    item = store.add(click(), now_ns=1)
    for number in range(1, MOST_CLICKS):
        store.refine(item.id, click(after_s=number), number)
    with pytest.raises(TargetError, match="has 50 clicks"):
        store.refine(item.id, click(), 99)
    monkeypatch.setattr(store_module, "MOST_TARGETS", 1)
    with pytest.raises(TargetError, match="delete some"):
        store.add(click(), now_ns=100)
    monkeypatch.setattr(store_module, "MOST_MARKS", 0)
    with pytest.raises(TargetError, match="marks already"):
        store.mark("x", 1)


def test_threads_share_a_store(store):
    def work(name):
        for number in range(8):
            item = store.add(click(), name=name, now_ns=number)
            store.edit(item.id, number, note="seen")
            store.all()

    threads = [threading.Thread(target=work, args=(f"t{k}",)) for k in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    result = store.all()
    assert sorted(item.number for item in result) == list(range(1, 33))
    assert {item.note for item in result} == {"seen"}
    assert store.revision == 64
    again = reopened(store)
    assert again.all() == result
    again.close()


def test_who_looks_at_the_targets_waits_for_no_disk(store, monkeypatch):
    """The thread that brings the video looks ten times a second, also during another's change."""
    item, put = store.add(click(), now_ns=1), store_module.put_target
    began, ended = threading.Event(), threading.Event()

    def put_on_a_slow_card(db, target):
        began.set()
        ended.wait(60)
        put(db, target)

    monkeypatch.setattr(store_module, "put_target", put_on_a_slow_card)
    writer = threading.Thread(target=store.edit, args=(item.id, 2), kwargs={"name": "Anna"})
    writer.start()
    assert began.wait(60)
    with ThreadPoolExecutor(1) as reader:
        looked = reader.submit(store.all)
        try:
            assert looked.result(20) == [item]
        finally:
            ended.set()
            writer.join()
    assert [each.name for each in store.all()] == ["Anna"]


def test_texts_of_two_writers_are_kept_as_alternatives(store, monkeypatch):
    """Tablet A sends late a text that it wrote before B's."""
    item = store.add(click(), now_ns=1)
    newer = store.edit(item.id, 2, {"note": ""}, note="found alive, medic needed")
    assert store.edit(item.id, 3, {"note": ""}, note="am Ufer") == newer
    assert store.edit(item.id, 4, {"note": ""}, note="found alive, medic needed") == newer
    assert store.alternatives() == {item.id: [["note", "am Ufer"]]}
    store.edit(item.id, 5, {"note": "am Ufer"}, note="am Ufer, 2")  # A goes on with its own
    store.edit(item.id, 5, {"note": ""}, note="am Ufer, 2")  # sent again
    store.edit(item.id, 6, {"kind": "fire"}, kind="person", name="Anna")  # of before the name was
    open_ = [["note", "am Ufer, 2"], ["kind", "person"], ["name", "Anna"]]
    monkeypatch.setattr(store_module, "MOST_CHANGES", 1)
    store = reopened(store)
    store.refine(item.id, click(1), 7)
    assert store.alternatives() == {item.id: open_}
    assert "found alive, medic needed\nalso written as the note: am Ufer, 2\n" in (
        store.for_others()[0].note
    )
    monkeypatch.setattr(store_module, "MOST_CHANGES", 1000)
    store.edit(item.id, 8, {"note": newer.note}, note=f"{newer.note}\nam Ufer, 2")
    store.leave_out(item.id, "kind", "person", 9)
    assert store.alternatives() == {item.id: [["name", "Anna"]]}
    assert [store.undo() for _ in range(2)] == ["target 1 as before"] * 2
    assert store.alternatives() == {item.id: open_}
    assert store.get(item.id).note == newer.note
    store.edit(item.id, 10, {"name": "x"}, name="B")
    store.edit(item.id, 10, {"name": "x"}, name="C")
    with pytest.raises(TargetError, match="it has 5 texts to choose from: choose one"):
        store.edit(item.id, 10, {"name": "x"}, name="D")
    store.close()


def test_a_text_that_two_dismiss_comes_back_with_one_undo(store):
    item = store.add(click(), name="Anna", now_ns=1)
    store.edit(item.id, 2, {"name": ""}, name="Berta")
    dismissed = store.leave_out(item.id, "name", "Berta", 3)
    assert store.leave_out(item.id, "name", "Berta", 4) == dismissed
    assert store.undo() == "target 1 as before"
    assert store.alternatives() == {item.id: [["name", "Berta"]]}


def test_a_changed_target_is_not_deleted_and_texts_for_a_deleted_one_are_kept(store):
    item = store.add(click(), now_ns=1)
    was = {"name": "", "kind": "other", "note": ""}
    store.edit(item.id, 2, note="found alive")
    with pytest.raises(TargetError, match="it was changed meanwhile: look at it, then delete it"):
        store.delete(item.id, 3, was)
    store.delete(item.id, 4, was | {"note": " found alive"})
    with pytest.raises(TargetError, match="it was deleted meanwhile"):
        store.edit(item.id, 5, {"note": ""}, note="am Ufer")
    assert store.undo() == "target 1 is back"
    assert store.get(item.id).note == "found alive"
    assert store.alternatives() == {item.id: [["note", "am Ufer"]]}
    with pytest.raises(TargetError, match="there is no such target"):
        store.edit("0" * 32, 6, {"note": ""}, note="am Ufer")


def test_a_status_is_kept_undone_and_guarded_like_the_kind(store):
    item = store.add(click(), now_ns=1)
    assert item.status == "new"
    store.edit(item.id, 2, {"status": "new"}, status="found")
    late = store.edit(item.id, 3, {"status": "new"}, status="dismissed")
    assert late.status == "found"
    assert store.alternatives() == {item.id: [["status", "dismissed"]]}
    was = {"name": "", "kind": "other", "note": "", "status": "new"}
    with pytest.raises(TargetError, match="it was changed meanwhile: look at it"):
        store.delete(item.id, 4, was)
    with pytest.raises(TargetError, match="unknown status of target; give one of new, checked"):
        store.edit(item.id, 5, status="lost")
    again = reopened(store)
    assert again.get(item.id).status == "found"
    assert again.undo(item.id) == "target 1 as before"
    assert again.get(item.id).status == "new"
    again.delete(item.id, 6, was)
    again.undo()
    assert again.get(item.id).status == "new"
    again.close()


def test_a_merged_target_s_clicks_and_words_are_the_other_one_s(store):
    into = store.edit(store.add(click(), kind="person", now_ns=1).id, 1, note="waves")
    gone = store.add(click(1, after_s=60), kind="fire", name="Anna", picture=JPEG, now_ns=2)
    store.edit(gone.id, 3, {"note": "?"}, note="one leg hurt")  # late: an alternative
    gone = store.edit(gone.id, 4, note="sits", status="found")
    merged = store.merge(gone.id, into.id, 5)
    assert merged.place == averaged([click(), click(1, after_s=60)])
    assert (merged.id, merged.kind, merged.status) == (into.id, "person", "new")
    assert merged.name == "Anna"
    assert merged.note == "waves\nsits\nalso written as the note: one leg hurt"
    assert store.all() == [merged]
    again = reopened(store)
    assert again.all() == [merged]
    assert again.undo() == "target 1 as before; target 2 is back"
    assert again.all() == [into, gone]
    assert again.alternatives() == {gone.id: [["note", "one leg hurt"]]}
    assert again.picture(gone.id) == JPEG
    assert again.undo(gone.id) == "target 2 as before"
    again.close()


def test_targets_far_apart_may_be_merged_and_say_that_they_disagree(store):
    one = store.add(click(), name="Anna", now_ns=1)
    two = store.add(click(300), name="Berta", now_ns=2)
    merged = store.merge(two.id, one.id, 3)
    assert not merged.clicks_agree
    assert (merged.name, merged.note) == ("Anna", "also written as the name: Berta")


def test_a_merging_that_cannot_be_is_refused_and_changes_nothing(store, monkeypatch):
    one, two = store.add(click(), now_ns=1), store.add(click(1), now_ns=2)
    store.edit(one.id, 3, note="x" * MOST_NOTE)
    store.edit(two.id, 3, note="y")
    before, revision = store.all(), store.revision
    with pytest.raises(TargetError, match=r"the note has \d+ characters; shorten it to 2000"):
        store.merge(two.id, one.id, 3)
    with pytest.raises(TargetError, match="cannot be merged with itself"):
        store.merge(one.id, one.id, 3)
    with pytest.raises(TargetError, match="there is no such target"):
        store.merge("0" * 32, one.id, 3)
    monkeypatch.setattr(store_module, "MOST_CLICKS", 1)
    with pytest.raises(TargetError, match="together they have more than 1 clicks"):
        store.merge(two.id, one.id, 3)
    assert (reopened(store).all(), store.revision) == (before, revision)


def test_a_merging_is_undone_as_a_whole_or_not_at_all(store, monkeypatch):
    """On a full disk neither target loses clicks, and the next undo tries again."""
    one, two = store.add(click(), now_ns=1), store.add(click(1), now_ns=2)
    merged = store.merge(two.id, one.id, 3)
    put = store_module.put_target

    def put_on_a_full_disk(db, target):
        if target.id == two.id:
            raise sqlite3.OperationalError("database or disk is full")
        put(db, target)

    monkeypatch.setattr(store_module, "put_target", put_on_a_full_disk)
    with pytest.raises(TargetError, match="no room on the disk"):
        store.undo()
    assert store.all() == [merged]
    monkeypatch.setattr(store_module, "put_target", put)
    again = reopened(store)
    assert again.all() == [merged]
    assert again.undo() == "target 1 as before; target 2 is back"
    assert again.all() == [one, two]
    again.close()


def test_the_undo_of_a_merged_target_leaves_its_clicks_in_no_other_one(store):
    """As of who was typing its name: merged once more, each of them had counted twice."""
    one, two = store.add(click(), now_ns=1), store.add(click(1), now_ns=2)
    merged = store.merge(two.id, one.id, 3)
    refined = store.refine(one.id, click(2), now_ns=4)
    with pytest.raises(TargetError, match="part of one that changed since"):
        store.undo(two.id)
    assert store.all() == [refined]
    store.undo(one.id)
    assert store.all() == [merged]
    assert store.undo(two.id) == "target 1 as before; target 2 is back"
    assert store.all() == [one, two]
    assert store.undo(two.id) == "target 2 removed again"


def test_a_merging_is_forgotten_together_with_the_deletion_in_it(store, monkeypatch):
    one, two = store.add(click(), now_ns=1), store.add(click(1), now_ns=2)
    merged = store.merge(two.id, one.id, 3)
    monkeypatch.setattr(store_module, "MOST_CHANGES", 2)
    edited = store.edit(one.id, 4, name="Anna")
    assert store.undo() == "target 1 as before"
    assert store.undo() == ""  # half of a merging would lose clicks
    assert store.all() == [merged]
    assert edited.clicks == merged.clicks

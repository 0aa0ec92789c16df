"""A journal with damage: undo says so and goes on before it, and what is no damage stays."""

from __future__ import annotations

import sqlite3

import pytest
from target_samples import click

from tirgeo_ros.core.types.errors import TargetError
from tirgeo_ros.io.targets.formats import read_targets
from tirgeo_ros.io.targets.store import TargetStore

NEWEST = "WHERE revision = (SELECT max(revision) FROM tirgeo_changes)"


@pytest.fixture
def path(tmp_path):
    return tmp_path / "targets.gpkg"


def written(path):
    """Two targets, the first edited twice."""
    store = TargetStore(path)
    one = store.add(click(), kind="person", now_ns=1)
    other = store.add(click(3), now_ns=2)
    store.edit(one.id, 3, name="Anna")
    store.edit(one.id, 4, name="Berta")
    store.close()
    return one, other


def changed(path, *changes):
    with sqlite3.connect(path) as db:
        for change in changes:
            db.execute(change)
    db.close()


@pytest.mark.parametrize(
    "change",
    [
        "before = substr(before, 2)",
        "before = '{}'",
        "before = '7'",
        pytest.param(f"before = '{'[' * 100_000}'", id="deep"),
        "before = NULL",
        "before = x'ff00'",
        "before = CAST(x'ff00' AS TEXT)",
        "before = replace(before, 'person', 'persoo')",
        "before = replace(before, 'note', 'nose')",
        "before = replace(before, '\"changed_ns\": 3', '\"changed_ns\": 9634731235605555556')",
        "before = replace(before, 'stamp_ns\": ', 'stamp_ns\": 9')",
        "before = replace(before, 'number\": 1', 'number\": 2')",
        "before = replace(before, 'number\": 1', 'number\": \"1\"')",
        "action = 'edir'",
        "action = 'add'",
        "action = CAST(x'ff' AS TEXT)",
        "target = replace(target, substr(target, 1, 1), 'x')",
    ],
)
def test_a_damaged_record_is_said_and_undo_goes_on_before_it(path, change):
    one, other = written(path)
    changed(path, f"UPDATE tirgeo_changes SET {change} {NEWEST}")
    store = TargetStore(path)
    before = store.all()
    with pytest.raises(TargetError, match="record of the last change is damaged: Undo again for"):
        store.undo()
    assert store.all() == before
    assert store.undo() == "target 1 as before"
    assert store.all() == [one, other]
    assert [store.undo() for _ in range(3)] == [
        "target 2 removed again",
        "target 1 removed again",
        "",
    ]
    store.close()


def test_many_targets_that_another_program_removed_leave_nothing_to_undo(path):
    """As many as the journal holds."""
    TargetStore(path).close()
    numbers = "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n LIMIT 999)"
    row = "INSERT INTO tirgeo_changes (action, target, undone)"
    changed(path, f"{row} {numbers} SELECT 'add', i, 0 FROM n")
    store = TargetStore(path)
    assert store.undo() == store.undo() == ""
    store.close()


@pytest.mark.parametrize("share", ["target IN (SELECT id FROM targets)", "fid = 2"])
def test_a_target_whose_clicks_are_gone_stays_and_is_named(path, share):
    store = TargetStore(path)
    one = store.add(click(), now_ns=1)
    one = store.refine(one.id, click(1, after_s=60), 2)
    other = store.add(click(3), now_ns=3)
    store.close()
    changed(path, f"DELETE FROM clicks WHERE {share} AND target != '{other.id}'")
    store = TargetStore(path)
    left, same = store.all()
    assert (left.id, left.number, len(left.clicks), same) == (one.id, 1, 1, other)
    # Rows are written to 1e-9 deg, 0.1 mm; the two clicks are 1 m apart.
    far_deg = 1e-9 if "IN" in share else 2e-5
    assert left.place.longitude_deg == pytest.approx(one.place.longitude_deg, abs=far_deg)
    assert store.lost_clicks == [1]
    store.close()
    assert read_targets(path) == [left, same]


def test_a_file_of_before_has_its_alternatives_and_what_is_on(path):
    """They were among the changes, with negative numbers in the column undone."""
    one, _ = written(path)
    row = "INSERT INTO tirgeo_changes (at_ns, action, target, before, undone) VALUES"
    alternative = f"(5, 'alternative', '{one.id}', '[\"note\", \"am Ufer\"]'"
    changed(
        path,
        "DROP TABLE IF EXISTS tirgeo_alternatives",
        "DROP TABLE IF EXISTS tirgeo_switches",
        f"{row} {alternative}, -1)",
        f"{row} (5, 'alternative', '{one.id}', '[\"kind\", \"fire\"]', 4)",
        f"{row} (5, 'alternative', '{one.id}', '[\"note', -1)",
        f"{row} (NULL, 'on', 'record uav1', NULL, -2)",
    )
    for _ in range(2):
        store = TargetStore(path)
        assert store.alternatives() == {one.id: [["note", "am Ufer"]]}
        assert store.switched_on() == ["record uav1"]
        store.close()
    store = TargetStore(path)
    assert store.undo() == "target 1 as before"  # change 4, which settled the other
    assert store.alternatives() == {one.id: [["note", "am Ufer"], ["kind", "fire"]]}
    store.switch("record uav1", on=False)
    store.close()
    store = TargetStore(path)
    assert store.switched_on() == []
    assert store.undo() == "target 1 as before"
    store.close()


def test_a_damaged_byte_of_an_alternative_costs_a_letter(path):
    one, _ = written(path)
    store = TargetStore(path)
    store.edit(one.id, 5, {"name": "Anna"}, name="Gerda")
    store.close()
    changed(path, "UPDATE tirgeo_alternatives SET text = CAST(x'ff65' AS TEXT)")
    store = TargetStore(path)
    assert store.alternatives() == {one.id: [["name", "\ufffde"]]}
    store.close()
